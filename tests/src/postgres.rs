//! Databases on the PostgreSQL server that `tests/postgres.sh` starts.

use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

/// The variable that names the server: a URL with `DATABASE` for the name of a database.
const POSTGRES: &str = "EVOGAIT_TEST_POSTGRES";

fn on_server(database: &str) -> String {
    let server = std::env::var(POSTGRES)
        .unwrap_or_else(|_| panic!("{POSTGRES} names no server: these tests are run by tests/postgres.sh"));
    server.replace("DATABASE", database)
}

/// Asks a database, and returns what it answers.
pub fn ask(url: &str, sql: &str) -> String {
    let mut psql = Command::new("psql");
    psql.args(["--no-psqlrc", "--quiet", "--tuples-only", "--no-align", "--command", sql]);
    let output = psql.arg(url).output().expect("psql runs: apt-get install postgresql-client");
    assert!(output.status.success(), "{sql}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("psql answers in text").trim().to_owned()
}

/// The URL of a database that no other test has.
pub fn new_database() -> String {
    static MADE: AtomicU32 = AtomicU32::new(0);
    let name = format!("cluster_{}_{}", std::process::id(), MADE.fetch_add(1, Ordering::Relaxed));
    ask(&on_server("postgres"), &format!("CREATE DATABASE {name}"));
    on_server(&name)
}
