//! Watches a job's events to its end, across lost connections and restarts of the coordinator.

use crate::client::{Client, is_connection};
use crate::console;
use crate::error::Error;
use crate::signals::Interrupt;
use crate::values;
use proto::dial::Backoff;
use proto::v1::{self, JobEvent, JobState};
use std::time::{Duration, Instant};
use tonic::Status;

/// Time without a coordinator after which watching fails.
const TIMEOUT: Duration = Duration::from_secs(600);

/// End of watching.
pub enum Watched {
    /// The job has ended: succeeded, failed, cancelled or tainted.
    Ended(Box<v1::Job>),
    /// The user interrupted the watching; the job continues.
    Interrupted,
}

/// Watches the job with this id; `observe` receives every event once, in order.
pub async fn watch(
    client: &mut Client,
    id: &str,
    interrupt: &Interrupt,
    observe: impl FnMut(&JobEvent) -> Result<(), Error>,
) -> Result<Watched, Error> {
    tokio::select! {
        () = interrupt.wait() => Ok(Watched::Interrupted),
        ended = to_the_end(client, id, observe) => ended.map(|job| Watched::Ended(Box::new(job))),
    }
}

async fn to_the_end(
    client: &mut Client,
    id: &str,
    mut observe: impl FnMut(&JobEvent) -> Result<(), Error>,
) -> Result<v1::Job, Error> {
    let mut after = 0;
    let mut backoff = Backoff::new();
    let mut lost: Option<Instant> = None;
    loop {
        let mut there = false;
        let broken = match stream(client, id, &mut after, &mut there, &mut observe).await {
            Ok(()) => match client.get(id).await {
                Ok((job, _)) if has_ended(job.state()) => return Ok(job),
                Ok(_) => Status::unavailable("the stream of events ended before the job"),
                Err(Error::Unreachable { reason, .. }) => Status::unavailable(reason),
                Err(error) => return Err(error),
            },
            Err(Broken::Observer(error)) => return Err(error),
            Err(Broken::Stream(status)) => status,
        };
        if !is_connection(&broken) {
            return Err(client.error(&broken, Some(id)));
        }
        // The coordinator answered, even if it sent no new event.
        if there {
            lost = None;
            backoff.reset();
        }
        match lost {
            Some(since) if since.elapsed() > TIMEOUT => return Err(client.error(&broken, Some(id))),
            Some(_) => {}
            None => {
                lost = Some(Instant::now());
                console::note(&format!("lost the coordinator at {}, reconnecting", client.url()));
            }
        }
        backoff.wait().await;
    }
}

enum Broken {
    Stream(Status),
    Observer(Error),
}

async fn stream(
    client: &mut Client,
    id: &str,
    after: &mut u64,
    there: &mut bool,
    observe: &mut impl FnMut(&JobEvent) -> Result<(), Error>,
) -> Result<(), Broken> {
    let mut events = client.watch(id, *after).await.map_err(Broken::Stream)?;
    *there = true;
    while let Some(event) = events.message().await.map_err(Broken::Stream)? {
        observe(&event).map_err(Broken::Observer)?;
        *after = event.sequence.max(*after);
    }
    Ok(())
}

/// Returns true if a job never leaves this state.
pub fn has_ended(state: JobState) -> bool {
    matches!(state, JobState::Succeeded | JobState::Failed | JobState::Cancelled | JobState::Tainted)
}

/// Returns the name of a state, as accepted by `--state`.
pub fn word(state: JobState) -> &'static str {
    match state {
        JobState::Unspecified => "unknown",
        JobState::Queued => "queued",
        JobState::Running => "running",
        JobState::Waiting => "waiting",
        JobState::Succeeded => "succeeded",
        JobState::Failed => "failed",
        JobState::Cancelled => "cancelled",
        JobState::Tainted => "tainted",
    }
}

/// Formats a job's state and its progress in the current round, such as "running, finishing 7/24" or "queued, paused".
pub fn standing(job: &v1::Job) -> String {
    let mut text = word(job.state()).to_owned();
    if job.state() == JobState::Running && job.tasks_total > 0 {
        text += &format!(", {}", phase(&values::progress(job).phase, job.tasks_done, job.tasks_total));
    }
    text + if job.paused { ", paused" } else { "" }
}

/// Formats the progress in a round of a phase, such as "finishing 7/24".
pub fn phase(phase: &str, done: u32, total: u32) -> String {
    format!("{phase} {done}/{total}")
}

/// Returns the best score of a job so far.
pub fn best(job: &v1::Job) -> Option<f64> {
    values::number(&job.progress.as_ref()?.values, "best")
}

/// Fails if the job has no result.
pub fn succeeded(job: &v1::Job) -> Result<(), Error> {
    if job.state() == JobState::Succeeded {
        return Ok(());
    }
    let because = if job.reason.is_empty() { String::new() } else { format!(": {}", job.reason) };
    let how = match job.state() {
        JobState::Failed => format!("failed{because}"),
        JobState::Cancelled => format!("was cancelled{because}"),
        JobState::Tainted => format!("is tainted{because}"),
        state => format!("has not ended: it is {}{because}", word(state)),
    };
    Err(Error::JobEnded { name: job.name.clone(), id: job.id.clone(), how })
}

/// Same as [`succeeded`], with a hint for the user on a line below the error.
pub fn succeeded_or(job: &v1::Job, hint: Option<String>) -> Result<(), Error> {
    succeeded(job).map_err(|error| match (error, hint) {
        (Error::JobEnded { name, id, how }, Some(hint)) => Error::JobEnded { name, id, how: format!("{how}\n{hint}") },
        (error, _) => error,
    })
}
