//! Tests of a store that several coordinators share. Run by `tests/postgres.sh`.

use super::super::Store;
use super::super::tests::places::{ask_server, new_database};
use super::super::tests::{record, submit};
use super::*;

const LONG: Duration = Duration::from_secs(60);

async fn open(url: &PostgresUrl, takeover: Duration) -> PostgresStore {
    PostgresStore::open(url, takeover).await.expect("the store opens")
}

fn start(store: &PostgresStore) -> impl Future<Output = Result<Loaded, StoreError>> {
    Store::start(store)
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn one_coordinator_is_active_until_lock_release() {
    let (_, url) = new_database("").await;
    let (first, second) = (open(&url, LONG).await, open(&url, LONG).await);
    let epoch = start(&first).await.unwrap().epoch;
    let stamp = async || match start(&second).await {
        Err(StoreError::Active { epoch: by, stamp }) if by == epoch => stamp,
        other => panic!("{other:?}"),
    };
    let before = stamp().await;
    assert_eq!(stamp().await, before, "a refused start must not renew the lock");
    Store::renew(&first, epoch).await.unwrap();
    assert!(stamp().await > before);
    let before = stamp().await;
    Store::commit(&first, epoch, vec![submit(&record(1))]).await.unwrap();
    assert!(stamp().await > before, "a commit renews the lock");

    Store::release(&first, epoch).await.unwrap();
    assert_eq!(start(&second).await.unwrap().epoch, epoch + 1);
    for late in [Store::renew(&first, epoch).await, Store::commit(&first, epoch, vec![]).await] {
        assert!(matches!(late, Err(StoreError::Superseded { .. })), "{late:?}");
    }
    Store::release(&first, epoch).await.unwrap();
    assert!(
        matches!(start(&first).await, Err(StoreError::Active { .. })),
        "a coordinator can't release the lock of another one"
    );
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn silent_coordinator_is_replaced_by_exactly_one() {
    let (_, url) = new_database("").await;
    let takeover = Duration::from_millis(700);
    let silent = open(&url, takeover).await;
    let epoch = start(&silent).await.unwrap().epoch;
    let since = Instant::now();
    let wait = async || {
        let next = open(&url, LONG).await;
        loop {
            match start(&next).await {
                Ok(loaded) => return Some(loaded.epoch),
                Err(StoreError::Active { epoch: by, .. }) if by == epoch => tokio::time::sleep(RETRY).await,
                Err(StoreError::Active { .. }) => return None,
                Err(error) => panic!("{error}"),
            }
        }
    };
    let (a, b, c) = tokio::join!(wait(), wait(), wait());
    let mut epochs: Vec<_> = [a, b, c].into_iter().flatten().collect();
    epochs.sort_unstable();
    assert_eq!(epochs, [epoch + 1]);
    assert!(since.elapsed() >= takeover, "the takeover is too early");
    assert!(since.elapsed() < takeover + Duration::from_secs(3), "{:?}", since.elapsed());
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn repeated_commit_is_applied_once() {
    let (_, url) = new_database("").await;
    let store = open(&url, LONG).await;
    let epoch = start(&store).await.unwrap().epoch;
    for _ in 0..3 {
        // Simulates a lost answer.
        store.commit_as(epoch, 1, &[submit(&record(1))]).await.unwrap();
    }
    assert_eq!(store.jobs(u64::MAX, 10, &[]).await.unwrap(), [record(1)]);
    let skipped = store.commit_as(epoch, 3, &[submit(&record(2))]).await;
    assert!(matches!(skipped, Err(StoreError::Corrupt { .. })), "{skipped:?}");
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn broken_connections_are_replaced_without_loss() {
    let (name, url) = new_database("").await;
    let store = open(&url, LONG).await;
    let epoch = start(&store).await.unwrap().epoch;
    for number in 1..=3 {
        Store::commit(&store, epoch, vec![submit(&record(number))]).await.unwrap();
        store.job_of_request("request 1").await.unwrap();
        let end = format!("SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = '{name}'");
        ask_server("postgres", &end).await;
    }
    Store::renew(&store, epoch).await.unwrap();
    assert_eq!(store.jobs(u64::MAX, 10, &[]).await.unwrap().len(), 3);
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn coordinator_cut_off_in_commit_delays_takeover_briefly() {
    let (_, url) = new_database("").await;
    let takeover = Duration::from_millis(500);
    let cut_off = open(&url, takeover).await;
    let epoch = start(&cut_off).await.unwrap().epoch;
    let mut tx = cut_off.writers.begin().await.unwrap();
    tx.run("UPDATE coordinator SET commits = 1 WHERE epoch = $1", vec![epoch.into()]).await.unwrap();
    tokio::time::sleep(takeover).await;
    let next = open(&url, LONG).await;
    let since = Instant::now();
    assert_eq!(start(&next).await.unwrap().epoch, epoch + 1);
    assert!(since.elapsed() < Duration::from_secs(3), "{:?}", since.elapsed());
    assert!(tx.commit().await.is_err());
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn takeover_without_answer_fails_and_can_be_repeated() {
    let (_, url) = new_database("").await;
    let mut store = open(&url, LONG).await;
    store.prepare_within = LEAST_TIMEOUT;
    let other = open(&url, LONG).await;
    let mut silence = other.writers.begin().await.unwrap();
    silence.run("LOCK TABLE jobs IN ACCESS EXCLUSIVE MODE", vec![]).await.unwrap();
    // More attempts than the store has connections.
    for _ in 0..4 {
        let heard = tokio::time::timeout(LEAST_TIMEOUT * 2, start(&store)).await.expect("the start fails in time");
        assert!(matches!(heard, Err(StoreError::Unreachable { .. })), "{heard:?}");
    }
    silence.rollback().await.unwrap();
    assert_eq!(start(&store).await.unwrap().epoch, 1, "a failed start began no epoch");
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn coordinator_suspended_in_commit_reports_takeover() {
    // On a busy machine the commit may be sent as a whole before the pause: then the attempt is repeated.
    for _ in 0..20 {
        let (name, url) = new_database("").await;
        let store = open(&url, LEAST_TIMEOUT).await;
        let epoch = start(&store).await.unwrap().epoch;
        Store::commit(&store, epoch, vec![]).await.unwrap();
        let mut late = std::pin::pin!(Store::commit(&store, epoch, vec![submit(&record(1))]));
        // The commit begins, and then the process pauses for longer than its time limit.
        let begun = tokio::time::timeout(Duration::ZERO, late.as_mut()).await;
        std::thread::sleep(LEAST_TIMEOUT * 2);
        ask_server(&name, "UPDATE evogait.coordinator SET epoch = epoch + 1, commits = 0").await;
        let found = match begun {
            Ok(through) => through,
            Err(_) => late.await,
        };
        let kept = store.jobs(u64::MAX, 10, &[]).await.unwrap().len();
        if found.is_ok() {
            assert_eq!(kept, 1, "an acknowledged commit is kept");
            continue;
        }
        assert!(
            matches!(found, Err(StoreError::Superseded { own, by }) if (own, by) == (epoch, epoch + 1)),
            "{found:?}"
        );
        assert_eq!(kept, 0);
        return;
    }
    panic!("no attempt paused in the middle of a commit");
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn unusable_store_is_refused_with_reason() {
    let refused = async |url: &PostgresUrl| match PostgresStore::open(url, Duration::ZERO).await {
        Ok(_) => panic!("{url} must be refused"),
        Err(error) => (error.to_string(), error),
    };
    let (name, url) = new_database("").await;
    open(&url, LONG).await;
    ask_server(&name, "UPDATE evogait.schema_version SET version = 99").await;
    let (text, error) = refused(&url).await;
    assert!(matches!(error, StoreError::Foreign { .. }) && text.contains("newer version"), "{text}");

    let (name, url) = new_database("").await;
    ask_server(&name, "CREATE SCHEMA evogait; CREATE TABLE evogait.letters (a INT)").await;
    let (text, error) = refused(&url).await;
    assert!(matches!(error, StoreError::Foreign { .. }) && text.contains("another program"), "{text}");

    let (_, url) = new_database("ENCODING 'LATIN1' LC_COLLATE 'C' LC_CTYPE 'C' TEMPLATE template0").await;
    let (text, error) = refused(&url).await;
    assert!(matches!(error, StoreError::Foreign { .. }) && text.contains("LATIN1"), "{text}");

    let (name, url) = new_database("").await;
    ask_server("postgres", &format!("DROP DATABASE {name}")).await;
    let (text, error) = refused(&url).await;
    assert!(matches!(error, StoreError::Open { .. }) && text.contains("createdb"), "{text}");

    let unreachable: PostgresUrl = "postgres://ann:s3cret@127.0.0.1:1/gaits".parse().unwrap();
    let (text, error) = refused(&unreachable).await;
    assert!(matches!(error, StoreError::Unreachable { .. }) && !text.contains("s3cret"), "{text}");
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn concurrent_starts_on_empty_database_create_one_store() {
    let (_, url) = new_database("").await;
    let (a, b) = tokio::join!(open(&url, Duration::ZERO), open(&url, Duration::ZERO));
    let (a, b) = tokio::join!(start(&a), start(&b));
    let mut epochs = [a.unwrap().epoch, b.unwrap().epoch];
    epochs.sort_unstable();
    assert_eq!(epochs, [1, 2]);
}
