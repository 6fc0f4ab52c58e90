//! Worker processes that drain, crash, panic or get stuck. `EVOGAIT_FAULT` causes the faults (worker/src/fault.rs).

use cluster_tests::proxy::{Direction, Proxy};
use cluster_tests::sandbox::{Process, Sandbox, TIMEOUT, tiny_job, undisturbed};
use proto::v1::{CancelJobRequest, Job, JobState};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Returns a job without a finish on the lockstep engine. It takes hardly longer than the faults make it.
fn cheap_job(seed: u32, generations: u32) -> String {
    let job = tiny_job(seed, generations).replace("\"rapier\"", "\"lockstep\"");
    format!("{}[finish]\nkind = \"none\"\n", job.split("[finish]").next().expect("the job is not empty"))
}

fn faulty(sandbox: &Sandbox, slots: u32, fault: &str) -> Command {
    let mut command = sandbox.worker_command(&sandbox.url(), slots);
    command.env("EVOGAIT_FAULT", fault);
    command
}

/// Waits until a worker has `slots` busy slots, and 100 ms more, so that the tasks run.
async fn busy(sandbox: &Sandbox, slots: u32) {
    let start = Instant::now();
    loop {
        let workers = sandbox.workers().await;
        if workers.iter().any(|w| w.busy >= slots) {
            return tokio::time::sleep(Duration::from_millis(100)).await;
        }
        assert!(start.elapsed() < TIMEOUT, "no worker has enough busy slots: {workers:?}");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

/// Waits until a job's search has begun.
async fn prepared(sandbox: &Sandbox, job: &Job) {
    sandbox.until(&job.id, |job| job.rounds_sealed > 0).await;
}

/// Waits until a job has ended in any state.
async fn ended(sandbox: &Sandbox, id: &str) -> Job {
    let start = Instant::now();
    loop {
        let job = sandbox.job(id).await;
        if matches!(job.state(), JobState::Failed | JobState::Succeeded | JobState::Cancelled) {
            return job;
        }
        assert!(start.elapsed() < TIMEOUT, "the job did not end in time: {job:?}");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
}

#[tokio::test]
async fn draining_worker_finishes_and_takes_no_new_tasks() {
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
    assert!(after > before, "running tasks must complete: {before:?} {after:?}");
    assert!(after <= (2, 0) && took < Duration::from_secs(10), "no new task may start: {took:?} {after:?}");

    let _stays = sandbox.worker(1);
    assert_eq!(sandbox.result(&job.id).await.result_digest, undisturbed(&cheap_job(20, 4)).await);
}

#[tokio::test]
async fn draining_worker_behind_blocked_network_takes_no_new_tasks() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let network = Proxy::to(&sandbox.url());
    let mut leaves = sandbox.worker_command(&network.url(), 8);
    let mut leaves = Process::start(leaves.args(["--grace", "60"]).env("EVOGAIT_FAULT", "slow@ms=1500"));
    let begun = sandbox.submit("begun", &cheap_job(24, 1)).await;
    prepared(&sandbox, &begun).await;
    busy(&sandbox, 1).await;
    let held = sandbox.workers().await[0].busy;

    network.block(Direction::Up, true);
    leaves.signal("TERM");
    tokio::time::sleep(Duration::from_millis(100)).await;
    let new = sandbox.submit("new", &cheap_job(25, 1)).await;
    busy(&sandbox, held + 1).await;
    network.heal();
    assert_eq!(leaves.wait(), Some(0));
    let (begun, new) = (sandbox.job(&begun.id).await, sandbox.job(&new.id).await);
    assert!((begun.rounds_sealed, begun.tasks_done) > (1, 0), "tasks that ran before SIGTERM must complete");
    assert_eq!((new.rounds_sealed, new.tasks_done), (0, 0), "no task that was assigned after SIGTERM may run");
}

#[tokio::test]
async fn repeated_preemption_costs_no_attempt() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let job = sandbox.submit("r", &cheap_job(21, 2)).await;
    // Five times, more often than a task may fail. A second signal ends the grace time at once.
    for round in 0..5 {
        let grace = if round % 2 == 0 { "0.1" } else { "60" };
        let leaves = Process::start(faulty(&sandbox, 1, "slow@ms=60000,round=1").args(["--grace", grace]));
        prepared(&sandbox, &job).await;
        busy(&sandbox, 1).await;
        let start = Instant::now();
        if round % 2 == 1 {
            leaves.signal("TERM");
            // Equal signals that arrive too close together are merged into one.
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
async fn worker_with_time_limit_exits_before_the_limit() {
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
async fn panic_costs_an_attempt_but_not_the_worker() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let mut worker = Process::start(&mut faulty(&sandbox, 2, "panic@round=1,index=4"));
    let poisoned = sandbox.submit("r", &cheap_job(23, 2)).await;
    let job = ended(&sandbox, &poisoned.id).await;
    assert_eq!(job.state(), JobState::Failed);
    let said = |words: &str| assert!(job.reason.contains(words), "{}", job.reason);
    said("candidate 4 of generation 0 failed 3 times");
    said("panicked");
    // The worker's slots are free for another job. That job has no candidate 4, so the fault does not occur.
    let other = sandbox.submit("other", &cheap_job(23, 2).replace("particles = 5", "particles = 4")).await;
    assert_eq!(ended(&sandbox, &other.id).await.state(), JobState::Succeeded);
    assert!(!worker.has_ended());
}

#[tokio::test]
async fn task_that_kills_workers_fails_job_after_four_crashes() {
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
            assert!(deaths <= 4, "at most four crashes: one as part of a range, three alone: {job:?}");
            worker = start();
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    };
    assert!(
        ended.reason.contains("candidate 3 of generation 0") && ended.reason.contains("crashed"),
        "{}",
        ended.reason
    );
}

#[tokio::test]
async fn stuck_slot_is_detected_and_replaced() {
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
    sandbox.client().cancel_job(CancelJobRequest { id: hangs.id }).await.expect("the job can be cancelled");
    // The stuck slot ignores the cancellation. Other jobs must neither wait forever nor be charged.
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
    let worker = command.spawn().expect("the worker starts");
    for seed in [26, 27] {
        sandbox.submit(&seed.to_string(), &cheap_job(seed, 2)).await;
    }
    let output = tokio::task::spawn_blocking(move || worker.wait_with_output())
        .await
        .expect("the thread does not panic")
        .expect("the output can be read");
    let text = String::from_utf8(output.stderr).expect("error messages are UTF-8");
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("slots made no progress for 1 s"), "{text}");
}

#[tokio::test]
async fn continued_worker_is_neither_stuck_nor_charged() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let job = sandbox.submit("r", &cheap_job(28, 2)).await;
    let mut sleeper = faulty(&sandbox, 1, "slow@ms=100");
    let mut sleeper = Process::start(sleeper.args(["--stuck-after", "1"]));
    busy(&sandbox, 1).await;
    // Longer than a lease, and longer than `--stuck-after`.
    sleeper.signal("STOP");
    tokio::time::sleep(Duration::from_millis(2500)).await;
    sleeper.signal("CONT");
    assert_eq!(sandbox.result(&job.id).await.result_digest, undisturbed(&cheap_job(28, 2)).await);
    assert!(!sleeper.has_ended());
}
