//! Why a connection failed, in words that say what to do.

use rustls::{AlertDescription, CertificateError, Error as Tls};
use std::error::Error;
use std::io;

/// What the other side may find wrong with our certificate. In TLS 1.3 it says so when for us the connection stands already.
const ALERTS: [AlertDescription; 4] = [
    AlertDescription::CertificateRequired,
    AlertDescription::UnknownCA,
    AlertDescription::DecryptError,
    AlertDescription::CertificateExpired,
];

/// The cause at the bottom of an error's chain, which is the one that helps: "connection refused" rather than
/// "transport error".
pub fn reason(error: &(dyn Error + 'static)) -> String {
    let mut cause = error;
    loop {
        let wrapped = cause.downcast_ref::<io::Error>().and_then(|io| io.get_ref());
        if let Some(tls) = cause.downcast_ref::<Tls>().or_else(|| wrapped?.downcast_ref()) {
            return of_tls(tls);
        }
        match cause.source() {
            Some(source) => cause = source,
            None => break,
        }
    }
    let text = cause.to_string();
    // Once a connection stands, HTTP/2 keeps of an error only what it says.
    if let Some(alert) = ALERTS.map(Tls::AlertReceived).iter().find(|alert| alert.to_string() == text) {
        return of_tls(alert);
    }
    text.find(" (os error").map_or(text.clone(), |end| text[..end].to_owned())
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
            "it asks for a client certificate: give --cert FILE and --key FILE".to_owned()
        }
        Tls::AlertReceived(AlertDescription::UnknownCA | AlertDescription::DecryptError) => {
            "it does not believe the CA of the certificate that --cert names".to_owned()
        }
        Tls::AlertReceived(AlertDescription::CertificateExpired) => {
            "the certificate that --cert names has expired: renew it, such as with `evogait certs renew`".to_owned()
        }
        Tls::InvalidMessage(_) => "it does not speak TLS: write http:// if it runs without".to_owned(),
        other => other.to_string(),
    }
}
