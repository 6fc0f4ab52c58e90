//! Token file: one role and one token per line.
//!
//! ```text
//! # role   token, or sha256: and the token's digest in hexadecimal
//! client   3f1c…
//! worker   sha256:9f86…
//! ```
//!
//! A role may have several tokens, so that a new token can be in use before the old one is removed.

use super::Role;
use proto::credentials::{MAX_FILE, Token, TokenError, read_file};
use sha2::{Digest as _, Sha256};
use std::collections::HashMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tokio::sync::watch;

/// Limit on the tokens in a file.
pub const MAX_TOKENS: usize = 10_000;

/// Roles by token digest. A lookup uses the digest of the token that a caller sends, so its time depends on digests,
/// which do not reveal a token.
pub(super) type Table = HashMap<TokenDigest, Role>;

/// SHA-256 of a token.
pub(super) type TokenDigest = [u8; 32];

/// Current tokens, with notification of changes.
pub(super) type Tokens = watch::Receiver<Arc<Table>>;

pub(super) fn digest(token: &[u8]) -> TokenDigest {
    Sha256::digest(token).into()
}

/// Tokens of a coordinator. They can be reloaded while it runs.
pub struct Access {
    file: PathBuf,
    table: watch::Sender<Arc<Table>>,
}

impl fmt::Debug for Access {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Access({} tokens of {})", self.count(), self.file.display())
    }
}

/// Reason why a token file can't be used. It never contains a token.
#[derive(Debug, thiserror::Error)]
pub enum TokensError {
    /// The file can't be read.
    #[error("can't read the token file {file}: {reason}", file = .file.display())]
    Read {
        /// Path of the file.
        file: PathBuf,
        /// Message of the system, or the fault.
        reason: String,
    },
    /// A line is not a role and a token.
    #[error(
        "{file}, line {line}: {reason}; write a role (client, worker or admin) and a token, or a role and sha256:DIGEST",
        file = .file.display()
    )]
    Line {
        /// Path of the file.
        file: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// Description of the fault.
        reason: String,
    },
    /// The file has no token, so that no call would be permitted.
    #[error("{file} has no token: write a role (client, worker or admin) and a token per line", file = .file.display())]
    Empty {
        /// Path of the file.
        file: PathBuf,
    },
    /// The file has more than `MAX_TOKENS` tokens.
    #[error(
        "{file} has more than the allowed {MAX_TOKENS} tokens: remove those that are no longer used",
        file = .file.display()
    )]
    TooMany {
        /// Path of the file.
        file: PathBuf,
    },
    /// The text has more than `MAX_FILE` bytes.
    #[error(
        "{file} has {length} bytes: at most {MAX_FILE} are allowed; remove comments and tokens that are no longer used",
        file = .file.display()
    )]
    TooLong {
        /// Path of the file.
        file: PathBuf,
        /// Length of the text, bytes.
        length: usize,
    },
}

impl Access {
    /// Reads the tokens from a file.
    pub fn read(file: &Path) -> Result<Self, TokensError> {
        Ok(Self { file: file.to_owned(), table: watch::Sender::new(Arc::new(table(file)?)) })
    }

    /// Reads the tokens from the text of a file.
    pub fn parse(text: &str) -> Result<Self, TokensError> {
        let file = PathBuf::from("the tokens");
        let table = parse(&file, text)?;
        Ok(Self { file, table: watch::Sender::new(Arc::new(table)) })
    }

    /// Reloads the file and returns the number of its tokens. On an error the tokens stay unchanged. Streams that were
    /// opened with a removed token end.
    pub fn reload(&self) -> Result<usize, TokensError> {
        let table = Arc::new(table(&self.file)?);
        let count = table.len();
        self.table.send_replace(table);
        Ok(count)
    }

    /// Number of tokens.
    pub fn count(&self) -> usize {
        self.table.borrow().len()
    }

    /// Returns the role of a token; `None` for an unknown token.
    pub fn role(&self, token: &[u8]) -> Option<Role> {
        self.role_of(&digest(token))
    }

    pub(super) fn role_of(&self, token: &TokenDigest) -> Option<Role> {
        self.table.borrow().get(token).copied()
    }

    pub(super) fn tokens(&self) -> Tokens {
        self.table.subscribe()
    }
}

fn table(file: &Path) -> Result<Table, TokensError> {
    let unreadable = |reason: String| TokensError::Read { file: file.to_owned(), reason };
    let bytes = read_file(file).map_err(|e| {
        let text = e.to_string();
        unreadable(text.find(" (os error").map_or(text.clone(), |end| text[..end].to_owned()))
    })?;
    let text = String::from_utf8(bytes).map_err(|_| unreadable("it is not text".to_owned()))?;
    parse(file, &text)
}

