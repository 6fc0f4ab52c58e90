//! Deliveries that can't be results of an issued assignment. Each is refused, does not harm the job, and costs its
//! worker a mark. Three marks, or two different results of one task, quarantine the worker.

use cluster_tests::sandbox::{Sandbox, tiny_job, undisturbed};
use cluster_tests::scripted::{Outcome, ScriptedWorker, one_bit_off, with_first};
use proto::v1::complete_response::Verdict;
use proto::v1::{Assign, CancelJobRequest, CompleteRequest, JobState, Results};
use sim_core::base::score::Counts;
use sim_core::procedure::evolve::TaskResult;
use tonic::{Code, Status};

/// Returns a job with generations large enough for all variations.
fn job(seed: u32) -> String {
    tiny_job(seed, 2).replace("particles = 5", "particles = 8")
}

fn results(outcome: Outcome) -> Vec<Vec<u8>> {
    let Outcome::Results(Results { results }) = outcome else { panic!("the outcome must be results") };
    results
}

fn of(results: Vec<Vec<u8>>) -> Outcome {
    Outcome::Results(Results { results })
}

/// Change of one place of a valid delivery.
type Change = fn(&mut CompleteRequest);

/// Changes the first result.
fn first(request: &mut CompleteRequest, change: impl FnOnce(Vec<u8>) -> Vec<u8>) {
    let outcome = request.outcome.take().expect("the delivery has results");
    request.outcome = Some(with_first(outcome, change));
}

/// Changes the content of the first result.
fn content(request: &mut CompleteRequest, change: impl FnOnce(TaskResult) -> TaskResult) {
    first(request, |result| change(TaskResult::decode(&result).expect("the first result can be decoded")).encode());
}

fn score(request: &mut CompleteRequest, new: f64) {
    content(request, |result| match result {
        TaskResult::Evaluated { genotype, descriptors, counts, .. } => {
            TaskResult::Evaluated { genotype, score: Some(new), descriptors, counts }
        }
        other => other,
    });
}

fn counts(request: &mut CompleteRequest, change: impl FnOnce(&mut Counts)) {
    content(request, |mut result| {
        if let TaskResult::Evaluated { counts, .. } = &mut result {
            change(counts);
        }
        result
    });
}

fn all(request: &mut CompleteRequest, change: impl FnOnce(&mut Vec<Vec<u8>>)) {
    let mut all = results(request.outcome.take().expect("the delivery has results"));
    change(&mut all);
    request.outcome = Some(of(all));
}

/// Returns 64 KiB of pseudo-random bytes, the same each time.
fn noise() -> Vec<u8> {
    let mut state = 1u32;
    let next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    std::iter::repeat_with(next).take(64 << 10).collect()
}

