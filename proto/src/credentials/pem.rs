//! Certificates and private keys in PEM files.

use super::{plain, read_file};
use rustls::crypto::ring;
use rustls::pki_types::pem::{self, PemObject as _};
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::sign::CertifiedKey;
use std::fmt;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};
use x509_parser::prelude::{FromDer as _, X509Certificate};

/// Certificates of accepted CAs.
#[derive(Clone, Debug)]
pub struct Authority {
    /// Valid certificates in the type that the transport requires.
    pub certificate: tonic::transport::Certificate,
    /// Earliest last day of the valid certificates: YYYY-MM-DD.
    pub valid_until: String,
}

/// A certificate with its private key.
#[derive(Clone)]
pub struct Identity {
    /// Certificate and key in the type that the transport requires.
    pub identity: tonic::transport::Identity,
    /// Last day of the certificate: YYYY-MM-DD.
    pub valid_until: String,
}

impl fmt::Debug for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Identity(until {})", self.valid_until)
    }
}

/// Invalid or unreadable file of certificates or keys. Not retryable: the user must change a file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PemError {
    /// The file can't be read.
    #[error("can't read {file}: {reason}", file = .file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// The reason.
        reason: String,
    },
    /// File without PEM of the needed kind.
    #[error("{file} holds no {what} in PEM: a line \"-----BEGIN {label}-----\" is required", file = .file.display())]
    NotPem {
        /// The file.
        file: PathBuf,
        /// Needed kind: "certificate" or "private key".
        what: &'static str,
        /// Label in the PEM's first line.
        label: &'static str,
    },
    /// PEM with content that is damaged or of an unsupported kind.
    #[error("{file} can't be used: {reason}", file = .file.display())]
    Unusable {
        /// The file.
        file: PathBuf,
        /// The reason.
        reason: String,
    },
    /// Certificate and key that do not match.
    #[error("{key} is not the key of the certificate in {cert}", key = .key.display(), cert = .cert.display())]
    Mismatch {
        /// The certificate's file.
        cert: PathBuf,
        /// The key's file.
        key: PathBuf,
    },
    /// Expired certificate.
    #[error("the certificate in {file} expired on {day}: renew it, such as with `evogait certs renew`", file = .file.display())]
    Expired {
        /// The file.
        file: PathBuf,
        /// Its last day, YYYY-MM-DD.
        day: String,
    },
    /// Certificate that is not valid yet.
    #[error("the certificate in {file} is not valid before {day}: check this machine's clock", file = .file.display())]
    NotYet {
        /// The file.
        file: PathBuf,
        /// Its first day, YYYY-MM-DD.
        day: String,
    },
    /// Certificate of no CA where a CA's is required.
    #[error("the certificate in {file} is not that of a CA: give the file of the CA that signed the peer's certificate", file = .file.display())]
    NoAuthority {
        /// The file.
        file: PathBuf,
    },
}

/// Sets the process's TLS cryptography provider, also if several are linked in.
pub fn choose_provider() {
    // An error means that a provider was set before.
    let _ = ring::default_provider().install_default();
}

/// Reads one or more CA certificates: with several, an old and a new CA can be accepted at once. Of several, only those
/// valid today are accepted; if none is, the first error is returned.
pub fn authority(file: &Path) -> Result<Authority, PemError> {
    let (text, certificates) = certificates(file)?;
    let text = String::from_utf8_lossy(&text);
    let (mut believed, mut first_end, mut not_valid) = (String::new(), None, None);
    for (der, pem) in certificates.iter().zip(blocks(&text)) {
        let certificate = parse(file, der)?;
        if !certificate.is_ca() {
            return Err(PemError::NoAuthority { file: file.to_owned() });
        }
        match valid_until(file, &certificate) {
            Ok(day) => {
                believed += pem;
                believed += "\n";
                first_end = Some(first_end.map_or(day.clone(), |first: String| first.min(day)));
            }
            Err(error) => not_valid = not_valid.or(Some(error)),
        }
    }
    match (first_end, not_valid) {
        (Some(valid_until), _) => {
            Ok(Authority { certificate: tonic::transport::Certificate::from_pem(believed), valid_until })
        }
        (None, Some(error)) => Err(error),
        (None, None) => Err(PemError::NotPem { file: file.to_owned(), what: "certificate", label: "CERTIFICATE" }),
    }
}

/// Returns the PEM blocks of the certificates in a text.
fn blocks(text: &str) -> impl Iterator<Item = &str> {
    const BEGIN: &str = "-----BEGIN CERTIFICATE-----";
    const END: &str = "-----END CERTIFICATE-----";
    text.split_inclusive(END).filter_map(|part| part.find(BEGIN).filter(|_| part.ends_with(END)).map(|at| &part[at..]))
}

/// Reads a certificate, with intermediate certificates if there are any, and its private key.
pub fn identity(cert: &Path, key: &Path) -> Result<Identity, PemError> {
    let (text, chain) = certificates(cert)?;
    let valid_until = valid_until(cert, &parse(cert, &chain[0])?)?;
    let key_text = read(key)?;
    let der = PrivateKeyDer::from_pem_slice(&key_text).map_err(|error| match error {
        pem::Error::NoItemsFound => {
            PemError::NotPem { file: key.to_owned(), what: "private key", label: "PRIVATE KEY" }
        }
        error => PemError::Unusable { file: key.to_owned(), reason: error.to_string() },
    })?;
    CertifiedKey::from_der(chain, der, &ring::default_provider()).map_err(|error| match error {
        rustls::Error::InconsistentKeys(_) => PemError::Mismatch { cert: cert.to_owned(), key: key.to_owned() },
        error => PemError::Unusable { file: key.to_owned(), reason: error.to_string() },
    })?;
    Ok(Identity { identity: tonic::transport::Identity::from_pem(text, key_text), valid_until })
}

fn read(file: &Path) -> Result<Vec<u8>, PemError> {
    read_file(file).map_err(|e| PemError::Read { file: file.to_owned(), reason: plain(&e) })
}

/// Returns the file's text and its certificates, at least one.
fn certificates(file: &Path) -> Result<(Vec<u8>, Vec<CertificateDer<'static>>), PemError> {
    let text = read(file)?;
    let found: Result<Vec<_>, _> = CertificateDer::pem_slice_iter(&text).collect();
    match found {
        Ok(found) if found.is_empty() => {
            Err(PemError::NotPem { file: file.to_owned(), what: "certificate", label: "CERTIFICATE" })
        }
        Ok(found) => Ok((text, found)),
        Err(error) => Err(PemError::Unusable { file: file.to_owned(), reason: error.to_string() }),
    }
}

fn parse<'a>(file: &Path, der: &'a CertificateDer<'_>) -> Result<X509Certificate<'a>, PemError> {
    match X509Certificate::from_der(der) {
        Ok((_, certificate)) => Ok(certificate),
        Err(error) => {
            let reason = format!("its certificate is damaged ({error})");
            Err(PemError::Unusable { file: file.to_owned(), reason })
        }
    }
}

/// Returns the certificate's last day, if it is valid today.
fn valid_until(file: &Path, certificate: &X509Certificate<'_>) -> Result<String, PemError> {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs() as i64;
    let validity = certificate.validity();
    let (from, to) = (validity.not_before, validity.not_after);
    if now < from.timestamp() {
        return Err(PemError::NotYet { file: file.to_owned(), day: from.to_datetime().date().to_string() });
    }
    let day = to.to_datetime().date().to_string();
    if now > to.timestamp() {
        return Err(PemError::Expired { file: file.to_owned(), day });
    }
    Ok(day)
}
