//! Jobs that are paused, doubted, tainted, poisoned and done again, with real programs and what a user sees of it.

use cluster_tests::sandbox::{PATIENCE, Sandbox, tiny_job, undisturbed};
use cluster_tests::scripted::{Scripted, honest, one_bit_off};
use proto::v1::complete_request::Result as Outcome;
use proto::v1::complete_response::Verdict;
use proto::v1::{self, JobState, coordinator_message, dispute};
use sim_core::problem::Job;
use std::time::{Duration, Instant};

fn read(job_toml: &str) -> Job {
    Job::from_toml(job_toml).expect("a valid job")
}

/// Waits until a job has ended.
async fn ended(sandbox: &Sandbox, id: &str) -> v1::Job {
    let start = Instant::now();
    loop {
        let job = sandbox.job(id).await;
        if job.ended_at_ms > 0 {
            return job;
        }
        assert!(start.elapsed() < PATIENCE, "waited too long: {job:?}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

#[tokio::test]
async fn a_paused_job_rests_over_a_kill_and_goes_on_to_the_same_bits() {
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let _worker = sandbox.worker(2);
    let text = tiny_job(31, 4);
    let job = sandbox.submit("r", &text).await;
    sandbox.until(&job.id, |job| job.generations_done >= 1).await;
    assert!(sandbox.told(&["pause", &job.id]).contains("is paused: what runs may finish"));
    coordinator.kill_9();
    let _coordinator = sandbox.coordinator();
    let paused = sandbox.job(&job.id).await;
    assert!(paused.paused, "an acknowledged pause survives");
    // What ran may finish, and then it rests.
    tokio::time::sleep(Duration::from_secs(2)).await;
    let before = sandbox.job(&job.id).await;
    tokio::time::sleep(Duration::from_secs(1)).await;
    let after = sandbox.job(&job.id).await;
    assert_eq!((before.generations_done, before.round_done), (after.generations_done, after.round_done));
    let shown = sandbox.told(&["show", &job.id]);
    assert!(shown.contains(", paused: nothing new is handed out until `evogait resume"), "{shown}");
    assert!(sandbox.told(&["list"]).contains(", paused"));
    sandbox.told(&["pause", &job.id]);
    assert!(sandbox.told(&["resume", &job.id]).contains("goes on"));
    assert_eq!(sandbox.result(&job.id).await.result_digest, undisturbed(&text).await);

    let refused = sandbox.evogait(&["pause", &job.id]);
    let text = String::from_utf8(refused.stderr).expect("messages are text");
    assert!(refused.status.code() == Some(1) && text.contains("has ended (succeeded)"), "{text}");
}

#[tokio::test]
async fn a_wrong_result_is_found_decided_by_a_third_and_leaves_no_trace_in_the_bits() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let text = tiny_job(32, 2);
    let job = sandbox.submit("r", &text).await;
    let parsed = read(&text);
    let mut liar = Scripted::join(&sandbox, "liar").await;
    let (assign, task) = liar.is_given().await;
    let right = honest(&parsed, &task);
    assert_eq!(liar.delivers(&assign, &parsed, one_bit_off(right.clone())).await, Verdict::Accepted);
    assert_eq!(liar.delivers_as("late", &assign, &parsed, right).await, Verdict::Conflict);
    let shown = sandbox.told(&["show", &job.id]);
    assert!(shown.contains("waits for another worker: two results of candidate 0 of generation 0 differ"), "{shown}");
    assert!(shown.contains("dispute        candidate 0 of generation 0, open: liar says"), "{shown}");

    let _worker = sandbox.worker(2);
    let decided = |job: &v1::Job| job.disputes.iter().any(|d| d.verdict() == dispute::Verdict::Corrected);
    sandbox.until(&job.id, decided).await;
    assert_eq!(sandbox.result(&job.id).await.result_digest, undisturbed(&text).await);
    let told = async {
        loop {
            if let coordinator_message::Message::Drain(drain) = liar.hears().await {
                return drain.reason;
            }
        }
    };
    let reason = tokio::time::timeout(PATIENCE, told).await.expect("the liar is told");
    assert!(reason.starts_with("quarantined: its result for candidate 0 of generation 0"), "{reason}");

    // Under the same id it gets nothing any more.
    let _again = Scripted::join(&sandbox, "liar").await;
    let workers: serde_json::Value = serde_json::from_str(&sandbox.told(&["workers", "--json"])).expect("JSON");
    let liar = workers.as_array().and_then(|w| w.iter().find(|w| w["id"] == "liar")).expect("it is connected");
    assert_eq!(liar["quarantined"], true, "{liar}");
}

#[tokio::test]
async fn a_sealed_value_that_loses_taints_the_job_and_a_restart_gives_the_bits_of_an_undisturbed_run() {
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let text = tiny_job(33, 3);
    let job = sandbox.submit("r", &text).await;
    let parsed = read(&text);
    let mut liar = Scripted::join(&sandbox, "liar").await;
    let mut lie = None;
    while sandbox.job(&job.id).await.generations_done < 2 {
        let (assign, task) = liar.is_given().await;
        let right = honest(&parsed, &task);
        if task.generation == 1 && lie.is_none() {
            liar.delivers(&assign, &parsed, one_bit_off(right.clone())).await;
            lie = Some((assign, right));
        } else {
            liar.delivers(&assign, &parsed, right).await;
        }
    }
    let (assign, right) = lie.expect("it lied");
    assert_eq!(liar.delivers_as("late", &assign, &parsed, right).await, Verdict::Conflict);
    drop(liar);
    coordinator.kill_9();
    let _coordinator = sandbox.coordinator();
    let _worker = sandbox.worker(2);
    let tainted = ended(&sandbox, &job.id).await;
    assert_eq!(tainted.state(), JobState::Tainted, "{}", tainted.reason);
    for part in ["of generation 1", "liar", "evogait restart"] {
        assert!(tainted.reason.contains(part), "{part}: {}", tainted.reason);
    }
    assert!(sandbox.told(&["show", &job.id]).contains(&format!("next           evogait restart {}", job.id)));
    let refused = sandbox.evogait(&["restart", &job.id, "--from-generation", "2"]);
    let why = String::from_utf8(refused.stderr).expect("messages are text");
    assert!(!refused.status.success() && why.contains("restart from generation 1 or an earlier one"), "{why}");

    let again = sandbox.told(&["restart", &job.id]);
    assert_eq!(sandbox.told(&["restart", &job.id]), again, "twice is once");
    let again = again.trim();
    let result = sandbox.result(again).await;
    assert_eq!(result.result_digest, undisturbed(&text).await);
    assert_eq!(result.history.len(), 3);
    let shown = sandbox.told(&["show", again]);
    assert!(shown.contains(&format!("does again     {}: generations 0 to 0 were taken over", job.id)), "{shown}");
}

#[tokio::test]
async fn a_wrong_value_of_long_ago_is_found_by_a_late_result_and_taints_the_job() {
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let text = tiny_job(35, 5);
    let job = sandbox.submit("r", &text).await;
    let parsed = read(&text);
    let mut liar = Scripted::join(&sandbox, "liar").await;
    let (mut honestly, mut lie) = (None, None);
    // Of the first generation, by candidate; some score the same in the next.
    let mut before: Vec<v1::Genome> = Vec::new();
    while sandbox.job(&job.id).await.generations_done < 4 {
        let (assign, task) = liar.is_given().await;
        let right = honest(&parsed, &task);
        let Outcome::Evaluate(mut wrong) = right.clone() else { panic!("evaluations") };
        let mut moved = None;
        match task.generation {
            0 => before.extend(task.genomes.iter().cloned()),
            1 if lie.is_none() => {
                let old = before[task.first as usize..].iter().take(task.genomes.len()).cloned().collect();
                let old = honest(&parsed, &v1::EvaluateTask { genomes: old, ..task.clone() });
                let Outcome::Evaluate(old) = old else { panic!("evaluations") };
                moved = old.evaluations.iter().zip(&wrong.evaluations).position(|(a, b)| a.score != b.score);
            }
            _ => {}
        }
        if let Some(at) = moved {
            wrong.evaluations.rotate_left(at);
            let Outcome::Evaluate(mut wrong) = one_bit_off(Outcome::Evaluate(wrong)) else { panic!("evaluations") };
            wrong.evaluations.rotate_right(at);
            liar.delivers(&assign, &parsed, Outcome::Evaluate(wrong)).await;
            lie = Some((assign, right));
        } else {
            liar.delivers(&assign, &parsed, right.clone()).await;
            honestly.get_or_insert((assign, right));
        }
    }
    let (assign, right) = honestly.expect("it was honest once");
    assert_eq!(liar.delivers_as("late", &assign, &parsed, right).await, Verdict::Duplicate);
    assert!(sandbox.job(&job.id).await.disputes.is_empty());
    let (assign, right) = lie.expect("it lied");
    assert_eq!(liar.delivers_as("late", &assign, &parsed, right.clone()).await, Verdict::Conflict);
    let shown = sandbox.told(&["show", &job.id]);
    assert!(shown.contains("of generation 1 differ"), "{shown}");
    // It was committed before it was answered.
    coordinator.kill_9();
    let _coordinator = sandbox.coordinator();
    assert_eq!(sandbox.job(&job.id).await.disputes.len(), 1);
    drop(liar);
    let _worker = sandbox.worker(2);
    let tainted = ended(&sandbox, &job.id).await;
    assert_eq!(tainted.state(), JobState::Tainted, "{}", tainted.reason);
    assert!(tainted.reason.contains("of generation 1 that was sealed in round 1 is wrong"), "{}", tainted.reason);
    let again = sandbox.told(&["restart", &job.id]);
    assert_eq!(sandbox.result(again.trim()).await.result_digest, undisturbed(&text).await);
}

#[tokio::test]
async fn a_poisoned_candidate_ends_its_job_and_is_evaluated_here_with_the_bits_a_worker_would_give() {
    let mut sandbox = Sandbox::new();
    let mut coordinator = sandbox.coordinator();
    let text = tiny_job(34, 2);
    let job = sandbox.submit("r", &text).await;
    let parsed = read(&text);
    let mut poisoned = None;
    let mut fails = Scripted::join(&sandbox, "w").await;
    for attempt in 0..3 {
        // Attempts survive the coordinator.
        if attempt == 2 {
            coordinator.kill_9();
            coordinator = sandbox.coordinator();
            fails = Scripted::join(&sandbox, "v").await;
        }
        let (assign, task) = fails.is_given().await;
        assert_eq!((task.first, task.genomes.len()), (0, 1), "suspects come first, one by one");
        fails.delivers(&assign, &parsed, Outcome::Failure("it panicked: the test says so".to_owned())).await;
        poisoned = Some(task);
    }
    let failed = ended(&sandbox, &job.id).await;
    assert_eq!(failed.state(), JobState::Failed);
    assert!(failed.reason.contains("candidate 0 of generation 0 failed 3 times"), "{}", failed.reason);

    let task = poisoned.expect("it was given");
    let genome = task.genomes[0].values.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    let shown = sandbox.told(&["show", &job.id]);
    assert!(shown.contains(&format!("genome         {genome}")), "{shown}");
    assert!(shown.contains(&format!("evogait evaluate {} does it again here", job.id)), "{shown}");

    let Outcome::Evaluate(right) = honest(&parsed, &task) else { panic!("evaluations") };
    let bits = right.evaluations[0].score.map_or("failed".to_owned(), |s| format!("{:016x}", s.to_bits()));
    std::fs::write(sandbox.file("job.toml"), &text).expect("a file");
    let named = format!("--genome={genome}");
    for arguments in [vec!["evaluate", &job.id, "--json"], vec!["evaluate", "job.toml", &named, "--json"]] {
        let told: serde_json::Value = serde_json::from_str(&sandbox.told(&arguments)).expect("JSON");
        assert_eq!(told["bits"][0], *bits, "{arguments:?}");
    }
    let refused = sandbox.evogait(&["evaluate", "job.toml", "--genome", "1.0,2.0"]);
    let why = String::from_utf8(refused.stderr).expect("messages are text");
    assert!(refused.status.code() == Some(2) && why.contains("the genome has 2 numbers"), "{why}");
    drop(coordinator);
}
