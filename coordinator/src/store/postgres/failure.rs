//! Conversion of PostgreSQL errors to store errors, with advice for the operator.

use super::super::StoreError;
use proto::dial::{BadCertificate, bad_certificate};

/// Message of the driver if the server does not support TLS.
const NO_TLS: &str = "server does not support TLS";

/// Converts an error. Codes: https://www.postgresql.org/docs/current/errcodes-appendix.html
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
        sqlx::Error::PoolTimedOut => return unreachable("no connection became free in time".to_owned()),
        sqlx::Error::Protocol(reason) => return unreachable(reason),
        sqlx::Error::Tls(reason) if reason.to_string() == NO_TLS => {
            let reason = "the database does not encrypt connections: set ssl = on in its configuration, or remove \
                          sslmode from --store if it runs on this machine";
            return StoreError::Open { store, reason: reason.to_owned() };
        }
        sqlx::Error::Tls(reason) => return StoreError::Open { store, reason: format!("TLS failed: {reason}") },
        sqlx::Error::Configuration(reason) => return StoreError::Open { store, reason: reason.to_string() },
        error => return StoreError::Database(error.to_string()),
    };
    let open =
        |advice: &str| StoreError::Open { store: store.clone(), reason: format!("{}: {advice}", database.message()) };
    let code = database.code().unwrap_or_default();
    match &*code {
        "3D000" => open("create it with createdb"),
        "42501" => open("grant the user the CREATE privilege on this database"),
        "25006" => open("this server is a read-only replica: use the primary server in --store"),
        "53100" => StoreError::Full { store },
        // The session was ended by the server or timed out, or there are too many sessions.
        "57P01" | "57P02" | "57P03" | "57P05" | "25P03" | "53300" => unreachable(database.message().to_owned()),
        code if code.starts_with("08") => unreachable(database.message().to_owned()),
        code if code.starts_with("28") && database.message().ends_with("no encryption") => {
            open("add ?sslmode=verify-full to --store")
        }
        code if code.starts_with("28") => open("check the user and the password"),
        _ => StoreError::Database(database.message().to_owned()),
    }
}

/// Returns the fault of the database's certificate, with advice.
fn of_certificate(problem: BadCertificate) -> String {
    match problem {
        BadCertificate::UnknownIssuer => {
            "the database's certificate was not signed by a trusted CA: give the certificate of its CA \
             with ?sslmode=verify-full&sslrootcert=FILE"
                .to_owned()
        }
        BadCertificate::Expired => "the database's certificate has expired: renew it on the database server".to_owned(),
        BadCertificate::OtherName { dialed, names } => format!(
            "the database's certificate is not for {dialed}, but for {}: use one of these names in --store, or create a certificate for {dialed}",
            if names.is_empty() { "no name".to_owned() } else { names.join(", ") }
        ),
        BadCertificate::Other(problem) => format!("the database's certificate can't be used: {problem}"),
    }
}
