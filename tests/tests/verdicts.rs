//! Jobs that are paused, disputed, tainted, failed by a task or restarted, and the output that users see.

use cluster_tests::sandbox::{Sandbox, TIMEOUT, tiny_job, undisturbed};
use cluster_tests::scripted::{Outcome, ScriptedWorker, one_bit_off, task};
use proto::v1::complete_response::Verdict;
use proto::v1::{self, JobState, Results, coordinator_message, dispute};
use sim_core::procedure::evolve::{Task, TaskResult};
use std::time::{Duration, Instant};

/// Waits until a job has ended.
async fn ended(sandbox: &Sandbox, id: &str) -> v1::Job {
    let start = Instant::now();
    loop {
        let job = sandbox.job(id).await;
        if job.ended_at_ms > 0 {
            return job;
        }
        assert!(start.elapsed() < TIMEOUT, "the job did not end in time: {job:?}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

#[tokio::test]
async fn paused_job_survives_kill_and_resumes_to_same_result() {
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let _worker = sandbox.worker(2);
    let text = tiny_job(31, 4);
    let job = sandbox.submit("r", &text).await;
    sandbox.until(&job.id, |job| job.rounds_sealed > 1).await;
    assert!(sandbox.told(&["pause", &job.id]).contains("is paused: tasks that already run may finish"));
    coordinator.kill_9();
    let _coordinator = sandbox.coordinator();
    let paused = sandbox.job(&job.id).await;
    assert!(paused.paused, "an acknowledged pause must survive a crash");
    // Running tasks may complete; after that, the job must not progress.
    tokio::time::sleep(Duration::from_secs(2)).await;
    let before = sandbox.job(&job.id).await;
    tokio::time::sleep(Duration::from_secs(1)).await;
    let after = sandbox.job(&job.id).await;
    assert_eq!((before.rounds_sealed, before.tasks_done), (after.rounds_sealed, after.tasks_done));
    let shown = sandbox.told(&["show", &job.id]);
    assert!(shown.contains(", paused: nothing new is handed out until `evogait resume"), "{shown}");
    assert!(sandbox.told(&["list"]).contains(", paused"));
    sandbox.told(&["pause", &job.id]);
    assert!(sandbox.told(&["resume", &job.id]).contains("is resumed"));
    assert_eq!(sandbox.result(&job.id).await.result_digest, undisturbed(&text).await);

    let refused = sandbox.evogait(&["pause", &job.id]);
    let text = String::from_utf8(refused.stderr).expect("error messages are UTF-8");
    assert!(refused.status.code() == Some(1) && text.contains("has ended (succeeded)"), "{text}");
}

/// Makes a worker return its leases, and waits until the coordinator has processed that. A connection of another worker
/// may be faster.
async fn gives_back(worker: &ScriptedWorker, sandbox: &Sandbox) {
    worker.gives_back();
    let taken = async {
        while !sandbox.told(&["workers"]).contains("draining") {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::time::timeout(TIMEOUT, taken).await.expect("the coordinator processes the drain");
}

/// Lets a worker compute and deliver tasks until `rounds` rounds of the job are sealed.
async fn works_until(worker: &mut ScriptedWorker, sandbox: &Sandbox, id: &str, rounds: u32) {
    while sandbox.job(id).await.rounds_sealed < rounds {
        let assign = worker.receive_lease().await;
        let right = worker.honest(&assign);
        worker.delivers(&assign, right).await;
    }
}

#[tokio::test]
async fn wrong_result_is_corrected_by_a_third_worker() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let text = tiny_job(32, 2);
    let job = sandbox.submit("r", &text).await;
    let mut late = ScriptedWorker::join(&sandbox, "late").await;
    let its = late.receive_lease().await;
    gives_back(&late, &sandbox).await;
    let mut wrong = ScriptedWorker::join(&sandbox, "wrong").await;
    let assign = wrong.receive_lease().await;
    assert_eq!((assign.round, assign.first), (its.round, its.first), "returned tasks must go to the next worker");
    let right = wrong.honest(&assign);
    assert_eq!(wrong.delivers(&assign, one_bit_off(right)).await, Verdict::Accepted);
    let right = late.honest(&its);
    assert_eq!(late.delivers(&its, right).await, Verdict::Conflict);
    let shown = sandbox.told(&["show", &job.id]);
    let what = "the evaluation of candidate 0 of generation 0";
    assert!(shown.contains(&format!("waits for another worker: two results of {what} differ")), "{shown}");
    assert!(shown.contains(&format!("dispute        {what}, open: wrong: ")), "{shown}");

    let _worker = sandbox.worker(2);
    let decided = |job: &v1::Job| job.disputes.iter().any(|d| d.verdict() == dispute::Verdict::Corrected);
    sandbox.until(&job.id, decided).await;
    assert_eq!(sandbox.result(&job.id).await.result_digest, undisturbed(&text).await);
    let told = async {
        loop {
            if let coordinator_message::Message::Drain(drain) = wrong.hears().await {
                return drain.reason;
            }
        }
    };
    let reason = tokio::time::timeout(TIMEOUT, told).await.expect("the worker receives the reason");
    assert!(reason.starts_with(&format!("quarantined: its result of {what}")), "{reason}");

    // A worker that connects under the same id stays quarantined.
    let _again = ScriptedWorker::join(&sandbox, "wrong").await;
    let workers: serde_json::Value =
        serde_json::from_str(&sandbox.told(&["workers", "--json"])).expect("the output is JSON");
    let entry =
        workers.as_array().and_then(|w| w.iter().find(|w| w["id"] == "wrong")).expect("the worker is connected");
    assert_eq!(entry["quarantined"], true, "{entry}");
}

#[tokio::test]
async fn wrong_sealed_result_taints_job_and_restart_repairs_it() {
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let text = tiny_job(33, 3);
    let job = sandbox.submit("r", &text).await;
    let mut late = ScriptedWorker::join(&sandbox, "late").await;
    works_until(&mut late, &sandbox, &job.id, 2).await;
    let its = late.receive_lease().await;
    gives_back(&late, &sandbox).await;
    let mut wrong = ScriptedWorker::join(&sandbox, "wrong").await;
    let assign = wrong.receive_lease().await;
    assert_eq!(
        (assign.round, assign.first),
        (2, its.first),
        "the assignment must be the returned one, of generation 1"
    );
    let right = wrong.honest(&assign);
    assert_eq!(wrong.delivers(&assign, one_bit_off(right)).await, Verdict::Accepted);
    works_until(&mut wrong, &sandbox, &job.id, 3).await;
    let right = late.honest(&its);
    assert_eq!(late.delivers(&its, right).await, Verdict::Conflict);
    drop((wrong, late));
    coordinator.kill_9();
    let _coordinator = sandbox.coordinator();
    let _worker = sandbox.worker(2);
    let tainted = ended(&sandbox, &job.id).await;
    assert_eq!(tainted.state(), JobState::Tainted, "{}", tainted.reason);
    for part in ["of generation 1", "wrong", "evogait restart"] {
        assert!(tainted.reason.contains(part), "{part}: {}", tainted.reason);
    }
    assert!(sandbox.told(&["show", &job.id]).contains(&format!("next           evogait restart {}", job.id)));
    let refused = sandbox.evogait(&["restart", &job.id, "--from-generation", "2"]);
    let why = String::from_utf8(refused.stderr).expect("error messages are UTF-8");
    assert!(!refused.status.success() && why.contains("restart from round 2 or an earlier one"), "{why}");

    let again = sandbox.told(&["restart", &job.id]);
    assert_eq!(sandbox.told(&["restart", &job.id]), again, "a repeated restart must return the same job");
    let again = again.trim();
    let result = sandbox.result(again).await;
    assert_eq!(result.result_digest, undisturbed(&text).await);
    assert_eq!(result.history.len(), 3);
    let shown = sandbox.told(&["show", again]);
    assert!(shown.contains(&format!("repeats        {}", job.id)), "{shown}");
}

#[tokio::test]
async fn wrong_result_sealed_long_ago_taints_job() {
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let text = tiny_job(35, 5);
    let job = sandbox.submit("r", &text).await;
    let mut late = ScriptedWorker::join(&sandbox, "late").await;
    let first = late.receive_lease().await;
    let of_first = late.honest(&first);
    late.delivers(&first, of_first.clone()).await;
    works_until(&mut late, &sandbox, &job.id, 2).await;
    let its = late.receive_lease().await;
    gives_back(&late, &sandbox).await;
    let mut wrong = ScriptedWorker::join(&sandbox, "wrong").await;
    let assign = wrong.receive_lease().await;
    let right = wrong.honest(&assign);
    assert_eq!(wrong.delivers(&assign, one_bit_off(right)).await, Verdict::Accepted);
    works_until(&mut wrong, &sandbox, &job.id, 5).await;

    assert_eq!(late.delivers(&first, of_first).await, Verdict::Duplicate);
    assert!(sandbox.job(&job.id).await.disputes.is_empty());
    let right = late.honest(&its);
    assert_eq!(late.delivers(&its, right.clone()).await, Verdict::NeedsTasks);
    assert!(sandbox.job(&job.id).await.disputes.is_empty(), "no dispute may be stored before the tasks are delivered");
    assert_eq!(late.delivers_with_tasks(&its, right).await, Verdict::Conflict);
    let shown = sandbox.told(&["show", &job.id]);
    assert!(shown.contains("two results of task 0 of round 2 differ"), "{shown}");
    // The dispute was committed before it was acknowledged.
    coordinator.kill_9();
    let _coordinator = sandbox.coordinator();
    assert_eq!(sandbox.job(&job.id).await.disputes.len(), 1);
    drop((wrong, late));
    let _worker = sandbox.worker(2);
    let tainted = ended(&sandbox, &job.id).await;
    assert_eq!(tainted.state(), JobState::Tainted, "{}", tainted.reason);
    assert!(tainted.reason.contains("that was sealed in round 2 is wrong"), "{}", tainted.reason);
    let again = sandbox.told(&["restart", &job.id]);
    assert_eq!(sandbox.result(again.trim()).await.result_digest, undisturbed(&text).await);
}

#[tokio::test]
async fn poisoned_task_fails_job_and_runs_locally() {
    let mut sandbox = Sandbox::new();
    let mut coordinator = sandbox.coordinator();
    let text = tiny_job(34, 2);
    let job = sandbox.submit("r", &text).await;
    let mut poisoned = None;
    let mut fails = ScriptedWorker::join(&sandbox, "w").await;
    for attempt in 0..3 {
        // Failed attempts must survive a crash of the coordinator.
        if attempt == 2 {
            coordinator.kill_9();
            coordinator = sandbox.coordinator();
            fails = ScriptedWorker::join(&sandbox, "v").await;
        }
        let assign = fails.receive_lease().await;
        assert_eq!((assign.first, assign.tasks.len()), (0, 1), "a suspect must be assigned first and alone");
        fails.delivers(&assign, Outcome::Failure("it panicked: simulated by the test".to_owned())).await;
        poisoned = Some(assign);
    }
    let failed = ended(&sandbox, &job.id).await;
    assert_eq!(failed.state(), JobState::Failed);
    assert!(failed.reason.contains("candidate 0 of generation 0 failed 3 times"), "{}", failed.reason);

    let assign = poisoned.expect("the task was assigned");
    let Task::Evaluate { genotype, .. } = task(&assign) else { panic!("the task must be an evaluation") };
    let genotype = genotype.numbers().iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    let shown = sandbox.told(&["show", &job.id]);
    assert!(shown.contains(&format!("genome         {genotype}")), "{shown}");
    assert!(shown.contains(&format!("evogait evaluate {} repeats it on this machine", job.id)), "{shown}");

    let Outcome::Results(Results { results }) = fails.honest(&assign) else { panic!("the outcome must be results") };
    let Ok(TaskResult::Evaluated { score, .. }) = TaskResult::decode(&results[0]) else {
        panic!("the result must be an evaluation")
    };
    let bits = score.map_or("failed".to_owned(), |s| format!("{:016x}", s.to_bits()));
    std::fs::write(sandbox.file("job.toml"), &text).expect("the job file can be written");
    let named = format!("--genome={genotype}");
    for arguments in [vec!["evaluate", &job.id, "--json"], vec!["evaluate", "job.toml", &named, "--json"]] {
        let told: serde_json::Value = serde_json::from_str(&sandbox.told(&arguments)).expect("the output is JSON");
        assert_eq!(told["bits"][0], *bits, "{arguments:?}");
    }
    let refused = sandbox.evogait(&["evaluate", "job.toml", "--genome", "1.0,2.0"]);
    let why = String::from_utf8(refused.stderr).expect("error messages are UTF-8");
    assert!(refused.status.code() == Some(2) && why.contains("the genome has 2 numbers"), "{why}");
    drop(coordinator);
}
