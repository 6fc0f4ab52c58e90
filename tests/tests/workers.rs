//! Workers that leave, die, panic and get stuck, as processes of their own. `EVOGAIT_FAULT` makes them (worker/src/fault.rs).

use cluster_tests::proxy::{Direction, Proxy};
use cluster_tests::sandbox::{PATIENCE, Process, Sandbox, tiny_job, undisturbed};
use proto::v1::{CancelJobRequest, Job, JobState, ListWorkersRequest};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A job without a finish on the lockstep engine: what it costs is what a fault makes it cost.
fn cheap_job(seed: u32, generations: u32) -> String {
    let job = tiny_job(seed, generations).replace("\"rapier\"", "\"lockstep\"");
    format!("{}[finish]\nkind = \"none\"\n", job.split("[finish]").next().expect("a job has text"))
}

fn faulty(sandbox: &Sandbox, slots: u32, fault: &str) -> Command {
    let mut command = sandbox.worker_command(&sandbox.url(), slots);
    command.env("EVOGAIT_FAULT", fault);
    command
}

/// Waits until work was handed out, and a moment longer: so that it runs.
async fn busy(sandbox: &Sandbox, slots: u32) {
    let start = Instant::now();
    loop {
        let workers = sandbox.client().list_workers(ListWorkersRequest {}).await.expect("a list").into_inner().workers;
        if workers.iter().any(|w| w.busy >= slots) {
            return tokio::time::sleep(Duration::from_millis(100)).await;
        }
        assert!(start.elapsed() < PATIENCE, "nothing was handed out: {workers:?}");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

/// Waits until a job's search has begun.
async fn prepared(sandbox: &Sandbox, job: &Job) {
    sandbox.until(&job.id, |job| job.rounds_sealed > 0).await;
}

/// Waits for a job's end, which need be no success.
async fn ended(sandbox: &Sandbox, id: &str) -> Job {
    let start = Instant::now();
    loop {
        let job = sandbox.job(id).await;
        if matches!(job.state(), JobState::Failed | JobState::Succeeded | JobState::Cancelled) {
            return job;
        }
        assert!(start.elapsed() < PATIENCE, "waited too long: {job:?}");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

#[tokio::test]
async fn draining_worker_finishes_and_takes_nothing_new() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let job = sandbox.submit("r", &cheap_job(20, 4)).await;
    let leaves = Process::start(faulty(&sandbox, 1, "slow@ms=300").args(["--grace", "60"]));
    prepared(&sandbox, &job).await;
    busy(&sandbox, 1).await;
    let done = |job: &Job| (job.rounds_sealed, job.tasks_done);
    let before = done(&sandbox.job(&job.id).await);
    let start = Instant::now();
    assert_eq!(leaves.terminate(), Some(0));
    let took = start.elapsed();
    let after = done(&sandbox.job(&job.id).await);
    assert!(after > before, "what ran was finished: {before:?} {after:?}");
    assert!(after <= (2, 0) && took < Duration::from_secs(10), "it took nothing new: {took:?} {after:?}");

    let _stays = sandbox.worker(1);
    assert_eq!(sandbox.result(&job.id).await.result_digest, undisturbed(&cheap_job(20, 4)).await);
}

#[tokio::test]
async fn unheard_drain_takes_nothing_new_either() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let network = Proxy::to(&sandbox.url());
    let mut leaves = sandbox.worker_command(&network.url(), 8);
    let mut leaves = Process::start(leaves.args(["--grace", "60"]).env("EVOGAIT_FAULT", "slow@ms=1500"));
    let begun = sandbox.submit("begun", &cheap_job(24, 1)).await;
    prepared(&sandbox, &begun).await;
    busy(&sandbox, 1).await;
    let held = sandbox.client().list_workers(ListWorkersRequest {}).await.expect("a list").into_inner().workers[0].busy;

    network.block(Direction::Up, true);
    leaves.signal("TERM");
    tokio::time::sleep(Duration::from_millis(100)).await;
    let new = sandbox.submit("new", &cheap_job(25, 1)).await;
    busy(&sandbox, held + 1).await;
    network.heal();
    assert_eq!(leaves.wait(), Some(0));
    let (begun, new) = (sandbox.job(&begun.id).await, sandbox.job(&new.id).await);
    assert!((begun.rounds_sealed, begun.tasks_done) > (1, 0), "it finished what it had");
    assert_eq!((new.rounds_sealed, new.tasks_done), (0, 0), "and nothing else");
}

#[tokio::test]
async fn repeated_preemption_costs_no_attempt() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let job = sandbox.submit("r", &cheap_job(21, 2)).await;
    // More often than a candidate may fail. A second signal does not wait for the grace time.
    for round in 0..5 {
        let grace = if round % 2 == 0 { "0.1" } else { "60" };
        let leaves = Process::start(faulty(&sandbox, 1, "slow@ms=60000,round=1").args(["--grace", grace]));
        prepared(&sandbox, &job).await;
        busy(&sandbox, 1).await;
        let start = Instant::now();
        if round % 2 == 1 {
            leaves.signal("TERM");
            // Two of the same signal in one moment are one.
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
        assert_eq!(leaves.terminate(), Some(0));
        assert!(start.elapsed() < Duration::from_secs(3), "{:?}", start.elapsed());
    }
    let _stays = sandbox.worker(1);
    assert_eq!(sandbox.result(&job.id).await.result_digest, undisturbed(&cheap_job(21, 2)).await);
}

#[tokio::test]
async fn hangup_drains_worker() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let job = sandbox.submit("r", &cheap_job(26, 2)).await;
    let mut leaves = Process::start(faulty(&sandbox, 1, "slow@ms=60000").args(["--grace", "0.1"]));
    busy(&sandbox, 1).await;
    leaves.signal("HUP");
    assert_eq!(leaves.wait(), Some(0));
    let _stays = sandbox.worker(1);
    assert_eq!(sandbox.result(&job.id).await.result_digest, undisturbed(&cheap_job(26, 2)).await);
}

#[tokio::test]
async fn worker_with_time_limit_leaves_before_its_end() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let job = sandbox.submit("r", &cheap_job(22, 2)).await;
    let start = Instant::now();
    let mut limited = faulty(&sandbox, 1, "slow@ms=60000");
    let mut limited = Process::start(limited.args(["--grace", "0.5", "--time-left", "0:07"]));
    busy(&sandbox, 1).await;
    assert_eq!(limited.wait(), Some(0));
    assert!(start.elapsed() < Duration::from_secs(7), "{:?}", start.elapsed());
    let _stays = sandbox.worker(1);
    sandbox.result(&job.id).await;
}

