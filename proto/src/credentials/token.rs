//! Bearer tokens: secrets that give their holder a role.

use super::{plain, read_file};
use std::ffi::OsString;
use std::fmt;
use std::path::{Path, PathBuf};

/// Shortest token, in bytes: shorter ones can be guessed.
pub const MIN_TOKEN: usize = 16;
/// Longest token, in bytes.
pub const MAX_TOKEN: usize = 256;

/// Token of `MIN_TOKEN` to `MAX_TOKEN` visible ASCII characters. Never printed: its `Debug` hides it.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

/// Invalid token. The error never contains the token.
#[derive(Debug, thiserror::Error)]
pub enum TokenError {
    /// The file can't be read.
    #[error("can't read the token file {file}: {reason}", file = .file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Reason, such as "No such file or directory".
        reason: String,
    },
    /// Token that is too short or too long.
    #[error("the token in {place} has {length} characters: {MIN_TOKEN} to {MAX_TOKEN} are allowed")]
    Length {
        /// File or variable.
        place: String,
        /// Number of characters.
        length: usize,
    },
    /// Token with a character that a header can't carry.
    #[error(
        "the token in {place} has a character that is not visible ASCII: create a new token, such as with `openssl rand -hex 32`"
    )]
    Character {
        /// File or variable.
        place: String,
    },
}

impl Token {
    /// Checks a token. `place` is the file or variable that the error names.
    pub fn parse(text: &str, place: &str) -> Result<Self, TokenError> {
        let place = || place.to_owned();
        if !text.bytes().all(|b| b.is_ascii_graphic()) {
            return Err(TokenError::Character { place: place() });
        }
        if !(MIN_TOKEN..=MAX_TOKEN).contains(&text.len()) {
            return Err(TokenError::Length { place: place(), length: text.len() });
        }
        Ok(Self(text.to_owned()))
    }

    /// Creates a token of 256 random bits.
    ///
    /// # Panics
    /// Panics if the system provides no random numbers.
    pub fn random() -> Self {
        let mut bytes = [0; 32];
        let provider = rustls::crypto::ring::default_provider();
        provider.secure_random.fill(&mut bytes).expect("the system provides random numbers");
        Self(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
    }

    /// Reads a token from the first line of a file.
    pub fn read(path: &Path) -> Result<Self, TokenError> {
        let unreadable = |reason| TokenError::Read { file: path.to_owned(), reason };
        let bytes = read_file(path).map_err(|e| unreadable(plain(&e)))?;
        let text = String::from_utf8(bytes).map_err(|_| unreadable("it is not text".to_owned()))?;
        Self::parse(text.lines().next().unwrap_or_default().trim(), &path.display().to_string())
    }

    /// Checks the value of the environment variable.
    pub(super) fn of_variable(value: OsString) -> Result<Self, TokenError> {
        let place = super::TOKEN_VARIABLE;
        let text = value.into_string().map_err(|_| TokenError::Character { place: place.to_owned() })?;
        Self::parse(text.trim(), place)
    }

    /// Returns the secret; use it only for the header.
    pub fn reveal(&self) -> &str {
        &self.0
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(hidden)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn debug_output_and_errors_do_not_contain_token() {
        let secret = "correct-horse-battery-staple";
        assert_eq!(format!("{:?}", Token::parse(secret, "x").unwrap()), "Token(hidden)");
        for wrong in ["short-secret", "correct horse battery staple", "corréct-horse-battery", &"s".repeat(257)] {
            let error = Token::parse(wrong, "FILE").unwrap_err();
            assert!(error.to_string().contains("FILE"), "{error}");
            for said in [error.to_string(), format!("{error:?}")] {
                assert!(!said.contains("secret") && !said.contains("horse") && !said.contains("sss"), "{said}");
            }
        }
    }

    #[test]
    fn token_is_first_line_of_file() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "0123456789abcdef\r\nsecond line\n").unwrap();
        assert_eq!(Token::read(file.path()).unwrap().reveal(), "0123456789abcdef");
        std::fs::write(file.path(), "").unwrap();
        assert!(matches!(Token::read(file.path()), Err(TokenError::Length { length: 0, .. })));
        let missing = Token::read(Path::new("no/such/file")).unwrap_err().to_string();
        assert_eq!(missing, "can't read the token file no/such/file: No such file or directory");
    }
}
