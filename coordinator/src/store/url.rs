//! `--store` URLs of stores.

use super::{BadPostgresUrl, PostgresUrl};
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// URL of a store.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StoreUrl {
    /// `sqlite:PATH`: a SQLite file, created if it does not exist.
    Sqlite(PathBuf),
    /// `postgres://USER@HOST:PORT/DATABASE`: a database that several coordinators can reach.
    Postgres(PostgresUrl),
    /// `memory:`: a store in memory, for tests. It is lost when the coordinator exits.
    Memory,
}

/// Text that is not a store URL.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BadStoreUrl {
    /// The scheme is unknown, or the path is missing.
    #[error("'{0}' is not a store URL: write sqlite:PATH, such as sqlite:evogait.db, or postgres://USER@HOST/DATABASE")]
    Unknown(String),
    /// SQLite's own notation for a store that is not a file.
    #[error(
        "'{0}' is not a file: jobs that are not in a file are lost when the coordinator exits: write sqlite:PATH, such as \
         sqlite:evogait.db, without options. If a file has this name, write its folder before it, as in sqlite:./PATH"
    )]
    NoFile(String),
    /// A path with options, as in other programs' URLs.
    #[error("'{0}' has a '?', but sqlite: URLs have no options: write sqlite:PATH, such as sqlite:evogait.db")]
    Options(String),
    /// Invalid URL of a PostgreSQL database.
    #[error(transparent)]
    Postgres(#[from] BadPostgresUrl),
}

impl FromStr for StoreUrl {
    type Err = BadStoreUrl;

    fn from_str(text: &str) -> Result<Self, BadStoreUrl> {
        match text.split_once(':') {
            Some(("sqlite", path)) if !path.is_empty() => {
                // Both `sqlite:///absolute` and `sqlite:path` are in common use.
                let path = path.strip_prefix("//").filter(|p| !p.is_empty()).unwrap_or(path);
                let begins = |with: &str| path.get(..with.len()).is_some_and(|p| p.eq_ignore_ascii_case(with));
                if begins(":memory:") || begins("file:") {
                    return Err(BadStoreUrl::NoFile(text.to_owned()));
                }
                if path.contains('?') {
                    return Err(BadStoreUrl::Options(text.to_owned()));
                }
                Ok(Self::Sqlite(path.into()))
            }
            Some(("postgres" | "postgresql", _)) => Ok(Self::Postgres(text.parse()?)),
            Some(("memory", "")) => Ok(Self::Memory),
            // The rest of a URL with an unknown scheme may contain a password.
            Some((scheme, rest)) if rest.starts_with("//") => Err(BadStoreUrl::Unknown(format!("{scheme}://…"))),
            _ => Err(BadStoreUrl::Unknown(text.to_owned())),
        }
    }
}

impl fmt::Display for StoreUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sqlite(path) => write!(f, "sqlite:{}", path.display()),
            Self::Postgres(url) => url.fmt(f),
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
        let postgres: StoreUrl = "postgres://ann:s3cret@db.example/gaits".parse().unwrap();
        assert_eq!(postgres.to_string(), "postgres://ann@db.example:5432/gaits");
        for wrong in ["", "sqlite:", "evogait.db", "memory:x"] {
            assert_eq!(wrong.parse::<StoreUrl>(), Err(BadStoreUrl::Unknown(wrong.to_owned())));
        }
        for lost in [
            "sqlite::memory:",
            "sqlite://:memory:",
            "sqlite::memory:?cache=shared",
            "sqlite:file::memory:",
            "sqlite:file:a.db?mode=memory",
            "sqlite:FILE:a.db",
        ] {
            assert_eq!(lost.parse::<StoreUrl>(), Err(BadStoreUrl::NoFile(lost.to_owned())));
        }
        for options in ["sqlite:a.db?mode=memory", "sqlite:///a.db?mode=rwc", "sqlite:?"] {
            assert_eq!(options.parse::<StoreUrl>(), Err(BadStoreUrl::Options(options.to_owned())));
        }
        assert_eq!("sqlite:./:memory:".parse(), Ok(StoreUrl::Sqlite("./:memory:".into())));
        for wrong in ["postgres:x", "mysql://ann:s3cret@db/gaits", "postgres://ann:s3cret@db:port/gaits"] {
            let refused = wrong.parse::<StoreUrl>().unwrap_err().to_string();
            assert!(!refused.contains("s3cret"), "{refused}");
        }
    }
}
