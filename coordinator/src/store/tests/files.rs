//! Tests of the SQLite store's file: closed stores, and files that are refused.

use super::places::open_file;
use super::*;
use std::path::Path;

#[tokio::test]
async fn closed_sqlite_store_is_one_complete_file() {
    let file = File::new().await;
    let epoch = file.start().await.unwrap().epoch;
    file.commit(epoch, vec![submit(&record(1))]).await.unwrap();
    let names = || {
        let entries = std::fs::read_dir(file.folder.path()).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    };
    assert_eq!(names(), ["s.db", "s.db-wal"]);
    file.close().await.unwrap();
    assert_eq!(names(), ["s.db"]);
    let copy = file.folder.path().join("copy.db");
    std::fs::copy(file.folder.path().join("s.db"), &copy).unwrap();
    assert_eq!(open_file(&copy).await.jobs(u64::MAX, 10, &[]).await.unwrap(), [record(1)]);
}

#[tokio::test]
async fn unusable_store_is_refused_with_reason() {
    let folder = tempfile::tempdir().unwrap();
    let refused = async |path: &Path| match SqliteStore::open(path).await {
        Ok(_) => panic!("{} must be refused", path.display()),
        Err(error) => (error.to_string(), error),
    };
    let (text, error) = refused(&folder.path().join("none/s.db")).await;
    assert!(matches!(error, StoreError::Open { .. }) && text.contains("there is no folder"), "{text}");
    let (text, error) = refused(folder.path()).await;
    assert!(matches!(error, StoreError::Open { .. }) && text.contains("it is a folder"), "{text}");

    let text_file = folder.path().join("letter.txt");
    std::fs::write(&text_file, "This text is not a database. ".repeat(100)).unwrap();
    let (text, error) = refused(&text_file).await;
    assert!(matches!(error, StoreError::Foreign { .. }), "{text}");

    let used = folder.path().join("used.db");
    let _store = open_file(&used).await;
    let (text, error) = refused(&used).await;
    assert!(matches!(error, StoreError::InUse { .. }) && text.contains("in use by another coordinator"), "{text}");
}

#[tokio::test]
async fn database_of_another_program_or_version_is_refused() {
    use sqlx::ConnectOptions as _;
    let folder = tempfile::tempdir().unwrap();
    for (name, sql, reason) in [
        ("other.db", "CREATE TABLE letters (a)", "another program"),
        (
            "newer.db",
            "CREATE TABLE a (a); PRAGMA application_id = 1702260583; PRAGMA user_version = 99",
            "newer version",
        ),
        (
            "older.db",
            "CREATE TABLE a (a); PRAGMA application_id = 1702260583; PRAGMA user_version = 3",
            "an older version of evogait, which did not store jobs as rounds of tasks",
        ),
    ] {
        let path = folder.path().join(name);
        let options = sqlx::sqlite::SqliteConnectOptions::new().filename(&path).create_if_missing(true);
        let mut connection = options.connect().await.unwrap();
        sqlx::raw_sql(sql).execute(&mut connection).await.unwrap();
        sqlx::Connection::close(connection).await.unwrap();
        let error = SqliteStore::open(&path).await.err().expect("the file is refused").to_string();
        assert!(error.contains(reason), "{error}");
    }
}
