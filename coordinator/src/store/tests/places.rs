//! Where the stores under test are, and how they are opened again.

use super::*;
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

/// The variable that names a PostgreSQL server to make databases on; `tests/postgres.sh` sets it.
const POSTGRES: &str = "EVOGAIT_TEST_POSTGRES";

/// Opens again what was stored, as after a crash.
pub(crate) trait Reopen {
    async fn reopen(self) -> Self;
}

impl Reopen for MemoryStore {
    async fn reopen(self) -> Self {
        self
    }
}

/// A SQLite file in a folder of its own.
pub(crate) struct File {
    store: SqliteStore,
    pub folder: tempfile::TempDir,
}

pub(crate) async fn open_file(path: &Path) -> SqliteStore {
    // The lock of a store that was just dropped is gone within a moment.
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

/// A PostgreSQL database of its own, on a server that ends with the tests.
pub(crate) struct Database {
    store: PostgresStore,
    pub url: PostgresUrl,
}

/// The server's URL, with a database of this name.
fn on_server(database: &str) -> PostgresUrl {
    let server = std::env::var(POSTGRES)
        .unwrap_or_else(|_| panic!("{POSTGRES} names no server: these tests are run by tests/postgres.sh"));
    server.replace("DATABASE", database).parse().expect("the variable holds a URL")
}

/// Asks the server itself.
pub(crate) async fn ask_server(database: &str, sql: &str) {
    use sqlx::ConnectOptions as _;
    let mut connection = on_server(database).options().unwrap().connect().await.expect("the server answers");
    sqlx::raw_sql(sqlx::AssertSqlSafe(sql)).execute(&mut connection).await.expect("the server does as it is told");
    sqlx::Connection::close(connection).await.unwrap();
}

/// Makes a database that no other test has.
pub(crate) async fn new_database(with: &str) -> (String, PostgresUrl) {
    static MADE: AtomicU32 = AtomicU32::new(0);
    let name = format!("store_{}_{}", std::process::id(), MADE.fetch_add(1, Ordering::Relaxed));
    ask_server("postgres", &format!("CREATE DATABASE {name} {with}")).await;
    let url = on_server(&name);
    (name, url)
}

impl Database {
    /// With nobody at work for longer than a moment.
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
