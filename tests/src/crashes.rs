//! Runs a job while its coordinator crashes at every commit of the job. All acknowledged states must survive.

use crate::sandbox::{Process, Sandbox, TIMEOUT};
use proto::v1::{
    CancelJobRequest, GetJobRequest, GetResultRequest, Job, JobState, PauseJobRequest, ResumeJobRequest,
    SubmitJobRequest,
};
use std::process::Stdio;
use std::time::{Duration, Instant};
use tonic::Status;

/// Fail points at which a coordinator crashes, see `coordinator/src/fail_point.rs`. Each process commits at most once,
/// so that it crashes at every commit: before, during or after it.
pub const POINTS: [&str; 4] = ["after-commit:1", "in-commit:2", "in-commit:1", "before-commit:2"];

/// Goal of the client.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClientGoal {
    /// Get the job's result.
    Result,
    /// Pause and resume the job until this many of these calls were found stored after a crash, then get its result.
    Pauses(u32),
    /// Cancel the job once a generation is sealed.
    Cancel,
}

impl ClientGoal {
    /// Returns true if no further crash is needed.
    fn is_fulfilled(self, passed: &Passed) -> bool {
        matches!(self, Self::Pauses(times) if passed.kept >= times)
    }
}

/// Outcome of a run.
#[derive(Debug, Default)]
pub struct Passed {
    /// Result digest; empty for a cancelled job.
    pub digest: Vec<u8>,
    /// Number of crashes.
    pub lives: usize,
    /// Pauses and resumptions that were acknowledged and found stored after a crash.
    pub kept: u32,
    /// Pauses and resumptions that failed because the coordinator crashed.
    pub unanswered: u32,
}

/// States that were reported to the client so far. They must never be lost.
#[derive(Default)]
struct Reported {
    job: Option<Job>,
    /// Largest number of done tasks reported for the current round.
    round_done: u32,
    cancelled: bool,
    /// Last acknowledged pause state and the number of the coordinator process that confirmed it. None while a call is
    /// open.
    paused: Option<(bool, usize)>,
    /// Number of acknowledged pauses and resumptions.
    answered: u32,
}

impl Reported {
    /// Checks a reported job against the reports before.
    fn hear(&mut self, now: Job) {
        if let Some(before) = &self.job {
            assert_eq!(now.id, before.id, "equal request ids must give one job");
            assert!(now.last_event >= before.last_event, "{now:?} after {before:?}");
            assert!(now.rounds_sealed >= before.rounds_sealed, "{now:?} after {before:?}");
            if now.last_event == before.last_event {
                // The coordinator reads the round after the record. The round's count belongs to the record only if the
                // record has not changed since.
                assert!(before.tasks_done >= self.round_done, "{before:?} after {} were done", self.round_done);
                self.round_done = before.tasks_done;
            } else {
                self.round_done = 0;
            }
        }
        self.job = Some(now);
    }

    /// Checks the pause state against the last acknowledged one. Returns true if that was confirmed by an earlier
    /// process.
    fn hear_paused(&mut self, now: &Job, life: usize) -> bool {
        // Running tasks may complete, so the job may end. That also ends a pause.
        if now.state() == JobState::Succeeded {
            return false;
        }
        let Some((paused, since)) = self.paused else {
            self.paused = Some((now.paused, life));
            return false;
        };
        assert_eq!(now.paused, paused, "process {life}: pause state differs from that confirmed by process {since}");
        self.paused = Some((paused, life));
        since < life
    }
}

/// Runs a job while its coordinator crashes at every commit, at the given fail points in turn.
pub async fn through_crashes(
    sandbox: &mut Sandbox,
    arguments: &[&str],
    toml: &str,
    wish: ClientGoal,
    points: impl IntoIterator<Item = &'static str, IntoIter: Clone>,
) -> Passed {
    sandbox.reserve_port();
    let _worker = sandbox.worker(2);
    let (mut told, mut passed) = (Reported::default(), Passed::default());
    let start = Instant::now();
    for point in points.into_iter().cycle() {
        assert!(start.elapsed() < TIMEOUT, "the job did not end after {} crashes", passed.lives);
        let mut command = sandbox.coordinator_command();
        command.args(arguments);
        if !wish.is_fulfilled(&passed) {
            command.env("EVOGAIT_FAIL_POINT", point);
        }
        // The coordinator may crash before it prints its address.
        let mut coordinator = Process::start(command.stdout(Stdio::null()));
        match live(sandbox, &mut coordinator, &mut told, &mut passed, toml, wish).await {
            Life::Over => return passed,
            // Like `after-commit`: only the answer has been sent, and nothing else since.
            Life::Kill => coordinator.kill_9(),
            Life::Died => assert_eq!(coordinator.wait(), None, "the coordinator must crash, not exit"),
        }
        passed.lives += 1;
    }
    unreachable!("the points repeat without end")
}

