//! A job through crashes: its coordinator dies at every commit of the job's life, and nothing that was told is lost.

use crate::sandbox::{PATIENCE, Process, Sandbox};
use proto::v1::{CancelJobRequest, GetJobRequest, GetResultRequest, Job, JobState, SubmitJobRequest};
use std::process::Stdio;
use std::time::{Duration, Instant};

/// Where a coordinator dies, see `coordinator/src/fail_point.rs`: each life commits once at most, so that every commit is
/// one at which it dies, before, in the middle of, or after it.
pub const POINTS: [&str; 4] = ["after-commit:1", "in-commit:2", "in-commit:1", "before-commit:2"];

/// What has been told to a client so far, and must never be taken back.
#[derive(Default)]
struct Told {
    job: Option<Job>,
    /// Most tasks that were told as done in the round at hand.
    round_done: u32,
    cancelled: bool,
}

impl Told {
    /// Checks what is told now against what was told before.
    fn hear(&mut self, now: Job) {
        if let Some(before) = &self.job {
            assert_eq!(now.id, before.id, "the same request is the same job");
            assert!(now.last_event >= before.last_event, "{now:?} after {before:?}");
            assert!(now.generations_done >= before.generations_done, "{now:?} after {before:?}");
            if now.last_event == before.last_event {
                // The round is read a moment after the record: it belongs to it only if the record stands still.
                assert!(before.round_done >= self.round_done, "{before:?} after {} were done", self.round_done);
                self.round_done = before.round_done;
            } else {
                self.round_done = 0;
            }
        }
        self.job = Some(now);
    }
}

/// Runs a job, or cancels it once a generation is sealed, while its coordinator dies at every commit. Tells the result
/// digest, empty for a cancelled one, and how often it died.
pub async fn through_crashes(sandbox: &mut Sandbox, arguments: &[&str], toml: &str, cancel: bool) -> (Vec<u8>, usize) {
    sandbox.reserve_port();
    let _worker = sandbox.worker(2);
    let mut told = Told::default();
    let start = Instant::now();
    for life in 0.. {
        assert!(start.elapsed() < PATIENCE, "no end after {life} lives");
        let mut command = sandbox.coordinator_command();
        command.args(arguments).env("EVOGAIT_FAIL_POINT", POINTS[life % POINTS.len()]);
        // It may die before it says where it listens.
        let mut coordinator = Process::start(command.stdout(Stdio::null()));
        if let Some(digest) = live(sandbox, &mut coordinator, &mut told, toml, cancel).await {
            return (digest, life);
        }
        assert_eq!(coordinator.wait(), None, "it died, rather than end");
    }
    unreachable!("lives are counted without end")
}

/// One life of the coordinator: asks until it dies, or until there is a result.
async fn live(
    sandbox: &Sandbox,
    coordinator: &mut Process,
    told: &mut Told,
    toml: &str,
    cancel: bool,
) -> Option<Vec<u8>> {
    let start = Instant::now();
    while !coordinator.has_ended() {
        assert!(start.elapsed() < PATIENCE, "neither death nor result: {:?}", told.job);
        if let Some(digest) = ask(sandbox, told, toml, cancel).await {
            return Some(digest);
        }
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    None
}

async fn ask(sandbox: &Sandbox, told: &mut Told, toml: &str, cancel: bool) -> Option<Vec<u8>> {
    let mut client = sandbox.client();
    let Some(job) = told.job.clone() else {
        let request = SubmitJobRequest { request_id: "r".to_owned(), job_toml: toml.to_owned(), priority: 0 };
        told.hear(client.submit_job(request).await.ok()?.into_inner().job?);
        return None;
    };
    let now = match client.get_job(GetJobRequest { id: job.id.clone() }).await {
        Ok(answer) => answer.into_inner().job?,
        Err(status) => {
            assert_ne!(status.code(), tonic::Code::NotFound, "what was taken in is there");
            return None;
        }
    };
    told.hear(now.clone());
    if told.cancelled {
        assert_eq!(now.state(), JobState::Cancelled, "cancel is final");
        return Some(Vec::new());
    }
    if cancel && now.generations_done > 0 {
        let answer = client.cancel_job(CancelJobRequest { id: job.id }).await.ok()?.into_inner().job?;
        assert_eq!(answer.state(), JobState::Cancelled);
        told.cancelled = true;
        return None;
    }
    assert_ne!(now.state(), JobState::Failed, "{}", now.reason);
    if now.state() != JobState::Succeeded {
        return None;
    }
    Some(client.get_result(GetResultRequest { id: job.id }).await.ok()?.into_inner().result_digest)
}
