//! Jobs on real coordinator and worker processes, also when these are killed.

use cluster_tests::sandbox::{
    Process, Sandbox, output_of, phase, planning_job, program, simulating_job, tiny_job, value,
};
use proto::v1::job_event::Event;
use proto::v1::{CancelJobRequest, JobEvent, JobState, RoundSealed, SubmitJobRequest, WatchJobRequest};
use std::time::Duration;
use tonic::{Code, Status};

const GENERATIONS: u32 = 4;

/// Returns the result digest of a tiny job on one worker without disturbances.
async fn undisturbed(seed: u32, generations: u32) -> Vec<u8> {
    digest_with_workers(seed, generations, 1).await
}

async fn digest_with_workers(seed: u32, generations: u32, workers: usize) -> Vec<u8> {
    digest_of(&tiny_job(seed, generations), generations, workers).await
}

async fn digest_of(job: &str, generations: u32, workers: usize) -> Vec<u8> {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let _workers: Vec<Process> = (0..workers).map(|_| sandbox.worker(1)).collect();
    let job = sandbox.submit("r", job).await;
    let result = sandbox.result(&job.id).await;
    assert_eq!(result.result_digest.len(), 32);
    assert_eq!(result.history.len(), generations as usize);
    let report = result.artefacts.iter().find(|artefact| artefact.name == "report").expect("the result has a report");
    let report: serde_json::Value = serde_json::from_slice(&report.content).expect("the report is JSON");
    assert_eq!(report["archive"].as_array().map(Vec::len), Some(3));
    assert_eq!(report["winner"], report["archive"][0]["candidate"]);
    result.result_digest
}

#[tokio::test]
async fn same_job_on_more_workers_gives_same_result() {
    let one = digest_with_workers(1, GENERATIONS, 1).await;
    assert_eq!(one, digest_with_workers(1, GENERATIONS, 2).await);
    assert_eq!(one, digest_with_workers(1, GENERATIONS, 5).await);
    assert_ne!(one, digest_with_workers(2, GENERATIONS, 2).await, "another seed must give another result");
}

#[tokio::test]
async fn lockstep_search_with_rapier_finish_gives_same_result() {
    let job = tiny_job(1, GENERATIONS).replace("\"rapier\"", "\"lockstep\"");
    let one = digest_of(&job, GENERATIONS, 1).await;
    assert_eq!(one, digest_of(&job, GENERATIONS, 2).await);
    assert_eq!(one, digest_of(&job, GENERATIONS, 5).await);
}

#[tokio::test]
async fn killed_worker_does_not_change_result() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let victim = sandbox.worker(2);
    let job = sandbox.submit("r", &tiny_job(3, GENERATIONS)).await;
    sandbox.until(&job.id, |job| job.rounds_sealed > 1).await;
    victim.kill_9();
    assert_eq!(sandbox.job(&job.id).await.state(), JobState::Running, "the worker must be killed before the job ends");
    let _other = sandbox.worker(1);
    assert_eq!(sandbox.result(&job.id).await.result_digest, undisturbed(3, GENERATIONS).await);
}

#[tokio::test]
async fn stopped_worker_returns_its_leases_at_once() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let leaves = sandbox.worker(2);
    let job = sandbox.submit("r", &tiny_job(13, GENERATIONS)).await;
    sandbox.until(&job.id, |job| job.rounds_sealed > 1).await;
    let _stays = sandbox.worker(1);
    assert_eq!(leaves.terminate(), Some(0));
    let running = sandbox.job(&job.id).await;
    assert_eq!(running.state(), JobState::Running, "the worker must stop before the job ends");
    let workers = sandbox.workers().await;
    assert!(workers.iter().all(|w| w.slots == 1), "{workers:?}");
    assert_eq!(sandbox.result(&job.id).await.result_digest, undisturbed(13, GENERATIONS).await);
}

#[tokio::test]
async fn killed_coordinator_resumes_without_changing_result() {
    let mut sandbox = Sandbox::new();
    let mut coordinator = sandbox.coordinator();
    let _worker = sandbox.worker(2);
    let job = sandbox.submit("r", &tiny_job(4, 6)).await;
    for generations in [1, 3] {
        let before = sandbox.until(&job.id, |job| job.rounds_sealed >= generations).await;
        coordinator.kill_9();
        coordinator = sandbox.coordinator();
        let after = sandbox.job(&job.id).await;
        assert!(after.rounds_sealed >= before.rounds_sealed, "sealed rounds that were reported must be stored");
    }
    assert_eq!(sandbox.result(&job.id).await.result_digest, undisturbed(4, 6).await);
    drop(coordinator);
}