/// Changes that make a valid delivery invalid: description, part of the expected reason, change.
const VARIATIONS: &[(&str, &str, Change)] = &[
    ("no outcome", "missing", |r| r.outcome = None),
    ("no results", "the delivery has 0 results", |r| all(r, Vec::clear)),
    ("one result too few", "results, but its assignment has", |r| {
        all(r, |all| {
            all.pop();
        })
    }),
    ("one result too many", "results, but its assignment has", |r| all(r, |all| all.push(all[0].clone()))),
    ("another worker", "never issued", |r| r.worker_id = "another".to_owned()),
    ("no worker", "worker_id", |r| r.worker_id.clear()),
    ("another job", "never issued", |r| r.job_id = "j99-0123456789ab".to_owned()),
    ("a round of the future", "never issued", |r| r.round += 1),
    ("a round of the past", "never issued", |r| r.round -= 1),
    ("another range", "never issued", |r| r.first += 1),
    ("a longer range", "never issued", |r| {
        r.count += 1;
        all(r, |all| all.push(all[0].clone()));
    }),
    ("the longest range", "never issued", |r| r.count = u32::MAX),
    ("no tasks", "never issued", |r| {
        r.count = 0;
        all(r, Vec::clear);
    }),
    ("another assignment", "never issued", |r| r.assignment_id -= 1),
    ("an assignment of the future", "never issued", |r| r.assignment_id += 1000),
    ("another engine", "the result is from engine 070707070707", |r| r.engine_digest = vec![7; 32]),
    ("a truncated engine digest", "16 bytes", |r| r.engine_digest.truncate(16)),
    ("no permit", "never issued", |r| r.permit.clear()),
    ("a truncated permit", "never issued", |r| {
        r.permit.pop();
    }),
    ("a permit with one bit flipped", "never issued", |r| r.permit[40] ^= 1),
    ("a permit with a changed first byte", "never issued", |r| r.permit[0] ^= 1),
    ("a failure without a permit", "never issued", |r| {
        r.permit.clear();
        r.outcome = Some(Outcome::Failure("it panicked".to_owned()));
    }),
    ("an empty result", "it is empty", |r| first(r, |_| Vec::new())),
    ("a truncated result", "can't be decoded", |r| {
        first(r, |mut result| {
            result.pop();
            result
        })
    }),
    ("a result with an extra byte", "it is not canonical", |r| first(r, |result| [&result[..], &[0]].concat())),
    ("noise", "is refused: its format is", |r| first(r, |_| noise())),
    ("noise after a valid result", "it is not canonical", |r| first(r, |result| [result, noise()].concat())),
    ("a score that is NaN", "is out of range", |r| score(r, f64::NAN)),
    ("an infinite score", "is out of range", |r| score(r, f64::INFINITY)),
    ("an impossible score", "is out of range", |r| score(r, 100.5)),
    ("an impossible count", "is impossible", |r| counts(r, |counts| counts.rollouts = u64::MAX)),
    ("more unstable rollouts than rollouts", "is impossible", |r| {
        counts(r, |counts| counts.unstable = counts.rollouts + 1)
    }),
    ("a genotype that was not requested", "does not use", |r| {
        content(r, |result| match result {
            TaskResult::Evaluated { score, descriptors, counts, .. } => {
                TaskResult::Evaluated { genotype: Some(vec![0.5].into()), score, descriptors, counts }
            }
            other => other,
        })
    }),
    ("a result of another kind of task", "not of an evaluation", |r| {
        content(r, |_| TaskResult::Examined { scores: vec![Some(1.0)], counts: Counts::default(), traces: None })
    }),
];

/// Returns a delivery of the correct results of an assignment, changed.
fn changed(worker: &ScriptedWorker, assign: &Assign, change: Change) -> CompleteRequest {
    let mut request = worker.delivery(assign, worker.honest(assign));
    change(&mut request);
    request
}

fn why(answer: Result<Verdict, Status>, what: &str) -> String {
    let refused = answer.map_err(|status| (status.code(), status.message().to_owned()));
    match refused {
        Err((Code::InvalidArgument, why)) => why,
        other => panic!("{what}: {other:?}"),
    }
}

/// Returns the ids of connected workers that are quarantined.
async fn quarantined(sandbox: &Sandbox) -> Vec<String> {
    let workers = sandbox.workers().await;
    workers.into_iter().filter(|worker| worker.quarantined).map(|worker| worker.id).collect()
}

#[tokio::test]
async fn malformed_or_unissued_delivery_is_refused_without_harm() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let text = job(51);
    let id = sandbox.submit("r", &text).await.id;
    // The first result measures the cost of a task. From now on, assignments have more than one task.
    let mut honest = ScriptedWorker::join(&sandbox, "honest").await;
    let assign = honest.receive_lease().await;
    let right = honest.honest(&assign);
    assert_eq!(honest.delivers(&assign, right).await, Verdict::Accepted);
    honest.gives_back();
    let before = sandbox.job(&id).await;
    for (number, (what, reason, change)) in VARIATIONS.iter().enumerate() {
        let mut worker = ScriptedWorker::join(&sandbox, &format!("w{number}")).await;
        let assign = worker.receive_lease().await;
        let request = changed(&worker, &assign, *change);
        let told = why(worker.sends(request).await, what);
        assert!(told.contains(reason), "{what}: {told}");
        // One mark does not quarantine the worker: it can still deliver valid results.
        worker.gives_back();
    }
    let after = sandbox.job(&id).await;
    let stands = |job: &proto::v1::Job| (job.rounds_sealed, job.tasks_done, job.last_event, job.disputes.len());
    assert_eq!(stands(&after), stands(&before), "refused deliveries must not be stored");
    assert!(quarantined(&sandbox).await.is_empty());
    let standing = sandbox.standing(&id).await;
    assert!(standing.attempts.is_empty(), "a refusal must not cost the task an attempt: {standing:?}");

    let _worker = sandbox.worker(2);
    assert_eq!(sandbox.result(&id).await.result_digest, undisturbed(&text).await);
}

