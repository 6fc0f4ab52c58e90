//! Costs of the most expensive jobs: submission and restart must not simulate, and settling must be stoppable.

use cluster_tests::chains::{chain_job, costliest_job};
use cluster_tests::sandbox::{Process, Sandbox, TIMEOUT};
use proto::v1::{ListJobsRequest, SubmitJobRequest};
use std::time::{Duration, Instant};
use tonic::{Code, Status};

/// Limit on the coordinator's CPU time per submission. A debug build takes a third of it.
const SUBMISSION: Duration = Duration::from_millis(50);
/// Limit on the coordinator's CPU time from its start until it serves.
const RESTART: Duration = Duration::from_secs(3);
/// Number of submissions measured together, because the system counts CPU time in steps of 10 ms.
const BATCH: u32 = 10;

async fn submit(sandbox: &Sandbox, request_id: String, job_toml: &str) -> Result<String, Status> {
    let request = SubmitJobRequest { request_id, job_toml: job_toml.to_owned(), priority: 0 };
    let answer = sandbox.client().submit_job(request).await?;
    Ok(answer.into_inner().job.expect("the response has the job").id)
}

/// Measures the CPU time of a coordinator per submission of a job. Returns the least of three batches, because other
/// work may disturb one.
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
async fn submission_of_costliest_jobs_uses_little_cpu() {
    for (what, job_toml, accepted) in
        [("beyond the budget", chain_job(1, 1000, 100), false), ("at the budget's limit", costliest_job(1), true)]
    {
        let mut sandbox = Sandbox::new();
        let coordinator = sandbox.coordinator();
        let (cost, refused) = cost_of_submission(&sandbox, &coordinator, &job_toml).await;
        println!("{what}: {:.1} ms of CPU per submission", cost.as_secs_f64() * 1000.0);
        match refused {
            None => assert!(accepted, "{what}: must be refused"),
            Some(status) => {
                assert!(!accepted && status.code() == Code::InvalidArgument, "{what}: {status}");
                let told = status.message();
                let limit = sim_core::base::limits::MAX_PREPARATION.to_string();
                assert!(
                    told.contains("body-substeps") && told.contains(&limit),
                    "the message must name both numbers: {told}"
                );
            }
        }
        assert!(cost < SUBMISSION, "{what}: {cost:?}");
    }
}

#[tokio::test]
async fn restart_with_100_costliest_jobs_uses_little_cpu() {
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let dearest = costliest_job(0);
    for seed in 0..100 {
        let job_toml = dearest.replacen("seed = 0", &format!("seed = {seed}"), 1);
        submit(&sandbox, seed.to_string(), &job_toml).await.expect("the job is within the budget");
    }
    coordinator.kill_9();
    let start = Instant::now();
    let coordinator = sandbox.coordinator();
    let listed =
        sandbox.client().list_jobs(ListJobsRequest::default()).await.expect("the coordinator serves").into_inner().jobs;
    let (took, cost) = (start.elapsed(), coordinator.cpu_time());
    println!("served {} ms after the start, with {} ms of CPU", took.as_millis(), cost.as_millis());
    assert_eq!(listed.len(), 100);
    // CPU time is checked because wall-clock time depends on other processes.
    assert!(cost < RESTART, "{cost:?}");
}

#[tokio::test]
async fn worker_exits_within_grace_while_settling() {
    let mut sandbox = Sandbox::new();
    let _coordinator = sandbox.coordinator();
    let id = submit(&sandbox, "r".to_owned(), &costliest_job(1)).await.expect("the job is within the budget");
    let mut worker = sandbox.worker_command(&sandbox.url(), 1);
    let worker = Process::start(worker.args(["--grace", "2"]));
    let start = Instant::now();
    loop {
        let workers = sandbox.workers().await;
        if workers.iter().any(|worker| worker.busy > 0) {
            break;
        }
        assert!(start.elapsed() < TIMEOUT, "the worker received no task");
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    // Time for the worker to begin settling.
    tokio::time::sleep(Duration::from_millis(500)).await;
    let start = Instant::now();
    assert_eq!(worker.terminate(), Some(0));
    let took = start.elapsed();
    println!("ended {} ms after SIGTERM", took.as_millis());
    assert!(took < Duration::from_secs(4), "the worker must exit within its grace of 2 s and a margin: {took:?}");
    let job = sandbox.job(&id).await;
    assert_eq!((job.rounds_sealed, job.tasks_done), (0, 0), "the worker must still be settling");
    assert!(sandbox.standing(&id).await.attempts.is_empty(), "a drain must not count as a failed attempt");
}
