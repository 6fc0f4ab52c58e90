//! What the dearest jobs cost: submitting and restarting simulate nothing, and settling can be stopped.

use cluster_tests::chains::{chain_job, dearest_job};
use cluster_tests::sandbox::{PATIENCE, Process, Sandbox};
use proto::v1::{ListJobsRequest, ListWorkersRequest, SubmitJobRequest};
use std::time::{Duration, Instant};
use tonic::{Code, Status};

/// Most CPU time of the coordinator for a submission. A debug build takes a third of it.
const SUBMISSION: Duration = Duration::from_millis(50);
/// Most CPU time of a coordinator from its start until it serves. It waits for nothing else meanwhile.
const RESTART: Duration = Duration::from_secs(3);
/// Submissions that are measured together: the system counts CPU time in steps of 10 ms.
const BATCH: u32 = 10;

async fn submit(sandbox: &Sandbox, request_id: String, job_toml: &str) -> Result<String, Status> {
    let request = SubmitJobRequest { request_id, job_toml: job_toml.to_owned(), priority: 0 };
    let answer = sandbox.client().submit_job(request).await?;
    Ok(answer.into_inner().job.expect("the answer has the job").id)
}

/// CPU time of a coordinator for each submission of a job: the least of a few batches, since other work may disturb one.
async fn cost_of_submission(sandbox: &Sandbox, coordinator: &Process, job_toml: &str) -> (Duration, Option<Status>) {
    let (mut least, mut refused) = (Duration::MAX, None);
    for batch in 0..3 {
        let before = coordinator.cpu_time();
        for number in 0..BATCH {
            refused = submit(sandbox, format!("{batch}-{number}"), job_toml).await.err();
        }
        least = least.min((coordinator.cpu_time() - before) / BATCH);
    }
    (least, refused)
}

#[tokio::test]
async fn submission_of_dearest_jobs_costs_little_cpu() {
    for (what, job_toml, accepted) in
        [("beyond the budget", chain_job(1, 1000, 100), false), ("the dearest within it", dearest_job(1), true)]
    {
        let mut sandbox = Sandbox::new();
        let coordinator = sandbox.coordinator();
        let (cost, refused) = cost_of_submission(&sandbox, &coordinator, &job_toml).await;
        println!("{what}: {:.1} ms of CPU a submission", cost.as_secs_f64() * 1000.0);
        match refused {
            None => assert!(accepted, "{what}: it was accepted"),
            Some(status) => {
                assert!(!accepted && status.code() == Code::InvalidArgument, "{what}: {status}");
                let told = status.message();
                let limit = sim_core::base::limits::MAX_PREPARATION.to_string();
                assert!(told.contains("body-substeps") && told.contains(&limit), "both numbers are told: {told}");
            }
        }
        assert!(cost < SUBMISSION, "{what}: {cost:?}");
    }
}

#[tokio::test]
async fn restart_with_hundred_dearest_jobs_costs_seconds() {
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let dearest = dearest_job(0);
    for seed in 0..100 {
        let job_toml = dearest.replacen("seed = 0", &format!("seed = {seed}"), 1);
        submit(&sandbox, seed.to_string(), &job_toml).await.expect("it is within the budget");
    }
    coordinator.kill_9();
    let start = Instant::now();
    let coordinator = sandbox.coordinator();
    let listed = sandbox.client().list_jobs(ListJobsRequest::default()).await.expect("it serves").into_inner().jobs;
    let (took, cost) = (start.elapsed(), coordinator.cpu_time());
    println!("served {} ms after the start, with {} ms of CPU", took.as_millis(), cost.as_millis());
    assert_eq!(listed.len(), 100);
    // By the clock it depends on what else runs, as in a test that runs beside others.
    assert!(cost < RESTART, "{cost:?}");
}

#[tokio::test]
async fn worker_that_settles_ends_within_its_grace() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let id = submit(&sandbox, "r".to_owned(), &dearest_job(1)).await.expect("it is within the budget");
    let mut worker = sandbox.worker_command(&sandbox.url(), 1);
    let worker = Process::start(worker.args(["--grace", "2"]));
    let start = Instant::now();
    loop {
        let workers = sandbox.client().list_workers(ListWorkersRequest {}).await.expect("a list").into_inner().workers;
        if workers.iter().any(|worker| worker.busy > 0) {
            break;
        }
        assert!(start.elapsed() < PATIENCE, "nothing was handed out");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    // It settles by now.
    tokio::time::sleep(Duration::from_millis(500)).await;
    let start = Instant::now();
    assert_eq!(worker.terminate(), Some(0));
    let took = start.elapsed();
    println!("ended {} ms after SIGTERM", took.as_millis());
    assert!(took < Duration::from_secs(4), "2 s of grace, and a moment to say so: {took:?}");
    let job = sandbox.job(&id).await;
    assert_eq!((job.rounds_sealed, job.tasks_done), (0, 0), "it was settling");
    assert!(sandbox.standing(&id).await.attempts.is_empty(), "nothing is held against it");
}