#[tokio::test]
async fn permit_of_another_assignment_is_refused() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let text = job(52);
    let id = sandbox.submit("r", &text).await.id;
    let mut one = ScriptedWorker::join(&sandbox, "one").await;
    let of_one = one.receive_lease().await;
    let mut other = ScriptedWorker::join(&sandbox, "other").await;
    let of_other = other.receive_lease().await;
    let right = one.honest(&of_one);
    let stolen = CompleteRequest { permit: of_other.permit.clone(), ..one.delivery(&of_one, right.clone()) };
    assert!(why(one.sends(stolen).await, "the permit of another assignment").contains("never issued"));
    let named = CompleteRequest { worker_id: "other".to_owned(), ..one.delivery(&of_one, right.clone()) };
    assert!(why(one.sends(named).await, "the name of another worker").contains("never issued"));
    assert_eq!(one.delivers(&of_one, right).await, Verdict::Accepted);
    let right = other.honest(&of_other);
    assert_eq!(other.delivers(&of_other, right).await, Verdict::Accepted);
    one.gives_back();
    other.gives_back();
    let _worker = sandbox.worker(2);
    assert_eq!(sandbox.result(&id).await.result_digest, undisturbed(&text).await);
}

#[tokio::test]
async fn permit_outlives_coordinator_but_not_its_store() {
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let text = job(53);
    let id = sandbox.submit("r", &text).await.id;
    let mut worker = ScriptedWorker::join(&sandbox, "w").await;
    let assign = worker.receive_lease().await;
    let right = worker.honest(&assign);
    worker.gives_back();
    coordinator.kill_9();
    let coordinator = sandbox.coordinator();
    // The worker's own connection is broken, so another worker delivers under its name.
    let mut other = ScriptedWorker::join(&sandbox, "other").await;
    assert_eq!(
        other.sends(worker.delivery(&assign, right)).await.expect("the delivery is answered"),
        Verdict::Accepted
    );
    let delivered = sandbox.job(&id).await;
    assert_eq!((delivered.rounds_sealed, delivered.tasks_done > 0), (1, true));
    coordinator.kill_9();

    // Another store has another key, but the same job id and assignment id.
    let mut elsewhere = Sandbox::new();
    let _other = elsewhere.coordinator();
    assert_eq!(elsewhere.submit("r", &text).await.id, id);
    let mut same = ScriptedWorker::join(&elsewhere, "w").await;
    let again = same.receive_lease().await;
    assert_eq!((again.assignment_id, again.first), (assign.assignment_id, assign.first));
    let foreign = CompleteRequest { permit: assign.permit.clone(), ..same.delivery(&again, same.honest(&again)) };
    assert!(why(same.sends(foreign).await, "a permit of another store").contains("never issued"));
}

#[tokio::test]
async fn late_delivery_of_ended_job_is_obsolete() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let id = sandbox.submit("r", &job(54)).await.id;
    let mut worker = ScriptedWorker::join(&sandbox, "w").await;
    let assign = worker.receive_lease().await;
    let right = worker.honest(&assign);
    sandbox.client().cancel_job(CancelJobRequest { id: id.clone() }).await.expect("the job can be cancelled");
    let ended = sandbox.job(&id).await;
    assert_eq!(ended.state(), JobState::Cancelled);
    assert_eq!(worker.delivers(&assign, right).await, Verdict::Obsolete);
    // The coordinator does not check results of ended jobs.
    assert_eq!(worker.delivers(&assign, of(vec![noise()])).await, Verdict::Obsolete);
    assert_eq!(sandbox.job(&id).await, ended);
}

