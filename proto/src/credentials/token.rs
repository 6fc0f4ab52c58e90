//! Bearer tokens: secret texts that give their holder a role.

use super::{plain, read_file};
use std::ffi::OsString;
use std::fmt;
use std::path::{Path, PathBuf};

/// Shortest token, in bytes: shorter ones can be guessed.
pub const MIN_TOKEN: usize = 16;
/// Longest token, in bytes.
pub const MAX_TOKEN: usize = 256;

/// A token of `MIN_TOKEN` to `MAX_TOKEN` visible ASCII characters. Never printed: its `Debug` hides it.
#[derive(Clone, PartialEq, Eq)]
pub struct Token(String);

/// Why a text is no token. The text itself is never told.
#[derive(Debug, thiserror::Error)]
pub enum TokenError {
    /// The file can't be read.
    #[error("can't read the token file {file}: {reason}", file = .file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// The reason.
        reason: String,
    },
    /// Too short or too long.
    #[error("the token in {place} has {length} characters: {MIN_TOKEN} to {MAX_TOKEN} are needed")]
    Length {
        /// File or variable.
        place: String,
        /// Length found.
        length: usize,
    },
    /// Something that a header can't carry.
    #[error(
        "the token in {place} has a character that is not visible ASCII: make a new one, such as with `openssl rand -hex 32`"
    )]
    Character {
        /// File or variable.
        place: String,
    },
}

impl Token {
    /// Checks a token; `place` says in the error where it was found.
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

    /// A new one, of 256 random bits.
    ///
    /// # Panics
    /// Where the system gives no random numbers.
    pub fn random() -> Self {
        let mut bytes = [0; 32];
        let provider = rustls::crypto::ring::default_provider();
        provider.secure_random.fill(&mut bytes).expect("the system gives random numbers");
        Self(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
    }

    /// Reads the first line of a file.
    pub fn read(path: &Path) -> Result<Self, TokenError> {
        let unreadable = |reason| TokenError::Read { file: path.to_owned(), reason };
        let bytes = read_file(path).map_err(|e| unreadable(plain(&e)))?;
        let text = String::from_utf8(bytes).map_err(|_| unreadable("it is not text".to_owned()))?;
        Self::parse(text.lines().next().unwrap_or_default().trim(), &path.display().to_string())
    }

    /// Takes what an environment variable holds.
    pub(super) fn of_variable(value: OsString) -> Result<Self, TokenError> {
        let place = super::TOKEN_VARIABLE;
        let text = value.into_string().map_err(|_| TokenError::Character { place: place.to_owned() })?;
        Self::parse(text.trim(), place)
    }

    /// The secret itself, for the header and for nothing else.
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
    fn neither_debug_nor_an_error_tells_a_token() {
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
    fn a_file_s_first_line_is_the_token() {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), "0123456789abcdef\r\nsecond line\n").unwrap();
        assert_eq!(Token::read(file.path()).unwrap().reveal(), "0123456789abcdef");
        std::fs::write(file.path(), "").unwrap();
        assert!(matches!(Token::read(file.path()), Err(TokenError::Length { length: 0, .. })));
        let missing = Token::read(Path::new("no/such/file")).unwrap_err().to_string();
        assert_eq!(missing, "can't read the token file no/such/file: No such file or directory");
    }
}
