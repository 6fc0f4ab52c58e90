//! Databases on the PostgreSQL server that `tests/with-postgres.sh` starts.

use crate::proxy::Proxy;
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

/// The variable that names the server: a URL with `DATABASE` for the name of a database.
const POSTGRES: &str = "EVOGAIT_TEST_POSTGRES";

fn on_server(database: &str) -> String {
    set(POSTGRES).replace("DATABASE", database)
}

/// What `tests/with-postgres.sh` says.
fn set(variable: &str) -> String {
    std::env::var(variable)
        .unwrap_or_else(|_| panic!("{variable} is not set: these tests are run by tests/postgres.sh"))
}

/// A way to a new database by TLS, without parameters, and the files of two CAs: that of the server's certificate, and
/// another one. The certificate is for localhost and 127.0.0.1, not for 127.0.0.2, where the server listens, too.
pub fn new_database_by_tls() -> (String, String, String) {
    let name = new_name();
    ask(&on_server("postgres"), &format!("CREATE DATABASE {name}"));
    let url = set("EVOGAIT_TEST_POSTGRES_TLS").replace("DATABASE", &name);
    (url, set("EVOGAIT_TEST_POSTGRES_CA"), set("EVOGAIT_TEST_POSTGRES_OTHER_CA"))
}

/// The URL of a new database by TCP.
pub fn new_database_by_tcp() -> String {
    let (url, ..) = new_database_by_tls();
    format!("{url}?sslmode=require")
}

/// A network that can be spoilt on the way to a database, and the URL by that way. `url`: by TCP.
pub fn beyond_a_network(url: &str) -> (Proxy, String) {
    let (before, after) = url.rsplit_once(':').expect("the URL names a port");
    let (port, after) = after.split_once('/').expect("the URL names a database");
    let proxy = Proxy::to(&format!("127.0.0.1:{port}"));
    let beyond = format!("{before}:{}/{after}", proxy.port());
    (proxy, beyond)
}

/// Asks about the server as a whole.
pub fn ask_server(sql: &str) -> String {
    ask(&on_server("postgres"), sql)
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
    let name = new_name();
    ask(&on_server("postgres"), &format!("CREATE DATABASE {name}"));
    on_server(&name)
}

fn new_name() -> String {
    static MADE: AtomicU32 = AtomicU32::new(0);
    format!("cluster_{}_{}", std::process::id(), MADE.fetch_add(1, Ordering::Relaxed))
}