#[tokio::test]
async fn panic_costs_task_an_attempt_not_worker() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let mut worker = Process::start(&mut faulty(&sandbox, 2, "panic@round=1,index=4"));
    let poisoned = sandbox.submit("r", &cheap_job(23, 2)).await;
    let job = ended(&sandbox, &poisoned.id).await;
    assert_eq!(job.state(), JobState::Failed);
    let said = |words: &str| assert!(job.reason.contains(words), "{}", job.reason);
    said("candidate 4 of generation 0 failed 3 times");
    said("panicked");
    // Its slots are free for others: one without a fifth candidate.
    let other = sandbox.submit("other", &cheap_job(23, 2).replace("particles = 5", "particles = 4")).await;
    assert_eq!(ended(&sandbox, &other.id).await.state(), JobState::Succeeded);
    assert!(!worker.has_ended());
}

#[tokio::test]
async fn task_that_kills_workers_is_named_soon() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let start = || Process::start(faulty(&sandbox, 1, "abort@round=1,index=3").stderr(Stdio::null()));
    let job = sandbox.submit("r", &cheap_job(24, 2)).await;
    let (mut worker, mut deaths) = (start(), 0);
    let ended = loop {
        let job = sandbox.job(&job.id).await;
        if job.state() == JobState::Failed {
            break job;
        }
        if worker.has_ended() {
            deaths += 1;
            assert!(deaths <= 4, "once as part of a range, three times alone: {job:?}");
            worker = start();
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    };
    assert!(ended.reason.contains("candidate 3 of generation 0") && ended.reason.contains("died"), "{}", ended.reason);
}

#[tokio::test]
async fn stuck_slot_is_found_and_replaced() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let mut worker = faulty(&sandbox, 1, "stall@round=1,index=4");
    let mut worker = Process::start(worker.args(["--stuck-after", "1"]));
    let poisoned = sandbox.submit("r", &cheap_job(25, 2)).await;
    let job = ended(&sandbox, &poisoned.id).await;
    assert_eq!(job.state(), JobState::Failed);
    assert!(job.reason.contains("candidate 4 of generation 0") && job.reason.contains("stuck"), "{}", job.reason);
    let other = sandbox.submit("other", &cheap_job(25, 2).replace("particles = 5", "particles = 4")).await;
    assert_eq!(ended(&sandbox, &other.id).await.state(), JobState::Succeeded);
    assert!(!worker.has_ended());
}

#[tokio::test]
async fn slot_stuck_in_cancelled_task_is_replaced() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let mut worker = faulty(&sandbox, 1, "stall@round=1,index=4");
    let mut worker = Process::start(worker.args(["--stuck-after", "3"]));
    let hangs = sandbox.submit("r", &cheap_job(29, 2)).await;
    busy(&sandbox, 1).await;
    tokio::time::sleep(Duration::from_secs(1)).await;
    sandbox.client().cancel_job(CancelJobRequest { id: hangs.id }).await.expect("it ends");
    // Its slot does not hear of it. Others are neither kept waiting for ever nor blamed.
    let other = sandbox.submit("other", &cheap_job(29, 2).replace("particles = 5", "particles = 4")).await;
    assert_eq!(ended(&sandbox, &other.id).await.state(), JobState::Succeeded);
    assert!(!worker.has_ended());
}

#[tokio::test]
async fn worker_with_repeatedly_stuck_slots_exits_with_reason() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let mut command = faulty(&sandbox, 4, "stall@round=1");
    command.args(["--stuck-after", "1", "--grace", "0.1"]).stderr(Stdio::piped());
    let worker = command.spawn().expect("worker starts");
    for seed in [26, 27] {
        sandbox.submit(&seed.to_string(), &cheap_job(seed, 2)).await;
    }
    let output =
        tokio::task::spawn_blocking(move || worker.wait_with_output()).await.expect("a thread").expect("it ends");
    let text = String::from_utf8(output.stderr).expect("messages are text");
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("slots made no progress for 1 s"), "{text}");
}

#[tokio::test]
async fn continued_worker_is_neither_stuck_nor_blamed() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let job = sandbox.submit("r", &cheap_job(28, 2)).await;
    let mut sleeper = faulty(&sandbox, 1, "slow@ms=100");
    let mut sleeper = Process::start(sleeper.args(["--stuck-after", "1"]));
    busy(&sandbox, 1).await;
    // Longer than a lease, and than a slot may be stuck.
    sleeper.signal("STOP");
    tokio::time::sleep(Duration::from_millis(2500)).await;
    sleeper.signal("CONT");
    assert_eq!(sandbox.result(&job.id).await.result_digest, undisturbed(&cheap_job(28, 2)).await);
    assert!(!sleeper.has_ended());
}