/// Returns a job that spends most of its time after the search.
fn long_finish(seed: u32) -> String {
    tiny_job(seed, 2).replace("archive = 3\nseeds = 2", "archive = 10\nseeds = 2\nsteps_per_second = 240")
}

#[tokio::test]
async fn kills_during_finish_do_not_change_result() {
    let mut sandbox = Sandbox::new();
    let mut coordinator = sandbox.coordinator();
    let mut worker = sandbox.worker(2);
    let job = sandbox.submit("r", &long_finish(14)).await;
    // Kills the coordinator, then the worker, then both.
    for (done, dies) in [(2, [true, false]), (4, [false, true]), (6, [true, true])] {
        let half = |job: &proto::v1::Job| phase(job) == "finishing" && job.tasks_done >= done;
        let before = sandbox.until(&job.id, half).await;
        if dies[0] {
            coordinator.kill_9();
            coordinator = sandbox.coordinator();
        }
        if dies[1] {
            worker.kill_9();
            worker = sandbox.worker(1);
        }
        let after = sandbox.job(&job.id).await;
        assert!(after.tasks_done >= before.tasks_done, "done tasks that were reported must be stored");
    }
    sandbox.until(&job.id, |job| phase(job) == "reporting" && job.tasks_done >= 1).await;
    coordinator.kill_9();
    let _coordinator = sandbox.coordinator();
    let digest = sandbox.result(&job.id).await.result_digest;

    let mut undisturbed = Sandbox::new();
    let _other = undisturbed.coordinator();
    let _worker = undisturbed.worker(1);
    let job = undisturbed.submit("r", &long_finish(14)).await;
    assert_eq!(undisturbed.result(&job.id).await.result_digest, digest);
    drop(worker);
}

#[tokio::test]
async fn plans_do_not_depend_on_workers_or_kills() {
    let report = same_after_kills(&planning_job(15, 14), "planning").await;
    assert_eq!(report["plans"].as_array().map(Vec::len), Some(14));
}

#[tokio::test]
async fn simulated_runs_do_not_depend_on_workers_or_kills() {
    let report = same_after_kills(&simulating_job(15, 40), "simulating").await;
    assert_eq!(report["repeats"].as_array().map(Vec::len), Some(40));
}

/// Runs a job on 1, 2 and 7 workers, and once with kills within a phase. All digests must be equal. Returns the report.
async fn same_after_kills(job: &str, phase_of: &str) -> serde_json::Value {
    let mut digests = Vec::new();
    for workers in [1, 2, 7] {
        let mut sandbox = Sandbox::new();
        let _coordinator = sandbox.coordinator();
        let _workers: Vec<Process> = (0..workers).map(|_| sandbox.worker(1)).collect();
        let id = sandbox.submit("r", job).await.id;
        digests.push(sandbox.result(&id).await.result_digest);
    }
    let mut sandbox = Sandbox::new();
    let mut coordinator = sandbox.coordinator();
    let mut worker = sandbox.worker(2);
    let id = sandbox.submit("r", job).await.id;
    for (done, dies) in [(2, [true, false]), (5, [false, true]), (8, [true, true])] {
        let before = sandbox.until(&id, |job| phase(job) == phase_of && job.tasks_done >= done).await;
        if dies[0] {
            coordinator.kill_9();
            coordinator = sandbox.coordinator();
        }
        if dies[1] {
            worker.kill_9();
            worker = sandbox.worker(1);
        }
        assert!(sandbox.job(&id).await.tasks_done >= before.tasks_done, "done tasks that were reported must be stored");
    }
    let result = sandbox.result(&id).await;
    digests.push(result.result_digest);
    assert!(digests.iter().all(|digest| *digest == digests[0]), "{digests:?}");
    let [artefact] = &result.artefacts[..] else { panic!("the result must have one artefact") };
    drop(worker);
    serde_json::from_slice(&artefact.content).expect("the report is JSON")
}