/// End of a coordinator process.
#[derive(PartialEq)]
enum Life {
    /// Crash at a fail point.
    Died,
    /// Kill by the test, to check that the last answer is stored.
    Kill,
    /// The goal is reached.
    Over,
}

/// Calls the coordinator until it crashes or the goal is reached.
async fn live(
    sandbox: &Sandbox,
    coordinator: &mut Process,
    told: &mut Reported,
    passed: &mut Passed,
    toml: &str,
    wish: ClientGoal,
) -> Life {
    let start = Instant::now();
    while !coordinator.has_ended() {
        assert!(start.elapsed() < TIMEOUT, "neither a crash nor a result in time: {:?}", told.job);
        // An error means that the coordinator is about to crash or does not listen yet.
        if let Ok(Some(end)) = ask(sandbox, told, passed, toml, wish).await {
            return end;
        }
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    Life::Died
}

async fn ask(
    sandbox: &Sandbox,
    told: &mut Reported,
    passed: &mut Passed,
    toml: &str,
    wish: ClientGoal,
) -> Result<Option<Life>, Status> {
    let mut client = sandbox.client();
    let Some(job) = told.job.clone() else {
        let request = SubmitJobRequest { request_id: "r".to_owned(), job_toml: toml.to_owned(), priority: 0 };
        told.hear(client.submit_job(request).await?.into_inner().job.expect("the response has the job"));
        return Ok(None);
    };
    let id = job.id;
    let answer = client.get_job(GetJobRequest { id: id.clone() }).await.inspect_err(|status| {
        assert_ne!(status.code(), tonic::Code::NotFound, "an acknowledged job must be stored");
    })?;
    let now = answer.into_inner().job.expect("the response has the job");
    told.hear(now.clone());
    passed.kept += u32::from(told.hear_paused(&now, passed.lives));
    if told.cancelled {
        assert_eq!(now.state(), JobState::Cancelled, "a cancelled job must stay cancelled");
        return Ok(Some(Life::Over));
    }
    match wish {
        ClientGoal::Cancel if now.rounds_sealed > 1 => {
            let answer =
                client.cancel_job(CancelJobRequest { id }).await?.into_inner().job.expect("the response has the job");
            assert_eq!(answer.state(), JobState::Cancelled);
            told.cancelled = true;
            return Ok(Some(Life::Kill));
        }
        ClientGoal::Pauses(times) if now.state() != JobState::Succeeded && (passed.kept < times || now.paused) => {
            // Until the call is answered, either state is valid.
            told.paused = None;
            let answer = match now.paused {
                false => client.pause_job(PauseJobRequest { id }).await.map(|a| a.into_inner().job),
                true => client.resume_job(ResumeJobRequest { id }).await.map(|a| a.into_inner().job),
            };
            let job = answer.inspect_err(|_| passed.unanswered += 1)?.expect("the response has the job");
            assert!(job.paused != now.paused || job.state() == JobState::Succeeded, "{job:?}");
            told.paused = Some((!now.paused, passed.lives));
            told.answered += 1;
            // After every other answer the coordinator is killed at once.
            return Ok((told.answered % 2 == 1).then_some(Life::Kill));
        }
        _ => {}
    }
    assert_ne!(now.state(), JobState::Failed, "{}", now.reason);
    if now.state() == JobState::Succeeded {
        passed.digest = client.get_result(GetResultRequest { id }).await?.into_inner().result_digest;
        return Ok(Some(Life::Over));
    }
    Ok(None)
}

/// Checks that a cancelled job stays cancelled, with its cancellation at each of the fail points in turn.
pub async fn cancelled_through_crashes(new: impl Fn() -> Sandbox, arguments: &[&str], toml: &str) {
    for first in 0..POINTS.len() {
        let points = (first..first + POINTS.len()).map(|i| POINTS[i % POINTS.len()]);
        let passed = through_crashes(&mut new(), arguments, toml, ClientGoal::Cancel, points).await;
        assert!(passed.digest.is_empty() && passed.lives >= POINTS.len(), "{passed:?}");
    }
}

/// Checks that pauses and resumptions survive crashes, and returns the result digest.
pub async fn paused_through_crashes(sandbox: &mut Sandbox, arguments: &[&str], toml: &str) -> Vec<u8> {
    let wish = ClientGoal::Pauses(POINTS.len() as u32);
    let passed = through_crashes(sandbox, arguments, toml, wish, POINTS).await;
    assert!(passed.kept as usize >= POINTS.len(), "the job ended before enough pauses were checked: {passed:?}");
    assert!(passed.unanswered > 0, "no crash interrupted a pause: {passed:?}");
    passed.digest
}
