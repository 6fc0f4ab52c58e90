//! `evogait list`: the jobs of a coordinator.

use crate::arguments::{List, State};
use crate::client::Client;
use crate::console::{self, table};
use crate::error::Error;
use crate::values;
use crate::view::{JobView, running_time};
use crate::watch::{best, standing};
use proto::v1::JobState;

/// Prints the jobs, newest first.
pub async fn run(args: List) -> Result<(), Error> {
    let mut client = Client::connect(&args.on).await?;
    let states: Vec<JobState> = args.states.iter().map(|&state| wire(state)).collect();
    let jobs = client.list(&states, args.limit).await?;
    if args.json {
        return console::say_json(&jobs.iter().map(JobView::new).collect::<Vec<_>>());
    }
    if jobs.is_empty() {
        return console::say(&format!("no jobs at {}: `evogait submit JOB.toml` adds one", args.on));
    }
    let rows: Vec<Vec<String>> = jobs
        .iter()
        .map(|job| {
            let progress = values::progress(job);
            vec![
                job.id.clone(),
                job.name.clone(),
                standing(job),
                format!("{}/{}", progress.done, progress.total),
                console::score_with(best(job), ""),
                running_time(job),
                console::moment(job.submitted_at_ms),
                job.reason.clone(),
            ]
        })
        .collect();
    console::say(&table(&["id", "name", "state", "generation", "best", "time", "submitted (UTC)", "reason"], &rows))
}

fn wire(state: State) -> JobState {
    match state {
        State::Queued => JobState::Queued,
        State::Running => JobState::Running,
        State::Waiting => JobState::Waiting,
        State::Succeeded => JobState::Succeeded,
        State::Failed => JobState::Failed,
        State::Cancelled => JobState::Cancelled,
        State::Tainted => JobState::Tainted,
    }
}
