//! Tests of the actor: group commits, and replies during a flood of heartbeats.

use super::*;
use crate::scheduler::tests::{ENGINE, greeting, new_job, result_of};
use crate::scheduler::{Caller, Delivery, Range, Settings};
use crate::store::{MemoryStore, SqliteStore};
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};

/// Worker that completes all its tasks at once and delivers all results before it reads more messages.
struct Burst {
    commands: mpsc::Sender<Command>,
    inbox: mpsc::UnboundedReceiver<v1::CoordinatorMessage>,
    delivered: usize,
}

impl Burst {
    async fn deliver_until(&mut self, enough: usize) {
        while self.delivered < enough {
            let mut messages = Vec::new();
            self.inbox.recv_many(&mut messages, 10_000).await;
            let mut replies = Vec::new();
            for completed in messages.into_iter().filter_map(completed) {
                let (reply, answer) = oneshot::channel();
                self.commands.send(Command::Complete { completed, reply }).await.unwrap();
                replies.push(answer);
            }
            for answer in replies {
                assert_eq!(answer.await.unwrap(), Ok(Verdict::Accepted));
                self.delivered += 1;
            }
        }
    }
}

fn completed(message: v1::CoordinatorMessage) -> Option<Completed> {
    let Some(coordinator_message::Message::Assign(assign)) = message.message else { return None };
    let results = assign.tasks.iter().map(|task| result_of(task).into()).collect();
    Some(Completed {
        worker: WorkerId("w".into()),
        assignment: AssignmentId(assign.assignment_id),
        job: assign.job_id.as_str().into(),
        engine: ENGINE,
        range: Range { round: assign.round, first: assign.first, count: assign.tasks.len() as u32 },
        permit: assign.permit,
        // Long enough that every task is a range of its own.
        compute: Duration::from_secs(60),
        delivery: Delivery::Results(results),
        tasks: Vec::new(),
        caller: Caller::default(),
    })
}

async fn actor(store: Arc<dyn Store>) -> Actor {
    let loaded = store.start().await.unwrap();
    let epoch = loaded.epoch;
    let lease = Duration::from_secs(60);
    let settings = Settings::new(epoch, lease);
    let metrics = Arc::new(Metrics::new());
    Actor {
        scheduler: Scheduler::new(settings, loaded.key, 1, BTreeSet::new()),
        store,
        epoch,
        lease,
        heartbeat: settings.heartbeat(),
        clock: Clock::start(),
        live: Live::default(),
        sessions: HashMap::new(),
        metrics: metrics.clone(),
        journal: Journal::new(epoch, metrics),
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn reply_is_sent_during_flood_of_heartbeats() {
    let actor = actor(Arc::new(MemoryStore::default())).await;
    let (commands, inbox) = mpsc::channel(1024);
    let running = tokio::spawn(actor.run(inbox));
    let (outbox, _messages) = mpsc::unbounded_channel();
    let (reply, connected) = oneshot::channel();
    commands.send(Command::Connect { greeting: greeting("w", 1), outbox, reply }).await.unwrap();
    let session = connected.await.unwrap();
    // The queue never gets empty, since a heartbeat takes longer to handle than to send.
    let (flood, full, ebb) = (commands.clone(), Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
    let (seen_full, ebbs) = (full.clone(), ebb.clone());
    let flooding = std::thread::spawn(move || {
        let heartbeat = || Command::Session {
            worker: WorkerId("w".into()),
            session,
            event: SessionEvent::Heartbeat { running: vec![AssignmentId(7); 10_000], progress: vec![0; 10_000] },
        };
        while !ebbs.load(Ordering::Relaxed) && flood.blocking_send(heartbeat()).is_ok() {
            seen_full.fetch_or(flood.capacity() == 0, Ordering::Relaxed);
        }
    });
    while !full.load(Ordering::Relaxed) {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    let (reply, submitted) = oneshot::channel();
    commands.send(Command::Submit { new: Box::new(new_job("a", 1, 1)), reply }).await.unwrap();
    let answered = tokio::time::timeout(Duration::from_secs(30), submitted).await;
    // Stops the flood, so that a faulty actor ends too.
    ebb.store(true, Ordering::Relaxed);
    commands.send(Command::Stop).await.unwrap();
    assert!(answered.expect("the reply arrives in time").unwrap().is_ok());
    running.await.unwrap().unwrap();
    flooding.join().unwrap();
}

#[tokio::test]
async fn waiting_results_are_committed_together() {
    let folder = tempfile::tempdir().unwrap();
    let store: Arc<dyn Store> = Arc::new(SqliteStore::open(&folder.path().join("s.db")).await.unwrap());
    let actor = actor(store.clone()).await;
    let metrics = actor.metrics.clone();
    let (commands, inbox) = mpsc::channel(1024);
    let running = tokio::spawn(actor.run(inbox));
    let (reply, submitted) = oneshot::channel();
    let new = Box::new(new_job("burst", 500, 4));
    commands.send(Command::Submit { new, reply }).await.unwrap();
    assert!(submitted.await.unwrap().is_ok());
    let (outbox, messages) = mpsc::unbounded_channel();
    let (reply, connected) = oneshot::channel();
    commands.send(Command::Connect { greeting: greeting("w", 200), outbox, reply }).await.unwrap();
    connected.await.unwrap();

    let before = metrics.commits();
    let mut worker = Burst { commands: commands.clone(), inbox: messages, delivered: 0 };
    worker.deliver_until(1000).await;
    let (results, commits) = (worker.delivered as u64, metrics.commits() - before);
    println!("{results} results in {commits} commits");
    assert!(commits > 0 && commits * 20 <= results, "{results} results in {commits} commits");

    commands.send(Command::Stop).await.unwrap();
    running.await.unwrap().unwrap();
    // The store has all results.
    let stored = store.start().await.unwrap().active.remove(0);
    assert_eq!(stored.record.rounds_sealed, 2);
}