#[tokio::test]
async fn repeated_submission_gives_one_job() {
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let first = sandbox.submit("same", &tiny_job(5, 2)).await;
    assert_eq!(sandbox.submit("same", &tiny_job(5, 2)).await.id, first.id);
    coordinator.kill_9();
    let _coordinator = sandbox.coordinator();
    assert_eq!(
        sandbox.submit("same", &tiny_job(5, 2)).await.id,
        first.id,
        "the request id must be known after a restart"
    );
    assert_ne!(sandbox.submit("other", &tiny_job(5, 2)).await.id, first.id);

    let mut client = sandbox.client();
    let request = |job_toml: String| SubmitJobRequest { request_id: "same".to_owned(), job_toml, priority: 0 };
    let refused = client.submit_job(request(tiny_job(6, 2))).await.unwrap_err();
    assert_eq!(refused.code(), Code::AlreadyExists, "{refused}");
    let sooner = |priority| SubmitJobRequest { priority, ..request(tiny_job(5, 2)) };
    let refused = client.submit_job(sooner(20)).await.unwrap_err();
    assert_eq!(refused.code(), Code::AlreadyExists, "{refused}");
    assert!(client.submit_job(sooner(10)).await.is_ok(), "the job has this priority already");
    let refused = client.submit_job(SubmitJobRequest { request_id: "new".to_owned(), ..request("robot =".to_owned()) });
    let refused = refused.await.unwrap_err();
    assert_eq!(refused.code(), Code::InvalidArgument, "{refused}");
}

#[tokio::test]
async fn concurrent_submissions_with_one_request_id_create_one_job() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let submit = |seed| {
        let mut client = sandbox.client();
        let request = SubmitJobRequest { request_id: "same".to_owned(), job_toml: tiny_job(seed, 1), priority: 0 };
        async move { client.submit_job(request).await.map(|answer| answer.into_inner().created) }
    };
    // Checking a job takes longer than the lookup in the store, so at first all four find the request id unused.
    let (a, b, c, d) = tokio::join!(submit(1), submit(2), submit(3), submit(4));
    let answers = [a, b, c, d];
    assert_eq!(answers.iter().filter(|a| matches!(a, Ok(true))).count(), 1, "{answers:?}");
    let refused = |a: &&Result<bool, Status>| a.as_ref().is_err_and(|s| s.code() == Code::AlreadyExists);
    assert_eq!(answers.iter().filter(refused).count(), 3, "{answers:?}");
}

#[tokio::test]
async fn cancelled_job_stays_cancelled() {
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let worker = sandbox.worker(2);
    let job = sandbox.submit("r", &tiny_job(7, 1000)).await;
    sandbox.until(&job.id, |job| job.rounds_sealed > 1).await;
    let cancel = || CancelJobRequest { id: job.id.clone() };
    let cancelled = sandbox.client().cancel_job(cancel()).await.unwrap().into_inner().job.unwrap();
    assert_eq!(cancelled.state(), JobState::Cancelled);
    // The workers are free for other jobs at once, and no late result revives the job.
    let next = sandbox.submit("next", &tiny_job(8, 2)).await;
    sandbox.result(&next.id).await;
    assert_eq!(sandbox.job(&job.id).await, cancelled);
    coordinator.kill_9();
    let _coordinator = sandbox.coordinator();
    assert_eq!(sandbox.job(&job.id).await, cancelled);
    assert_eq!(sandbox.client().cancel_job(cancel()).await.unwrap().into_inner().job, Some(cancelled));
    assert_eq!(worker.terminate(), Some(0));
}

/// Returns the stored events after a sequence number, until there are `most` of them or the job ends.
async fn watch(sandbox: &Sandbox, id: &str, after: u64, most: usize) -> Vec<JobEvent> {
    let request = WatchJobRequest { id: id.to_owned(), after };
    let mut stream = sandbox.client().watch_job(request).await.expect("the watch starts").into_inner();
    let mut events = Vec::new();
    while events.len() < most
        && let Some(event) = stream.message().await.expect("the stream ends without an error")
    {
        if !matches!(event.event, Some(Event::TasksDone(_))) {
            events.push(event);
        }
    }
    events
}

