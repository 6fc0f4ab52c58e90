//! A job through crashes: its coordinator dies at every commit of the job's life, and nothing that was told is lost.

use crate::sandbox::{PATIENCE, Process, Sandbox};
use proto::v1::{
    CancelJobRequest, GetJobRequest, GetResultRequest, Job, JobState, PauseJobRequest, ResumeJobRequest,
    SubmitJobRequest,
};
use std::process::Stdio;
use std::time::{Duration, Instant};
use tonic::Status;

/// Where a coordinator dies, see `coordinator/src/fail_point.rs`: each life commits once at most, so that every commit is
/// one at which it dies, before, in the middle of, or after it.
pub const POINTS: [&str; 4] = ["after-commit:1", "in-commit:2", "in-commit:1", "before-commit:2"];

/// What the client is after.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wish {
    /// The job's result.
    Result,
    /// To pause and resume it until so many of these have been found again after a death, and then its result.
    Pauses(u32),
    /// Its end, once a generation is sealed.
    Cancel,
}

impl Wish {
    /// Whether nobody has to die any more.
    fn is_fulfilled(self, passed: &Passed) -> bool {
        matches!(self, Self::Pauses(times) if passed.kept >= times)
    }
}

/// What became of it.
#[derive(Debug, Default)]
pub struct Passed {
    /// The result digest; empty for a cancelled job.
    pub digest: Vec<u8>,
    /// How often the coordinator died.
    pub lives: usize,
    /// Pauses and resumptions that were answered and found again after the coordinator had died.
    pub kept: u32,
    /// Those that were not answered, since it died.
    pub unanswered: u32,
}

/// What has been told to a client so far, and must never be taken back.
#[derive(Default)]
struct Told {
    job: Option<Job>,
    /// Most tasks that were told as done in the round at hand.
    round_done: u32,
    cancelled: bool,
    /// Whether it is paused, and in which life that was answered; `None` while that is in doubt.
    paused: Option<(bool, usize)>,
    /// Pauses and resumptions that were answered.
    answered: u32,
}

impl Told {
    /// Checks what is told now against what was told before.
    fn hear(&mut self, now: Job) {
        if let Some(before) = &self.job {
            assert_eq!(now.id, before.id, "the same request is the same job");
            assert!(now.last_event >= before.last_event, "{now:?} after {before:?}");
            assert!(now.rounds_sealed >= before.rounds_sealed, "{now:?} after {before:?}");
            if now.last_event == before.last_event {
                // The round is read a moment after the record: it belongs to it only if the record stands still.
                assert!(before.tasks_done >= self.round_done, "{before:?} after {} were done", self.round_done);
                self.round_done = before.tasks_done;
            } else {
                self.round_done = 0;
            }
        }
        self.job = Some(now);
    }

    /// Checks that what was answered about pausing holds. Tells whether that was before this life.
    fn hear_paused(&mut self, now: &Job, life: usize) -> bool {
        // What runs may finish, so it may end; and that ends a pause.
        if now.state() == JobState::Succeeded {
            return false;
        }
        let Some((paused, since)) = self.paused else {
            self.paused = Some((now.paused, life));
            return false;
        };
        assert_eq!(now.paused, paused, "life {life}: it was answered in life {since}");
        self.paused = Some((paused, life));
        since < life
    }
}

/// Runs a job while its coordinator dies at every commit, at these points in turn.
pub async fn through_crashes(
    sandbox: &mut Sandbox,
    arguments: &[&str],
    toml: &str,
    wish: Wish,
    points: impl IntoIterator<Item = &'static str, IntoIter: Clone>,
) -> Passed {
    sandbox.reserve_port();
    let _worker = sandbox.worker(2);
    let (mut told, mut passed) = (Told::default(), Passed::default());
    let start = Instant::now();
    for point in points.into_iter().cycle() {
        assert!(start.elapsed() < PATIENCE, "no end after {} lives", passed.lives);
        let mut command = sandbox.coordinator_command();
        command.args(arguments);
        if !wish.is_fulfilled(&passed) {
            command.env("EVOGAIT_FAIL_POINT", point);
        }
        // It may die before it says where it listens.
        let mut coordinator = Process::start(command.stdout(Stdio::null()));
        match live(sandbox, &mut coordinator, &mut told, &mut passed, toml, wish).await {
            Life::Over => return passed,
            // As if by the last of the points: what was answered is all there is.
            Life::Kill => coordinator.kill_9(),
            Life::Died => assert_eq!(coordinator.wait(), None, "it died, rather than end"),
        }
        passed.lives += 1;
    }
    unreachable!("points come without end")
}