#[tokio::test]
async fn three_marks_quarantine_only_that_worker() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let text = job(55);
    let id = sandbox.submit("r", &text).await.id;
    let mut good = ScriptedWorker::join(&sandbox, "good").await;
    let of_good = good.receive_lease().await;
    let mut bad = ScriptedWorker::join(&sandbox, "bad").await;
    let assign = bad.receive_lease().await;
    let right = bad.honest(&assign);
    for mark in 1..=3 {
        assert!(quarantined(&sandbox).await.is_empty(), "before mark {mark}");
        // Deliveries under the name of an unconnected worker mark no worker.
        let named = CompleteRequest { worker_id: "absent".to_owned(), ..bad.delivery(&assign, right.clone()) };
        why(bad.sends(named).await, "a name without a worker");
        let noise = bad.delivery(&assign, with_first(right.clone(), |_| noise()));
        why(bad.sends(noise).await, "noise");
    }
    assert_eq!(quarantined(&sandbox).await, ["bad"]);
    assert_eq!(bad.delivers(&assign, right).await, Verdict::Quarantined);
    let right = good.honest(&of_good);
    assert_eq!(good.delivers(&of_good, right).await, Verdict::Accepted);
    good.gives_back();
    let _worker = sandbox.worker(2);
    assert_eq!(sandbox.result(&id).await.result_digest, undisturbed(&text).await);
}

#[tokio::test]
async fn two_results_of_one_task_quarantine_their_worker() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let text = job(56);
    let id = sandbox.submit("r", &text).await.id;
    let mut bad = ScriptedWorker::join(&sandbox, "bad").await;
    let assign = bad.receive_lease().await;
    let right = bad.honest(&assign);
    assert_eq!(bad.delivers(&assign, right.clone()).await, Verdict::Accepted);
    assert_eq!(bad.delivers(&assign, right.clone()).await, Verdict::Duplicate);
    assert!(quarantined(&sandbox).await.is_empty(), "repeating a result must not quarantine the worker");
    assert_eq!(bad.delivers(&assign, one_bit_off(right.clone())).await, Verdict::Conflict);
    assert_eq!(quarantined(&sandbox).await, ["bad"]);
    assert_eq!(bad.delivers(&assign, right).await, Verdict::Quarantined);
    // The bad worker's results are ignored now, so two other workers have to agree.
    let _workers = [sandbox.worker(1), sandbox.worker(1)];
    assert_eq!(sandbox.result(&id).await.result_digest, undisturbed(&text).await);
}

#[tokio::test]
async fn store_stays_small_after_thousand_refused_deliveries() {
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let text = job(57);
    let id = sandbox.submit("r", &text).await.id;
    assert_eq!(coordinator.terminate(), Some(0));
    let size = |sandbox: &Sandbox| std::fs::metadata(sandbox.file("store.db")).expect("the store exists").len();
    let before = size(&sandbox);
    let coordinator = sandbox.coordinator();
    let mut worker = ScriptedWorker::join(&sandbox, "first").await;
    let assign = worker.receive_lease().await;
    let wrong = worker.delivery(&assign, of(vec![noise(); assign.tasks.len()]));
    // Sends the delivery from 50 connected workers, three times each, and then under the names of unconnected workers.
    let mut refused = 0;
    for number in 0..50 {
        let mut other = ScriptedWorker::join(&sandbox, &format!("w{number}")).await;
        for _ in 0..3 {
            let forged = CompleteRequest { worker_id: format!("w{number}"), ..wrong.clone() };
            why(other.sends(forged).await, "an assignment of another worker");
            refused += 1;
        }
    }
    while refused < 1000 {
        let forged = CompleteRequest { worker_id: format!("unknown {refused}"), ..wrong.clone() };
        why(worker.sends(forged).await, "a worker that is not connected");
        refused += 1;
    }
    worker.gives_back();
    let _ended = ScriptedWorker::join(&sandbox, "w0").await;
    assert_eq!(quarantined(&sandbox).await, ["w0"], "quarantine must survive a new connection");
    assert_eq!(coordinator.terminate(), Some(0));
    let grown = size(&sandbox).saturating_sub(before);
    println!("{refused} refused deliveries: the store grew by {grown} bytes");
    assert!(grown < 200 << 10, "{grown} bytes");

    let _coordinator = sandbox.coordinator();
    let _worker = sandbox.worker(2);
    assert_eq!(sandbox.result(&id).await.result_digest, undisturbed(&text).await);
}