#[tokio::test]
async fn resumed_watch_has_no_gap() {
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let _worker = sandbox.worker(2);
    let job = sandbox.submit("r", &tiny_job(9, 5)).await;
    let mut events = watch(&sandbox, &job.id, 0, 3).await;
    coordinator.kill_9();
    let _coordinator = sandbox.coordinator();
    events.extend(watch(&sandbox, &job.id, events[2].sequence, 1).await);
    events.extend(watch(&sandbox, &job.id, events[3].sequence, usize::MAX).await);
    let sequence: Vec<u64> = events.iter().map(|e| e.sequence).collect();
    assert_eq!(sequence, (1..=events.len() as u64).collect::<Vec<_>>());
    assert_eq!(events.last().unwrap().job.as_ref().unwrap().state(), JobState::Succeeded);
    let sealed = |e: &JobEvent| if let Some(Event::RoundSealed(round)) = &e.event { Some(round.clone()) } else { None };
    let sealed: Vec<RoundSealed> = events.iter().filter_map(sealed).collect();
    assert_eq!(sealed.iter().map(|round| round.round).collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5, 6, 7]);
    let rows = sealed.iter().filter_map(|round| round.row.as_ref()).map(|row| row.index);
    assert_eq!(rows.collect::<Vec<_>>(), [0, 1, 2, 3, 4], "generations");
    assert_eq!(watch(&sandbox, &job.id, 0, usize::MAX).await, events, "an ended job must report the same events again");

    let beyond = WatchJobRequest { id: job.id, after: 1000 };
    assert_eq!(sandbox.client().watch_job(beyond).await.unwrap_err().code(), Code::OutOfRange);
}

#[tokio::test]
async fn two_jobs_share_workers() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let _worker = sandbox.worker(2);
    let long = sandbox.submit("long", &tiny_job(10, 1000)).await;
    sandbox.until(&long.id, |job| job.rounds_sealed > 1).await;
    let short = sandbox.submit("short", &tiny_job(11, GENERATIONS)).await;
    let before = value(&sandbox.job(&long.id).await, "evaluations");
    let digest = sandbox.result(&short.id).await.result_digest;
    let long_got = value(&sandbox.job(&long.id).await, "evaluations") - before;
    assert!(long_got >= 5.0, "the long job must continue beside the short one: {long_got} evaluations");
    assert_eq!(digest, undisturbed(11, GENERATIONS).await);
}

#[tokio::test]
async fn worker_retries_until_its_coordinator_starts() {
    let mut sandbox = Sandbox::new();
    sandbox.reserve_port();
    let worker = sandbox.worker(3);
    std::thread::sleep(Duration::from_millis(500));
    let _coordinator = sandbox.coordinator();
    let job = sandbox.submit("r", &tiny_job(12, 1)).await;
    sandbox.result(&job.id).await;
    let workers = sandbox.workers().await;
    assert_eq!(workers.iter().map(|w| w.slots).collect::<Vec<_>>(), [3]);
    assert_eq!(worker.terminate(), Some(0));
}

#[test]
fn coordinator_start_failure_prints_one_line() {
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let output = output_of(&mut sandbox.coordinator_command());
    let text = String::from_utf8(output.stderr).expect("error messages are UTF-8");
    assert_eq!(output.status.code(), Some(1));
    assert!(text.starts_with("coordinator: 127.0.0.1:") && text.contains("is in use by another program"), "{text}");
    assert_eq!(text.lines().count(), 1, "{text}");
    assert_eq!(coordinator.terminate(), Some(0));

    let again = |arguments: &[&str]| {
        let output = output_of(program("coordinator").args(arguments));
        (output.status.code(), String::from_utf8(output.stderr).expect("error messages are UTF-8"))
    };
    let (code, text) = again(&["--listen", "0.0.0.0:0", "--store", "memory:"]);
    assert!(code == Some(1) && text.contains("--insecure-bind"), "{text}");
    let (code, text) = again(&["--listen", "127.0.0.1:0", "--store", "sqlite:/nowhere/at/all.db"]);
    assert!(code == Some(1) && text.contains("there is no folder /nowhere/at"), "{text}");
    let (code, text) = again(&["--listen", "127.0.0.1:0", "--store", "memory:", "--lease-seconds", "NaN"]);
    assert!(code == Some(2) && text.contains("it must be a number of seconds that is not negative"), "{text}");
    let (code, text) = again(&["--lease-seconds", "soon"]);
    assert!(code == Some(2) && text.contains("'--lease-seconds <SECONDS>': it must be a number of seconds"), "{text}");
}
