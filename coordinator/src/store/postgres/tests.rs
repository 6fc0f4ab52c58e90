//! What only a store that several can reach has to hold. Run by `tests/postgres.sh`.

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
async fn one_coordinator_is_at_work_until_it_lets_go() {
    let (_, url) = new_database("").await;
    let (first, second) = (open(&url, LONG).await, open(&url, LONG).await);
    let epoch = start(&first).await.unwrap().epoch;
    let stamp = async || match start(&second).await {
        Err(StoreError::Active { epoch: by, stamp }) if by == epoch => stamp,
        other => panic!("{other:?}"),
    };
    let before = stamp().await;
    assert_eq!(stamp().await, before, "asking is no sign of life");
    Store::renew(&first, epoch).await.unwrap();
    assert!(stamp().await > before);
    let before = stamp().await;
    Store::commit(&first, epoch, vec![submit(&record(1))]).await.unwrap();
    assert!(stamp().await > before, "nor does a busy one have to renew");

    Store::release(&first, epoch).await.unwrap();
    assert_eq!(start(&second).await.unwrap().epoch, epoch + 1);
    for late in [Store::renew(&first, epoch).await, Store::commit(&first, epoch, vec![]).await] {
        assert!(matches!(late, Err(StoreError::Superseded { .. })), "{late:?}");
    }
    Store::release(&first, epoch).await.unwrap();
    assert!(matches!(start(&first).await, Err(StoreError::Active { .. })), "nobody lets go for another");
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn a_coordinator_that_gives_no_sign_of_life_is_replaced_by_exactly_one() {
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
    assert!(since.elapsed() >= takeover, "not before its time");
    assert!(since.elapsed() < takeover + Duration::from_secs(3), "{:?}", since.elapsed());
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn a_commit_is_done_once_however_often_it_is_sent() {
    let (_, url) = new_database("").await;
    let store = open(&url, LONG).await;
    let epoch = start(&store).await.unwrap().epoch;
    for _ in 0..3 {
        // As if the answer had been lost.
        store.commit_as(epoch, 1, &[submit(&record(1))]).await.unwrap();
    }
    assert_eq!(store.jobs(u64::MAX, 10, &[]).await.unwrap(), [record(1)]);
    let skipped = store.commit_as(epoch, 3, &[submit(&record(2))]).await;
    assert!(matches!(skipped, Err(StoreError::Corrupt { .. })), "{skipped:?}");
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn broken_connections_are_made_again_and_lose_nothing() {
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
async fn a_coordinator_that_was_cut_off_in_mid_commit_stops_nobody_for_long() {
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
async fn a_takeover_that_hears_nothing_any_more_is_given_up_and_tried_again() {
    let (_, url) = new_database("").await;
    let mut store = open(&url, LONG).await;
    store.prepare_within = LEAST_PATIENCE;
    let other = open(&url, LONG).await;
    let mut silence = other.writers.begin().await.unwrap();
    silence.run("LOCK TABLE jobs IN ACCESS EXCLUSIVE MODE", vec![]).await.unwrap();
    // More often than it has connections.
    for _ in 0..4 {
        let heard = tokio::time::timeout(LEAST_PATIENCE * 2, start(&store)).await.expect("it is given up");
        assert!(matches!(heard, Err(StoreError::Unreachable { .. })), "{heard:?}");
    }
    silence.rollback().await.unwrap();
    assert_eq!(start(&store).await.unwrap().epoch, 1, "what was given up began no epoch");
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn a_coordinator_that_stood_still_in_mid_commit_knows_that_it_was_replaced() {
    // On a busy machine the server may answer so fast that all of a commit is sent before it stands still: then again.
    for _ in 0..20 {
        let (name, url) = new_database("").await;
        let store = open(&url, LEAST_PATIENCE).await;
        let epoch = start(&store).await.unwrap().epoch;
        Store::commit(&store, epoch, vec![]).await.unwrap();
        let mut late = std::pin::pin!(Store::commit(&store, epoch, vec![submit(&record(1))]));
        // It begins, and then nothing of this process goes on for longer than its patience.
        let begun = tokio::time::timeout(Duration::ZERO, late.as_mut()).await;
        std::thread::sleep(LEAST_PATIENCE * 2);
        ask_server(&name, "UPDATE evogait.coordinator SET epoch = epoch + 1, commits = 0").await;
        let found = match begun {
            Ok(through) => through,
            Err(_) => late.await,
        };
        let kept = store.jobs(u64::MAX, 10, &[]).await.unwrap().len();
        if found.is_ok() {
            assert_eq!(kept, 1, "what is acknowledged is kept");
            continue;
        }
        assert!(
            matches!(found, Err(StoreError::Superseded { own, by }) if (own, by) == (epoch, epoch + 1)),
            "{found:?}"
        );
        assert_eq!(kept, 0);
        return;
    }
    panic!("no commit was caught in its middle");
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn what_can_not_be_a_store_is_refused_with_a_sentence() {
    let refused = async |url: &PostgresUrl| match PostgresStore::open(url, Duration::ZERO).await {
        Ok(_) => panic!("{url} opened"),
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

    let nobody: PostgresUrl = "postgres://ann:s3cret@127.0.0.1:1/gaits".parse().unwrap();
    let (text, error) = refused(&nobody).await;
    assert!(matches!(error, StoreError::Unreachable { .. }) && !text.contains("s3cret"), "{text}");
}

#[tokio::test]
#[ignore = "needs PostgreSQL: tests/postgres.sh"]
async fn two_that_start_on_an_empty_database_at_once_make_one_store() {
    let (_, url) = new_database("").await;
    let (a, b) = tokio::join!(open(&url, Duration::ZERO), open(&url, Duration::ZERO));
    let (a, b) = tokio::join!(start(&a), start(&b));
    let mut epochs = [a.unwrap().epoch, b.unwrap().epoch];
    epochs.sort_unstable();
    assert_eq!(epochs, [1, 2]);
}