fn parse(file: &Path, text: &str) -> Result<Table, TokensError> {
    if text.len() > MAX_FILE {
        return Err(TokensError::TooLong { file: file.to_owned(), length: text.len() });
    }
    let mut table = Table::new();
    for (index, content) in text.lines().enumerate() {
        let line = |reason: String| TokensError::Line { file: file.to_owned(), line: index + 1, reason };
        let mut words = content.split_whitespace();
        let role: Role = match words.next() {
            None => continue,
            Some(word) if word.starts_with('#') => continue,
            // The word is not quoted: it may be a token, if both words are in the wrong order.
            Some(word) => word.parse().map_err(|()| line("its first word is not a role".to_owned()))?,
        };
        let (Some(secret), None) = (words.next(), words.next()) else {
            return Err(line("it does not consist of two words".to_owned()));
        };
        let digest = match secret.strip_prefix("sha256:") {
            Some(hex) => {
                from_hex(hex).ok_or_else(|| line("its digest does not have 64 hexadecimal digits".to_owned()))?
            }
            None => {
                let token = Token::parse(secret, "it").map_err(|error| match error {
                    TokenError::Length { length, .. } => {
                        line(format!("its token has {length} characters, 16 to 256 are required"))
                    }
                    _ => line("its token has a character that is not visible ASCII".to_owned()),
                })?;
                Sha256::digest(token.reveal()).into()
            }
        };
        if table.insert(digest, role).is_some_and(|other| other != role) {
            return Err(line("its token has another role on an earlier line".to_owned()));
        }
        if table.len() > MAX_TOKENS {
            return Err(TokensError::TooMany { file: file.to_owned() });
        }
    }
    if table.is_empty() { Err(TokensError::Empty { file: file.to_owned() }) } else { Ok(table) }
}

fn from_hex(text: &str) -> Option<[u8; 32]> {
    let digits = text.as_bytes();
    if digits.len() != 64 {
        return None;
    }
    let digit = |c: u8| (c as char).to_digit(16).map(|d| d as u8);
    let mut bytes = [0; 32];
    for (byte, pair) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
        *byte = digit(pair[0])? << 4 | digit(pair[1])?;
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn role_may_have_several_tokens() {
        let text = "# who\n\nclient  old-token-0123456789\nclient\tnew-token-0123456789\r\n  # sha256 of \"worker-token-0123456\"\n";
        let digest: [u8; 32] = Sha256::digest("worker-token-0123456").into();
        let hex: String = digest.iter().map(|b| format!("{b:02x}")).collect();
        let access = Access::parse(&format!("{text}worker sha256:{hex}\nadmin admin-token-0123456")).unwrap();
        assert_eq!(access.count(), 4);
        assert_eq!(access.role(b"old-token-0123456789"), Some(Role::Client));
        assert_eq!(access.role(b"new-token-0123456789"), Some(Role::Client));
        assert_eq!(access.role(b"worker-token-0123456"), Some(Role::Worker));
        assert_eq!(access.role(b"admin-token-0123456"), Some(Role::Admin));
        for unknown in [b"".as_slice(), b"old-token-012345678", b"old-token-01234567890", hex.as_bytes()] {
            assert_eq!(access.role(unknown), None);
        }
    }

    #[test]
    fn errors_name_the_line_and_never_the_secret() {
        for (text, told) in [
            ("", "has no token"),
            ("# nothing\n", "has no token"),
            ("client", "line 1: it does not consist of two words"),
            ("\nclient secret-token-0123456 more", "line 2: it does not consist of two words"),
            ("secret-token-0123456 client", "its first word is not a role"),
            ("Client secret-token-0123456", "its first word is not a role"),
            ("client secret", "its token has 6 characters"),
            ("client secret-tokén-0123456789", "not visible ASCII"),
            ("client sha256:secret", "64 hexadecimal digits"),
            ("client secret-token-0123456\nworker secret-token-0123456", "line 2: its token has another role"),
        ] {
            let error = Access::parse(text).unwrap_err();
            assert!(error.to_string().contains(told), "{text:?}: {error}");
            assert!(!format!("{error} {error:?}").contains("secret"), "{error}");
        }
    }

    #[test]
    fn text_beyond_limit_is_refused_with_its_length() {
        let said = Access::parse(&"#".repeat(MAX_FILE + 1)).unwrap_err().to_string();
        assert!(said.contains("has 1048577 bytes: at most 1048576 are allowed"), "{said}");
    }

    #[test]
    fn reload_of_malformed_token_file_keeps_the_tokens() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "client old-token-0123456789").unwrap();
        let access = Access::read(file.path()).unwrap();
        std::fs::write(file.path(), "client new-token-0123456789\n").unwrap();
        assert_eq!(access.reload().unwrap(), 1);
        assert_eq!(access.role(b"old-token-0123456789"), None);
        assert_eq!(access.role(b"new-token-0123456789"), Some(Role::Client));
        std::fs::write(file.path(), "client").unwrap();
        assert!(access.reload().is_err());
        assert_eq!(access.role(b"new-token-0123456789"), Some(Role::Client));
        assert!(!format!("{access:?}").contains("new-token"));
    }
}
