//! Reasons of failed connections, with their remedies.

use rustls::{AlertDescription, CertificateError, Error as Tls};
use std::error::Error;
use std::io;

/// TLS alerts about the local certificate. In TLS 1.3 they arrive after the handshake is complete on this side.
const ALERTS: [AlertDescription; 4] = [
    AlertDescription::CertificateRequired,
    AlertDescription::UnknownCA,
    AlertDescription::DecryptError,
    AlertDescription::CertificateExpired,
];

/// Returns the innermost cause of an error, because it is the most specific: "connection refused" rather than
/// "transport error".
pub fn reason(error: &(dyn Error + 'static)) -> String {
    let cause = match to_the_bottom(error) {
        Ok(tls) => return of_tls(tls),
        Err(cause) => cause,
    };
    let text = cause.to_string();
    // After a connection is established, HTTP/2 keeps only the text of an error.
    if let Some(alert) = ALERTS.map(Tls::AlertReceived).iter().find(|alert| alert.to_string() == text) {
        return of_tls(alert);
    }
    text.find(" (os error").map_or(text.clone(), |end| text[..end].to_owned())
}

/// Fault of the certificate that the peer presented.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BadCertificate {
    /// Not signed by an accepted CA.
    UnknownIssuer,
    /// Certificate past its last day.
    Expired,
    /// Issued for other host names.
    OtherName {
        /// Host name of the address.
        dialed: String,
        /// Host names in the certificate.
        names: Vec<String>,
    },
    /// Another fault.
    Other(String),
}

/// Returns the fault of the peer's certificate if a connection failed because of it; `None` for other failures.
pub fn bad_certificate(error: &(dyn Error + 'static)) -> Option<BadCertificate> {
    let Ok(Tls::InvalidCertificate(problem)) = to_the_bottom(error) else { return None };
    Some(match problem {
        // A bad signature means another CA with the same name.
        CertificateError::UnknownIssuer | CertificateError::BadSignature => BadCertificate::UnknownIssuer,
        CertificateError::Expired | CertificateError::ExpiredContext { .. } => BadCertificate::Expired,
        CertificateError::NotValidForNameContext { expected, presented } => BadCertificate::OtherName {
            dialed: expected.to_str().into_owned(),
            names: presented.iter().map(|name| bare(name)).collect(),
        },
        other => BadCertificate::Other(other.to_string()),
    })
}

/// Returns a name in a certificate without the kind that the TLS library adds, as in `DnsName("node1.example")`.
fn bare(name: &str) -> String {
    let inner = name.split_once('(').and_then(|(_, rest)| rest.strip_suffix(')'));
    inner.unwrap_or(name).trim_matches('"').to_owned()
}

/// Returns the first TLS error in a chain, or else the innermost error.
fn to_the_bottom<'a>(error: &'a (dyn Error + 'static)) -> Result<&'a Tls, &'a (dyn Error + 'static)> {
    let mut cause = error;
    loop {
        let wrapped = cause.downcast_ref::<io::Error>().and_then(|io| io.get_ref());
        if let Some(tls) = cause.downcast_ref::<Tls>().or_else(|| wrapped?.downcast_ref()) {
            return Ok(tls);
        }
        cause = cause.source().ok_or(cause)?;
    }
}

fn of_tls(error: &Tls) -> String {
    match error {
        // A bad signature means another CA with the same name, such as after two runs of `evogait certs init`.
        Tls::InvalidCertificate(CertificateError::UnknownIssuer | CertificateError::BadSignature) => {
            "its certificate was not signed by the CA that --ca names".to_owned()
        }
        Tls::InvalidCertificate(CertificateError::Expired | CertificateError::ExpiredContext { .. }) => {
            "its certificate has expired: renew it, such as with `evogait certs renew`".to_owned()
        }
        Tls::InvalidCertificate(CertificateError::NotValidForNameContext { expected, presented }) => format!(
            "its certificate is not for {}, but for {}: use one of these names, or create one with `evogait certs init --host`",
            expected.to_str(),
            if presented.is_empty() {
                "no name".to_owned()
            } else {
                presented.iter().map(|name| bare(name)).collect::<Vec<_>>().join(", ")
            }
        ),
        Tls::AlertReceived(AlertDescription::CertificateRequired) => {
            "it requires a client certificate: give --cert FILE and --key FILE".to_owned()
        }
        Tls::AlertReceived(AlertDescription::UnknownCA | AlertDescription::DecryptError) => {
            "it does not accept the CA of the certificate that --cert names: give a certificate of a CA that it accepts"
                .to_owned()
        }
        Tls::AlertReceived(AlertDescription::CertificateExpired) => {
            "the certificate that --cert names has expired: renew it, such as with `evogait certs renew`".to_owned()
        }
        Tls::InvalidMessage(_) => "it does not use TLS: write http:// if it runs without TLS".to_owned(),
        other => other.to_string(),
    }
}
