//! Credentials of clients, workers and coordinators: certificates, keys and tokens, read from files and checked at
//! start.

mod pem;
mod token;

pub use pem::{Authority, Identity, PemError, authority, choose_provider, identity};
pub use token::{Token, TokenError};

use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};

/// Environment variable with the file of `--ca`.
pub const CA_VARIABLE: &str = "EVOGAIT_CA";
/// Environment variable with the file of `--cert`.
pub const CERT_VARIABLE: &str = "EVOGAIT_CERT";
/// Environment variable with the file of `--key`.
pub const KEY_VARIABLE: &str = "EVOGAIT_KEY";
/// Environment variable with the file of `--token-file`.
pub const TOKEN_FILE_VARIABLE: &str = "EVOGAIT_TOKEN_FILE";
/// Environment variable with the token itself. There is no argument for it, because `ps` shows arguments.
pub const TOKEN_VARIABLE: &str = "EVOGAIT_TOKEN";

/// Largest file of certificates, keys or tokens, in bytes.
pub const MAX_FILE: usize = 1024 * 1024;

/// Sources of a client's or a worker's credentials.
#[derive(Clone, Debug, Default)]
pub struct Sources {
    /// Certificates of CAs that may sign the coordinator's certificate, PEM.
    pub ca: Option<PathBuf>,
    /// Client certificate, PEM.
    pub cert: Option<PathBuf>,
    /// Private key of the client certificate, PEM.
    pub key: Option<PathBuf>,
    /// File with the token in its first line.
    pub token_file: Option<PathBuf>,
}

/// Credentials of a client or a worker, and the CAs that it accepts.
#[derive(Clone, Debug, Default)]
pub struct Credentials {
    /// CAs that may sign the coordinator's certificate.
    pub ca: Option<Authority>,
    /// Client certificate, sent if the coordinator requests one.
    pub identity: Option<Identity>,
    /// Token, sent with every call.
    pub token: Option<Token>,
}

/// Invalid or unreadable credentials. Not retryable: the user must change a file or an option.
#[derive(Debug, thiserror::Error)]
pub enum CredentialError {
    /// Invalid certificate or key.
    #[error(transparent)]
    Pem(#[from] PemError),
    /// Invalid token.
    #[error(transparent)]
    Token(#[from] TokenError),
    /// A certificate without its key, or a key without its certificate.
    #[error("only one of certificate and key is given: give both --cert FILE and --key FILE, or neither")]
    Half,
}

impl Credentials {
    /// Reads the credentials named by `sources`, or else by environment variables, which `environment` looks up.
    pub fn read(sources: Sources, environment: impl Fn(&str) -> Option<OsString>) -> Result<Self, CredentialError> {
        let named = |name: &str| environment(name).filter(|value| !value.is_empty());
        let file = |given: Option<PathBuf>, name: &str| given.or_else(|| named(name).map(PathBuf::from));
        let ca = file(sources.ca, CA_VARIABLE).as_deref().map(authority).transpose()?;
        let identity = match (file(sources.cert, CERT_VARIABLE), file(sources.key, KEY_VARIABLE)) {
            (None, None) => None,
            (Some(cert), Some(key)) => Some(identity(&cert, &key)?),
            _ => return Err(CredentialError::Half),
        };
        let token = match (file(sources.token_file, TOKEN_FILE_VARIABLE), named(TOKEN_VARIABLE)) {
            (Some(path), _) => Some(Token::read(&path)?),
            (None, Some(text)) => Some(Token::of_variable(text)?),
            (None, None) => None,
        };
        Ok(Self { ca, identity, token })
    }

    /// Reads the credentials named by `sources`, or else by this process's environment variables.
    pub fn of_process(sources: Sources) -> Result<Self, CredentialError> {
        Self::read(sources, |name| std::env::var_os(name))
    }
}

/// Reads a file of at most [`MAX_FILE`] bytes.
pub fn read_file(path: &Path) -> io::Result<Vec<u8>> {
    use std::io::Read as _;
    let mut bytes = Vec::new();
    std::fs::File::open(path)?.take(MAX_FILE as u64 + 1).read_to_end(&mut bytes)?;
    if bytes.len() > MAX_FILE {
        return Err(io::Error::other(format!("it is longer than {MAX_FILE} bytes")));
    }
    Ok(bytes)
}

/// Returns the text of an I/O error without its "(os error 2)".
pub(crate) fn plain(error: &io::Error) -> String {
    let text = error.to_string();
    text.find(" (os error").map_or(text.clone(), |end| text[..end].to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn option_precedes_environment_and_file_precedes_text() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, token: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, format!("{token}\n")).unwrap();
            path
        };
        let (given, named) = (file("given", "given-token-0123456789"), file("named", "named-token-0123456789"));
        let read = |token_file: Option<PathBuf>, variables: &[(&str, OsString)]| {
            let sources = Sources { token_file, ..Sources::default() };
            let look_up = |name: &str| variables.iter().find(|(n, _)| *n == name).map(|(_, value)| value.clone());
            Credentials::read(sources, look_up).unwrap().token.map(|token| token.reveal().to_owned())
        };
        let text = (TOKEN_VARIABLE, OsString::from("text-token-0123456789"));
        let path = (TOKEN_FILE_VARIABLE, named.into_os_string());
        assert_eq!(read(None, &[]), None);
        assert_eq!(read(None, &[(TOKEN_VARIABLE, OsString::new())]), None);
        assert_eq!(read(None, std::slice::from_ref(&text)).as_deref(), Some("text-token-0123456789"));
        assert_eq!(read(None, &[text.clone(), path.clone()]).as_deref(), Some("named-token-0123456789"));
        assert_eq!(read(Some(given), &[text, path]).as_deref(), Some("given-token-0123456789"));
    }

    #[test]
    fn certificate_without_key_is_refused() {
        let sources = Sources { cert: Some("a.pem".into()), ..Sources::default() };
        assert!(matches!(Credentials::read(sources, |_| None), Err(CredentialError::Half)));
    }
}
