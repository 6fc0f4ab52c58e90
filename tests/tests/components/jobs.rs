//! Jobs that use the example components, run by the standard coordinator and workers.

use crate::examples;
use cluster_tests::sandbox::TIMEOUT;
use proto::v1::job_service_client::JobServiceClient;
use proto::v1::{GetJobRequest, GetResultRequest, GetResultResponse, JobState, SubmitJobRequest};
use sim_core::problem::Job;
use std::time::{Duration, Instant};
use tokio::sync::watch;

fn job(procedure: &str) -> String {
    format!(
        r#"
        name = "added"
        procedure = "{procedure}"
        environment = "empty"
        gaits = {{ count = 2, duration = 2.0, controller = "square" }}
        planner = {{ iterations = 3, algorithm = "breadth-first" }}
        fitness = {{ kind = "reach", factor = 2.0 }}
        optimiser = {{ kind = "scatter", candidates = 12, generations = 3 }}
        finish = {{ kind = "none" }}
        [robot]
        name = "snake"
        pivot = "b/rear"
        [[robot.module]]
        name = "a"
        kind = "elbow"
        [[robot.module]]
        name = "b"
        kind = "elbow"
        attach = {{ to = "a", port = "front" }}
        "#
    )
}

/// Returns the result of a job on the given number of workers, all within this process.
async fn result(job_toml: &str, workers: usize) -> GetResultResponse {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let store = coordinator::StoreUrl::Sqlite(folder.path().join("store.sqlite"));
    let coordinator = coordinator::serve(coordinator::Config::embedded(store)).await.expect("the coordinator serves");
    let url = format!("http://{}", coordinator.local_addr());
    let (stop, stopped) = watch::channel(false);
    let working: Vec<_> = (0..workers)
        .map(|_| {
            let (config, mut stopped) = (worker::Config::new(url.clone(), 1), stopped.clone());
            tokio::spawn(worker::run(config, async move {
                let _ = stopped.wait_for(|stop| *stop).await;
            }))
        })
        .collect();
    let mut client = JobServiceClient::connect(url).await.expect("the coordinator accepts the connection");
    let request = SubmitJobRequest { request_id: "r".to_owned(), job_toml: job_toml.to_owned(), priority: 0 };
    let id = client
        .submit_job(request)
        .await
        .expect("the job is accepted")
        .into_inner()
        .job
        .expect("the response has the job")
        .id;
    let start = Instant::now();
    loop {
        let job = client
            .get_job(GetJobRequest { id: id.clone() })
            .await
            .expect("the job exists")
            .into_inner()
            .job
            .expect("the response has the job");
        match job.state() {
            JobState::Succeeded => break,
            JobState::Failed => panic!("{}", job.reason),
            _ => assert!(start.elapsed() < TIMEOUT, "the job did not end in time: {job:?}"),
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    let result = client.get_result(GetResultRequest { id }).await.expect("a succeeded job has a result").into_inner();
    stop.send(true).expect("the workers run");
    for worker in working {
        worker.await.expect("the worker does not panic").expect("the worker exits without an error");
    }
    coordinator.shutdown().await.expect("the coordinator shuts down");
    result
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn jobs_with_added_components_succeed() {
    examples::add();

    // Evolves with an added kind of module, controller, planner, objective and search.
    let evolved = result(&job("evolve"), 1).await;
    assert_eq!(
        evolved.result_digest,
        result(&job("evolve"), 3).await.result_digest,
        "the result must not depend on the number of workers"
    );
    let report = evolved.artefacts.iter().find(|artefact| artefact.name == "report").expect("the result has a report");
    let report: serde_json::Value = serde_json::from_slice(&report.content).expect("the report is JSON");
    let genome = report["winner"]["genome"].as_array().expect("the report has a winner");
    assert_eq!(genome.len(), 4, "two gaits of two joints: {report}");
    assert!(
        genome.iter().all(|height| height.as_f64().is_some_and(|h| h <= examples::Square::MOST)),
        "the winner's heights must be feasible"
    );
    // Some of the 36 candidates have a height that the controller refuses. These candidates fail, but the job does not.
    let failed = evolved.history.iter().flat_map(|row| row.values.iter().filter(|v| v.name == "failed"));
    let failed: f64 = failed.filter_map(|value| value.value).sum();
    assert!((1.0..36.0).contains(&failed), "{failed} failed");

    // Runs an added procedure.
    let measured = result(&job("heights"), 2).await;
    let settled = Job::from_toml(&job("heights")).expect("the job is valid");
    let height = f64::from(settled.start().pivot.translation.z);
    let [artefact] = &measured.artefacts[..] else { panic!("{:?}", measured.artefacts) };
    assert_eq!(artefact.content, [1.0, 2.0, 3.0].map(|factor| (height * factor).to_le_bytes()).concat());
}