/// How a life of a coordinator ends.
#[derive(PartialEq)]
enum Life {
    /// By itself.
    Died,
    /// By the test, to see whether what was answered last is kept.
    Kill,
    /// Never: there is what was wished for.
    Over,
}

/// One life of the coordinator: asks until it dies, or until there is nothing more to ask.
async fn live(
    sandbox: &Sandbox,
    coordinator: &mut Process,
    told: &mut Told,
    passed: &mut Passed,
    toml: &str,
    wish: Wish,
) -> Life {
    let start = Instant::now();
    while !coordinator.has_ended() {
        assert!(start.elapsed() < PATIENCE, "neither death nor result: {:?}", told.job);
        // No answer: it is about to die, or not yet there.
        if let Ok(Some(end)) = ask(sandbox, told, passed, toml, wish).await {
            return end;
        }
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    Life::Died
}

async fn ask(
    sandbox: &Sandbox,
    told: &mut Told,
    passed: &mut Passed,
    toml: &str,
    wish: Wish,
) -> Result<Option<Life>, Status> {
    let mut client = sandbox.client();
    let Some(job) = told.job.clone() else {
        let request = SubmitJobRequest { request_id: "r".to_owned(), job_toml: toml.to_owned(), priority: 0 };
        told.hear(client.submit_job(request).await?.into_inner().job.expect("an answer has the job"));
        return Ok(None);
    };
    let id = job.id;
    let answer = client.get_job(GetJobRequest { id: id.clone() }).await.inspect_err(|status| {
        assert_ne!(status.code(), tonic::Code::NotFound, "what was taken in is there");
    })?;
    let now = answer.into_inner().job.expect("an answer has the job");
    told.hear(now.clone());
    passed.kept += u32::from(told.hear_paused(&now, passed.lives));
    if told.cancelled {
        assert_eq!(now.state(), JobState::Cancelled, "cancel is final");
        return Ok(Some(Life::Over));
    }
    match wish {
        Wish::Cancel if now.rounds_sealed > 1 => {
            let answer = client.cancel_job(CancelJobRequest { id }).await?.into_inner().job.expect("the job");
            assert_eq!(answer.state(), JobState::Cancelled);
            told.cancelled = true;
            return Ok(Some(Life::Kill));
        }
        Wish::Pauses(times) if now.state() != JobState::Succeeded && (passed.kept < times || now.paused) => {
            // Until it is answered it may be so or so.
            told.paused = None;
            let answer = match now.paused {
                false => client.pause_job(PauseJobRequest { id }).await.map(|a| a.into_inner().job),
                true => client.resume_job(ResumeJobRequest { id }).await.map(|a| a.into_inner().job),
            };
            let job = answer.inspect_err(|_| passed.unanswered += 1)?.expect("an answer has the job");
            assert!(job.paused != now.paused || job.state() == JobState::Succeeded, "{job:?}");
            told.paused = Some((!now.paused, passed.lives));
            told.answered += 1;
            // Every other time nothing else comes between the answer and the death.
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

/// What a cancelled job must stand, whichever point its cancellation falls on.
pub async fn cancelled_through_crashes(new: impl Fn() -> Sandbox, arguments: &[&str], toml: &str) {
    for first in 0..POINTS.len() {
        let points = (first..first + POINTS.len()).map(|i| POINTS[i % POINTS.len()]);
        let passed = through_crashes(&mut new(), arguments, toml, Wish::Cancel, points).await;
        assert!(passed.digest.is_empty() && passed.lives >= POINTS.len(), "{passed:?}");
    }
}

/// What a job must stand that is paused and resumed; tells its result digest.
pub async fn paused_through_crashes(sandbox: &mut Sandbox, arguments: &[&str], toml: &str) -> Vec<u8> {
    let wish = Wish::Pauses(POINTS.len() as u32);
    let passed = through_crashes(sandbox, arguments, toml, wish, POINTS).await;
    assert!(passed.kept as usize >= POINTS.len(), "it ended too early: {passed:?}");
    assert!(passed.unanswered > 0, "no death fell on a pause: {passed:?}");
    passed.digest
}
