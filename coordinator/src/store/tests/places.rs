//! Places of the stores under test, and their reopening.

use super::*;
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

/// Environment variable with the URL of a PostgreSQL server for test databases; `tests/postgres.sh` sets it.
const POSTGRES: &str = "EVOGAIT_TEST_POSTGRES";

/// Reopens a store, as after a crash.
pub(crate) trait Reopen {
    async fn reopen(self) -> Self;
}

impl Reopen for MemoryStore {
    async fn reopen(self) -> Self {
        self
    }
}

/// SQLite file in its own folder.
pub(crate) struct File {
    store: SqliteStore,
    pub folder: tempfile::TempDir,
}

pub(crate) async fn open_file(path: &Path) -> SqliteStore {
    // The lock of a dropped store is released within a moment.
    for _ in 0..100 {
        match SqliteStore::open(path).await {
            Err(StoreError::InUse { .. }) => tokio::time::sleep(Duration::from_millis(20)).await,
            opened => return opened.expect("the store opens"),
        }
    }
    panic!("the store stays locked");
}

impl File {
    pub async fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        Self { store: open_file(&folder.path().join("s.db")).await, folder }
    }
}

impl Reopen for File {
    async fn reopen(self) -> Self {
        let Self { store, folder } = self;
        drop(store);
        Self { store: open_file(&folder.path().join("s.db")).await, folder }
    }
}

impl std::ops::Deref for File {
    type Target = SqliteStore;
    fn deref(&self) -> &SqliteStore {
        &self.store
    }
}

/// PostgreSQL database of one test. The server stops after the tests.
pub(crate) struct Database {
    store: PostgresStore,
    pub url: PostgresUrl,
}

/// Returns the server's URL with this database.
fn on_server(database: &str) -> PostgresUrl {
    let server = std::env::var(POSTGRES)
        .unwrap_or_else(|_| panic!("{POSTGRES} is not set: run these tests with tests/postgres.sh"));
    server.replace("DATABASE", database).parse().expect("the variable must hold a URL")
}

/// Runs SQL on the server.
pub(crate) async fn ask_server(database: &str, sql: &str) {
    use sqlx::ConnectOptions as _;
    let mut connection = on_server(database).options().unwrap().connect().await.expect("the server answers");
    sqlx::raw_sql(sqlx::AssertSqlSafe(sql)).execute(&mut connection).await.expect("the server runs the SQL");
    sqlx::Connection::close(connection).await.unwrap();
}

/// Creates a database for one test.
pub(crate) async fn new_database(with: &str) -> (String, PostgresUrl) {
    static MADE: AtomicU32 = AtomicU32::new(0);
    let name = format!("store_{}_{}", std::process::id(), MADE.fetch_add(1, Ordering::Relaxed));
    ask_server("postgres", &format!("CREATE DATABASE {name} {with}")).await;
    let url = on_server(&name);
    (name, url)
}

impl Database {
    /// Opens a store with takeover time zero: another coordinator can take over at once.
    pub async fn new() -> Self {
        let (_, url) = new_database("").await;
        Self { store: PostgresStore::open(&url, Duration::ZERO).await.expect("the store opens"), url }
    }
}

impl Reopen for Database {
    async fn reopen(self) -> Self {
        let Self { store, url } = self;
        drop(store);
        Self { store: PostgresStore::open(&url, Duration::ZERO).await.expect("the store opens"), url }
    }
}

impl std::ops::Deref for Database {
    type Target = PostgresStore;
    fn deref(&self) -> &PostgresStore {
        &self.store
    }
}
