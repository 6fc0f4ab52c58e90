//! Reasons of failed connections, with the remedy.

use rustls::{AlertDescription, CertificateError, Error as Tls};
use std::error::Error;
use std::io;

/// Alerts about our certificate. In TLS 1.3 they arrive after the connection is established on our side.
const ALERTS: [AlertDescription; 4] = [
    AlertDescription::CertificateRequired,
    AlertDescription::UnknownCA,
    AlertDescription::DecryptError,
    AlertDescription::CertificateExpired,
];

/// The cause at the bottom of an error's chain, which is the one that helps: "connection refused" rather than
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
    /// It is not signed by an accepted CA.
    UnknownIssuer,
    /// It is not valid any more.
    Expired,
    /// It is another machine's.
    OtherName {
        /// The name that was dialed.
        dialed: String,
        /// The names that it is for.
        names: Vec<String>,
    },
    /// Something else.
    Other(String),
}

/// Returns the fault of the peer's certificate if a connection failed because of it; `None` for other failures.
pub fn bad_certificate(error: &(dyn Error + 'static)) -> Option<BadCertificate> {
    let Ok(Tls::InvalidCertificate(problem)) = to_the_bottom(error) else { return None };
    Some(match problem {
        // A bad signature: another CA of the same name.
        CertificateError::UnknownIssuer | CertificateError::BadSignature => BadCertificate::UnknownIssuer,
        CertificateError::Expired | CertificateError::ExpiredContext { .. } => BadCertificate::Expired,
        CertificateError::NotValidForNameContext { expected, presented } => {
            BadCertificate::OtherName { dialed: expected.to_str().into_owned(), names: presented.clone() }
        }
        other => BadCertificate::Other(other.to_string()),
    })
}

/// The first error of TLS in a chain, or else the last of all.
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
        // A bad signature: another CA of the same name, such as two runs of `evogait certs init` make.
        Tls::InvalidCertificate(CertificateError::UnknownIssuer | CertificateError::BadSignature) => {
            "its certificate was not signed by the CA that --ca names".to_owned()
        }
        Tls::InvalidCertificate(CertificateError::Expired | CertificateError::ExpiredContext { .. }) => {
            "its certificate has expired: renew it, such as with `evogait certs renew`".to_owned()
        }
        Tls::InvalidCertificate(CertificateError::NotValidForNameContext { expected, presented }) => format!(
            "its certificate is not for {}, but for {}: dial one of these, or make one with `evogait certs init --host`",
            expected.to_str(),
            if presented.is_empty() { "no name".to_owned() } else { presented.join(", ") }
        ),
        Tls::AlertReceived(AlertDescription::CertificateRequired) => {
            "it requires a client certificate: give --cert FILE and --key FILE".to_owned()
        }
        Tls::AlertReceived(AlertDescription::UnknownCA | AlertDescription::DecryptError) => {
            "it does not accept the CA of the certificate that --cert names".to_owned()
        }
        Tls::AlertReceived(AlertDescription::CertificateExpired) => {
            "the certificate that --cert names has expired: renew it, such as with `evogait certs renew`".to_owned()
        }
        Tls::InvalidMessage(_) => "it does not speak TLS: write http:// if it runs without".to_owned(),
        other => other.to_string(),
    }
}
