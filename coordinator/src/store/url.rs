//! `--store`: which store, as text.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// Names a store.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StoreUrl {
    /// `sqlite:PATH`: a SQLite file, made if it is not there.
    Sqlite(PathBuf),
    /// `memory:`: forgotten when the coordinator ends. For tests.
    Memory,
}

/// A text that names no store.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' names no store: write sqlite:PATH, such as sqlite:evogait.db")]
pub struct BadStoreUrl(pub String);

impl FromStr for StoreUrl {
    type Err = BadStoreUrl;

    fn from_str(text: &str) -> Result<Self, BadStoreUrl> {
        match text.split_once(':') {
            Some(("sqlite", path)) if !path.is_empty() => {
                // `sqlite:///absolute` and `sqlite:path` both are in use.
                Ok(Self::Sqlite(path.strip_prefix("//").filter(|p| !p.is_empty()).unwrap_or(path).into()))
            }
            Some(("memory", "")) => Ok(Self::Memory),
            _ => Err(BadStoreUrl(text.to_owned())),
        }
    }
}

impl fmt::Display for StoreUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sqlite(path) => write!(f, "sqlite:{}", path.display()),
            Self::Memory => f.write_str("memory:"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn urls_name_stores() {
        assert_eq!("sqlite:a/b.db".parse(), Ok(StoreUrl::Sqlite("a/b.db".into())));
        assert_eq!("sqlite:/a.db".parse(), Ok(StoreUrl::Sqlite("/a.db".into())));
        assert_eq!("sqlite:///a.db".parse(), Ok(StoreUrl::Sqlite("/a.db".into())));
        assert_eq!("memory:".parse(), Ok(StoreUrl::Memory));
        for wrong in ["", "sqlite:", "evogait.db", "postgres://x", "memory:x"] {
            assert_eq!(wrong.parse::<StoreUrl>(), Err(BadStoreUrl(wrong.to_owned())));
        }
    }
}
