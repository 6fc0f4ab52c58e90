//! Databases on the PostgreSQL server that `tests/with-postgres.sh` starts.

use crate::proxy::Proxy;
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

/// Environment variable with the server's URL, in which `DATABASE` stands for the name of a database.
const POSTGRES: &str = "EVOGAIT_TEST_POSTGRES";

fn on_server(database: &str) -> String {
    set(POSTGRES).replace("DATABASE", database)
}

/// Returns an environment variable that `tests/with-postgres.sh` sets.
fn set(variable: &str) -> String {
    std::env::var(variable).unwrap_or_else(|_| panic!("{variable} is not set; run these tests with tests/postgres.sh"))
}

/// Creates a database. Returns its TLS URL without parameters, the CA file of the server's certificate, and the file of
/// another CA. The certificate is valid for localhost and 127.0.0.1, but not for 127.0.0.2, where the server also
/// listens.
pub fn new_database_by_tls() -> (String, String, String) {
    let name = new_name();
    ask(&on_server("postgres"), &format!("CREATE DATABASE {name}"));
    let url = set("EVOGAIT_TEST_POSTGRES_TLS").replace("DATABASE", &name);
    (url, set("EVOGAIT_TEST_POSTGRES_CA"), set("EVOGAIT_TEST_POSTGRES_OTHER_CA"))
}

/// Creates a database and returns its TCP URL.
pub fn new_database_by_tcp() -> String {
    let (url, ..) = new_database_by_tls();
    format!("{url}?sslmode=require")
}

/// Returns a proxy to the database, which can disturb the connection, and the URL through the proxy. `url`: a TCP URL.
pub fn beyond_a_network(url: &str) -> (Proxy, String) {
    let (before, after) = url.rsplit_once(':').expect("the URL names a port");
    let (port, after) = after.split_once('/').expect("the URL names a database");
    let proxy = Proxy::to(&format!("127.0.0.1:{port}"));
    let beyond = format!("{before}:{}/{after}", proxy.port());
    (proxy, beyond)
}

/// Runs SQL on the server's own database and returns the output.
pub fn ask_server(sql: &str) -> String {
    ask(&on_server("postgres"), sql)
}

/// Runs SQL on a database and returns the output.
pub fn ask(url: &str, sql: &str) -> String {
    let mut psql = Command::new("psql");
    psql.args(["--no-psqlrc", "--quiet", "--tuples-only", "--no-align", "--command", sql]);
    let output = psql.arg(url).output().expect("psql must be installed (apt-get install postgresql-client)");
    assert!(output.status.success(), "{sql}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("psql prints UTF-8").trim().to_owned()
}

/// Creates a database that no other test uses, and returns its URL.
pub fn new_database() -> String {
    let name = new_name();
    ask(&on_server("postgres"), &format!("CREATE DATABASE {name}"));
    on_server(&name)
}

fn new_name() -> String {
    static MADE: AtomicU32 = AtomicU32::new(0);
    format!("cluster_{}_{}", std::process::id(), MADE.fetch_add(1, Ordering::Relaxed))
}
