//! `evogait watch`: shows the progress of a job on a coordinator.

use crate::arguments::OneJob;
use crate::client::Client;
use crate::console;
use crate::error::Error;
use crate::failed_task;
use crate::first_generation::{self, Scores};
use crate::progress::{Label, Progress};
use crate::signals::Interrupt;
use crate::values::{self, Generation};
use crate::view::{DisputeView, JobView};
use crate::watch::{self, Watched, word};
use proto::v1::JobEvent;
use proto::v1::job_event::Event;
use serde::Serialize;
use sim_core::problem::Checked;

/// Event as a line of JSON.
#[derive(Serialize)]
struct EventView {
    sequence: u64,
    at_ms: i64,
    #[serde(flatten)]
    what: What,
}

#[derive(Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
enum What {
    State { state: &'static str },
    Generation { generation: u32, min: f64, median: f64, max: f64, mean: f64, best_so_far: Option<f64>, failed: u32 },
    Round { round: u32, phase: String },
    Progress { state: &'static str, phase: String, generation: u32, done: u32, total: u32 },
    Paused,
    Resumed,
    Dispute(DisputeView),
    Waits { reason: String },
}

/// Shows the progress of the job until it ends.
pub async fn run(args: OneJob, quiet: bool) -> Result<(), Error> {
    let interrupt = Interrupt::listen();
    let mut client = Client::connect(&args.on).await?;
    let (status, job_toml) = client.get(&args.id).await?;
    let label = Label::of_toml(&job_toml);
    let mut progress = Progress::new(&status, &label, quiet || args.json);
    let watched = watch::watch(&mut client, &args.id, &interrupt, |event| {
        progress.observe(event);
        if let Some(scores) = Scores::of_event(event)
            && let Some(warning) = first_generation::warning(Checked::from_toml(&job_toml).ok().as_ref(), &scores)
        {
            match args.json {
                true if !quiet => console::warn(&warning),
                _ => progress.warn(&warning),
            }
        }
        match view(event) {
            Some(view) if args.json => console::say_json_line(&view),
            _ => Ok(()),
        }
    })
    .await;
    progress.finish();
    match watched? {
        Watched::Interrupted => Err(Error::Interrupted {
            hint: format!(
                "; the job continues, `evogait watch {}` shows its progress again",
                console::quoted(&args.id)
            ),
        }),
        Watched::Ended(job) => {
            if args.json {
                console::say_json_line(&JobView::new(&job))?;
            }
            let see = job.poisoned.as_ref().map(|p| {
                format!("to repeat the failure on this machine: {}", failed_task::command_for_remote_job(&job.id, p))
            });
            watch::succeeded_or(&job, see)?;
            if args.json || quiet {
                return Ok(());
            }
            let best = console::score_with(watch::best(&job), &label.unit);
            console::say(&format!(
                "{}: the best {} is {best} after {} {}\n  next  evogait fetch {}",
                job.name,
                label.name,
                values::progress(&job).done,
                values::progress(&job).unit,
                console::quoted(&job.id)
            ))
        }
    }
}

fn view(event: &JobEvent) -> Option<EventView> {
    let what = match event.event.as_ref()? {
        Event::StateChanged(state) => What::State { state: word((*state).try_into().unwrap_or_default()) },
        Event::RoundSealed(sealed) => match Generation::sealed(event) {
            Some(g) => What::Generation {
                generation: g.generation,
                min: g.min,
                median: g.median,
                max: g.max,
                mean: g.mean,
                best_so_far: g.best_so_far,
                failed: g.failed,
            },
            None => What::Round { round: sealed.round, phase: sealed.phase.clone() },
        },
        Event::TasksDone(tasks) => {
            let job = event.job.clone().unwrap_or_default();
            let progress = values::progress(&job);
            What::Progress {
                state: word(job.state()),
                phase: progress.phase,
                generation: progress.done,
                done: tasks.done,
                total: tasks.total,
            }
        }
        Event::Paused(true) => What::Paused,
        Event::Paused(false) => What::Resumed,
        Event::Dispute(dispute) => What::Dispute(DisputeView::new(dispute)),
        Event::Waits(reason) => What::Waits { reason: reason.clone() },
    };
    Some(EventView { sequence: event.sequence, at_ms: event.at_ms, what })
}
