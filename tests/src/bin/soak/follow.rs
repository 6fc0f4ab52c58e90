//! Client that submits a job repeatedly, watches it through all disturbances, and compares the result with an
//! undisturbed run.

use cluster_tests::sandbox::is_last;
use proto::dial::{Dial, FailoverChannel};
use proto::v1::job_event::Event;
use proto::v1::job_service_client::JobServiceClient;
use proto::v1::{
    Artefact, GetJobRequest, GetResultRequest, GetResultResponse, Job, JobEvent, JobState, Progress, Row,
    SubmitJobRequest, WatchJobRequest,
};
use std::time::{Duration, Instant};
use tonic::{Code, Status};

/// Result of a job, which must not depend on disturbances.
#[derive(Clone, Debug, PartialEq)]
pub struct Expected {
    digest: Vec<u8>,
    artefacts: Vec<Artefact>,
    history: Vec<Row>,
    progress: Option<Progress>,
    events: u64,
}

impl Expected {
    pub fn of(result: GetResultResponse, job: Job) -> Self {
        Self {
            digest: result.result_digest,
            artefacts: result.artefacts,
            history: result.history,
            progress: job.progress,
            events: job.last_event,
        }
    }
}

/// Runs a job repeatedly until `end`, at least once, and returns the number of runs.
pub async fn follow(dial: &Dial, number: u32, toml: &str, expected: &Expected, end: Instant) -> Result<u32, String> {
    let mut client = JobServiceClient::new(dial.channel());
    let mut rounds = 0;
    while rounds == 0 || Instant::now() < end {
        let wrong = |what: String| format!("job {number}, run {rounds}: {what}");
        let started = Instant::now();
        let id = submit(&mut client, &format!("soak {number} {rounds}"), toml).await.map_err(wrong)?;
        let events = watch(&mut client, &id).await.map_err(wrong)?;
        let result = patiently(&mut client, |mut client| {
            let request = GetResultRequest { id: id.clone() };
            async move { client.get_result(request).await }
        });
        let result = result.await.map_err(wrong)?;
        let job = result.job.clone().unwrap_or_default();
        let found = Expected::of(result, job);
        if found != *expected {
            return Err(wrong(format!("the result differs from that of an undisturbed run:\n{found:?}\n{expected:?}")));
        }
        let again = watch(&mut client, &id).await.map_err(wrong)?;
        if again != events {
            return Err(wrong("the events after the end differ from those received during the run".to_owned()));
        }
        rounds += 1;
        println!("        job {number} completed run {rounds} after {:.0} s", started.elapsed().as_secs_f64());
    }
    Ok(rounds)
}

type Client = JobServiceClient<FailoverChannel>;

/// Repeats a call until it is answered: the coordinator may be down or on standby.
async fn patiently<T, F>(client: &mut Client, ask: impl Fn(Client) -> F) -> Result<T, String>
where
    F: Future<Output = Result<tonic::Response<T>, Status>>,
{
    let start = Instant::now();
    loop {
        match ask(client.clone()).await {
            Ok(answer) => return Ok(answer.into_inner()),
            Err(status) if !matches!(status.code(), Code::Unavailable | Code::Unknown | Code::Cancelled) => {
                return Err(status.to_string());
            }
            Err(status) if start.elapsed() > Duration::from_secs(60) => return Err(status.to_string()),
            Err(_) => tokio::time::sleep(Duration::from_millis(100)).await,
        }
    }
}

/// Submits until the call is answered. All attempts have the same request id, so they create one job.
async fn submit(client: &mut Client, request_id: &str, toml: &str) -> Result<String, String> {
    let request =
        SubmitJobRequest { request_id: request_id.to_owned(), job_toml: toml.to_owned(), ..Default::default() };
    let answer = patiently(client, |mut client| {
        let request = request.clone();
        async move { client.submit_job(request).await }
    });
    Ok(answer.await?.job.unwrap_or_default().id)
}

/// Returns the progress of a job. It must never decrease.
fn progress(job: &Job) -> (usize, u32, u32) {
    let order = [JobState::Queued, JobState::Running, JobState::Succeeded];
    let state = order.iter().position(|state| *state == job.state()).unwrap_or(order.len());
    (state, job.rounds_sealed, job.tasks_done)
}

/// Watches a job to its end, through all disturbances of the coordinator, and returns its stored events.
async fn watch(client: &mut Client, id: &str) -> Result<Vec<JobEvent>, String> {
    let mut events: Vec<JobEvent> = Vec::new();
    let mut told = (0, 0, 0);
    let mut asked = Instant::now();
    while !events.last().is_some_and(is_last) {
        let job = patiently(client, |mut client| {
            let request = GetJobRequest { id: id.to_owned() };
            async move { client.get_job(request).await }
        });
        let job = job.await?.job.unwrap_or_default();
        if matches!(job.state(), JobState::Failed | JobState::Cancelled) {
            return Err(format!("the job failed or was cancelled: {}", job.reason));
        }
        if progress(&job) < told {
            return Err(format!(
                "progress fell from {told:?} to {:?} (state, rounds sealed, tasks done): results were lost",
                progress(&job)
            ));
        }
        told = progress(&job);
        let after = events.last().map_or(0, |e| e.sequence);
        let stream = client.watch_job(WatchJobRequest { id: id.to_owned(), after }).await;
        let Ok(mut stream) = stream.map(tonic::Response::into_inner) else { continue };
        // Leaves the stream every 500 ms to check the job's progress.
        while asked.elapsed() < Duration::from_millis(500) || events.is_empty() {
            match tokio::time::timeout(Duration::from_millis(500), stream.message()).await {
                Ok(Ok(Some(event))) if matches!(event.event, Some(Event::TasksDone(_))) => {}
                Ok(Ok(Some(event))) => {
                    let next = events.last().map_or(0, |e| e.sequence) + 1;
                    if event.sequence != next {
                        return Err(format!("received event {}, expected event {next}", event.sequence));
                    }
                    events.push(event);
                }
                // The stream ended or broke.
                Ok(Ok(None) | Err(_)) => break,
                Err(_) => {}
            }
        }
        asked = Instant::now();
    }
    Ok(events)
}
