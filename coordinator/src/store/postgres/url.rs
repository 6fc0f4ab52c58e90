//! `postgres://…` URLs: address of a database, and the user.

use sqlx::ConnectOptions as _;
use sqlx::postgres::{PgConnectOptions, PgSslMode};
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// Allowed parameters after the `?`; the database driver would ignore any others.
const PARAMETERS: [&str; 14] = [
    "sslmode",
    "sslrootcert",
    "sslcert",
    "sslkey",
    "host",
    "hostaddr",
    "port",
    "dbname",
    "user",
    "password",
    "application_name",
    "options",
    "ssl-mode",
    "ssl-root-cert",
];

/// URL of a database. It is displayed without the password, in logs and errors alike.
#[derive(Clone, PartialEq, Eq)]
pub struct PostgresUrl {
    /// URL as given, with the password.
    text: String,
    shown: String,
    exposed: bool,
}

/// Text that is not a database URL. The error does not quote the text, which may contain a password.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the postgres URL in --store is invalid ({0}): write postgres://USER@HOST:PORT/DATABASE, with the password in PGPASSWORD or ~/.pgpass"
)]
pub struct BadPostgresUrl(String);

impl PostgresUrl {
    /// Returns the options for the driver.
    pub(in crate::store) fn options(&self) -> Result<PgConnectOptions, BadPostgresUrl> {
        parse(&self.text)
    }

    /// Returns the file with the CA of the database's certificate, if the URL has one.
    pub(super) fn root_certificate(&self) -> Option<PathBuf> {
        let url = parse(&self.text).ok()?.to_url_lossy();
        let given = url.query_pairs().find(|(key, _)| key == "sslrootcert")?.1.into_owned();
        // The driver marks a file by this prefix; without it, the value is the certificate itself.
        given.strip_prefix("file: ").map(PathBuf::from)
    }

    /// Returns true if the connection leaves this machine and the certificate of the database is not verified.
    pub(super) fn is_exposed(&self) -> bool {
        self.exposed
    }
}

fn parse(text: &str) -> Result<PgConnectOptions, BadPostgresUrl> {
    let bad = |reason: &str| BadPostgresUrl(reason.to_owned());
    if !text.starts_with("postgres://") && !text.starts_with("postgresql://") {
        // The driver would replace missing parts with the user's name and database.
        return Err(bad("it does not begin with postgres://"));
    }
    let (place, query) = text.split_once('?').unwrap_or((text, ""));
    for key in query.split('&').filter_map(|pair| pair.split('=').next()).filter(|key| !key.is_empty()) {
        if !PARAMETERS.contains(&key) && !key.starts_with("options[") {
            return Err(bad(&format!("parameter '{key}' is unknown")));
        }
    }
    let database = place.splitn(4, '/').nth(3).unwrap_or_default();
    if database.contains(['@', ':', '/']) {
        return Err(bad("in a password, write %2F for '/', %3F for '?' and %23 for '#'"));
    }
    match text.parse::<PgConnectOptions>() {
        Ok(options) => Ok(options),
        Err(sqlx::Error::Configuration(reason)) => Err(bad(&reason.to_string())),
        Err(_) => Err(bad("it is not a URL")),
    }
}

impl FromStr for PostgresUrl {
    type Err = BadPostgresUrl;

    fn from_str(text: &str) -> Result<Self, BadPostgresUrl> {
        let options = parse(text)?;
        let (user, database) = (options.get_username(), options.get_database().unwrap_or(options.get_username()));
        let (place, local) = match options.get_socket() {
            Some(socket) => (socket.display().to_string(), true),
            None => {
                let host = options.get_host();
                let local = host == "localhost"
                    || host.starts_with('/')
                    || host.parse().is_ok_and(|ip: std::net::IpAddr| ip.is_loopback());
                (format!("{host}:{}", options.get_port()), local)
            }
        };
        let verified = matches!(options.get_ssl_mode(), PgSslMode::VerifyCa | PgSslMode::VerifyFull);
        let shown = format!("postgres://{user}@{place}/{database}");
        Ok(Self { text: text.to_owned(), shown, exposed: !local && !verified })
    }
}

impl fmt::Display for PostgresUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.shown)
    }
}

impl fmt::Debug for PostgresUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.shown)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn password_is_never_shown() {
        for text in [
            "postgres://ann:s3cret@db.example:5433/gaits",
            "postgres://ann@db.example:5433/gaits?password=s3cret",
            "postgresql://db.example:5433/gaits?user=ann&password=s3cret&sslmode=require",
        ] {
            let url: PostgresUrl = text.parse().unwrap();
            assert_eq!(url.to_string(), "postgres://ann@db.example:5433/gaits");
            assert_eq!(format!("{url:?}"), url.to_string());
            assert!(url.is_exposed());
        }
        for wrong in [
            "postgres://ann:s3cret@db.example:port/gaits",
            "postgres://ann:s3cret/@db.example/gaits",
            "postgres://ann:1/s3cret@db.example/gaits",
            "postgres://ann:1#s3cret@db.example/gaits/",
            "postgres://db/gaits?pasword=s3cret",
            "postgres://db/gaits?sslmode=perhaps&password=s3cret",
        ] {
            let refused = wrong.parse::<PostgresUrl>().unwrap_err().to_string();
            assert!(!refused.contains("s3cret"), "{refused}");
        }
    }

    #[test]
    fn unverified_remote_connection_is_exposed() {
        let exposed = |text: &str| text.parse::<PostgresUrl>().unwrap().is_exposed();
        assert!(
            exposed("postgres://ann@db.example/gaits") && exposed("postgres://ann@db.example/gaits?sslmode=require")
        );
        assert!(!exposed("postgres://ann@db.example/gaits?sslmode=verify-full"));
        assert!(!exposed("postgres://ann@127.0.0.1/gaits") && !exposed("postgres://ann@localhost/gaits"));
        assert!(!exposed("postgres://ann@%2Frun%2Fpostgresql/gaits"));
    }

    #[test]
    fn ca_file_is_read_from_the_url() {
        let file = |text: &str| text.parse::<PostgresUrl>().unwrap().root_certificate();
        let named = "postgres://ann@db.example/gaits?sslmode=verify-full&sslrootcert=/etc/evogait/ca.pem";
        assert_eq!(file(named), Some(PathBuf::from("/etc/evogait/ca.pem")));
        assert_eq!(file("postgres://ann@db.example/gaits?sslmode=verify-full"), None);
    }
}
