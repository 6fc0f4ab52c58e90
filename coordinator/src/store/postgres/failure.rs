//! What an error of PostgreSQL means for whoever runs the coordinator.

use super::super::StoreError;
use proto::dial::{BadCertificate, bad_certificate};

/// What the driver says of a server without TLS.
const NO_TLS: &str = "server does not support TLS";

/// The codes: https://www.postgresql.org/docs/current/errcodes-appendix.html
pub(super) fn failure(store: &str, error: sqlx::Error) -> StoreError {
    let store = store.to_owned();
    let unreachable = |reason: String| StoreError::Unreachable { store: store.clone(), reason };
    let database = match error {
        sqlx::Error::Database(database) => database,
        sqlx::Error::PoolClosed => return StoreError::Closed,
        sqlx::Error::Io(error) => {
            return match bad_certificate(&error) {
                Some(problem) => StoreError::Open { store, reason: of_certificate(problem) },
                None => unreachable(error.to_string()),
            };
        }
        sqlx::Error::PoolTimedOut => return unreachable("there was no connection in time".to_owned()),
        sqlx::Error::Protocol(reason) => return unreachable(reason),
        sqlx::Error::Tls(reason) if reason.to_string() == NO_TLS => {
            let reason = "the database does not encrypt connections: set ssl = on there, or take sslmode out of --store if it \
                          is on this machine";
            return StoreError::Open { store, reason: reason.to_owned() };
        }
        sqlx::Error::Tls(reason) => return StoreError::Open { store, reason: format!("no encryption: {reason}") },
        sqlx::Error::Configuration(reason) => return StoreError::Open { store, reason: reason.to_string() },
        error => return StoreError::Database(error.to_string()),
    };
    let open =
        |advice: &str| StoreError::Open { store: store.clone(), reason: format!("{}: {advice}", database.message()) };
    let code = database.code().unwrap_or_default();
    match &*code {
        "3D000" => open("make it with createdb"),
        "42501" => open("the user needs the right to CREATE in this database"),
        "25006" => open("this is a copy that can only be read: name the server that it copies"),
        "53100" => StoreError::Full { store },
        // The session was ended from outside or timed out, or there are too many.
        "57P01" | "57P02" | "57P03" | "57P05" | "25P03" | "53300" => unreachable(database.message().to_owned()),
        code if code.starts_with("08") => unreachable(database.message().to_owned()),
        code if code.starts_with("28") && database.message().ends_with("no encryption") => {
            open("add ?sslmode=verify-full to --store")
        }
        code if code.starts_with("28") => open("check user and password"),
        _ => StoreError::Database(database.message().to_owned()),
    }
}

/// What to do about the certificate that the database shows.
fn of_certificate(problem: BadCertificate) -> String {
    match problem {
        BadCertificate::UnknownIssuer => {
            "the database's certificate was not signed by a CA that is believed here: give the certificate of the CA that did, \
             with ?sslmode=verify-full&sslrootcert=FILE"
                .to_owned()
        }
        BadCertificate::Expired => "the database's certificate has expired: renew it there".to_owned(),
        BadCertificate::OtherName { dialed, names } => format!(
            "the database's certificate is not for {dialed}, but for {}: write one of these in --store, or make one for {dialed}",
            if names.is_empty() { "no name".to_owned() } else { names.join(", ") }
        ),
        BadCertificate::Other(problem) => format!("the database's certificate can't be used: {problem}"),
    }
}
