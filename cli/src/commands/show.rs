//! `evogait show`: one job of a coordinator.

use crate::arguments::Show;
use crate::client::Client;
use crate::console::{self, count};
use crate::error::Error;
use crate::progress::Label;
use crate::setting::Setting;
use crate::standing::{self, StandingView};
use crate::view::{JobView, hex, running_time};
use crate::watch::phase;
use proto::v1::JobState;
use serde::Serialize;
use sim_core::job::JobSpec;

/// A job and, unless it has ended, where it stands.
#[derive(Serialize)]
struct ShowView {
    #[serde(flatten)]
    job: JobView,
    #[serde(skip_serializing_if = "Option::is_none")]
    standing: Option<StandingView>,
}

/// Prints a job's facts, or its file.
pub async fn run(args: Show) -> Result<(), Error> {
    let mut client = Client::connect(&args.job.on).await?;
    let (job, job_toml, standing) = client.standing(&args.job.id).await?;
    if args.toml {
        return console::say(&job_toml);
    }
    if args.job.json {
        return console::say_json(&ShowView {
            job: JobView::new(&job),
            standing: standing.as_ref().map(StandingView::new),
        });
    }
    let label = Label::of_toml(&job_toml);
    let engine = toml_engine(&job_toml);
    let counts = job.counts.unwrap_or_default();
    let because = if job.reason.is_empty() { String::new() } else { format!(": {}", job.reason) };
    let best = job.best.as_ref().map_or_else(
        || "none yet".to_owned(),
        |best| {
            let score = console::score_with(best.score, &label.unit);
            format!("{} {score} (generation {}, candidate {})", label.name, best.generation, best.candidate)
        },
    );
    let mut lines = vec![
        format!("{} ({})", job.name, job.id),
        format!("  state          {}{because}", phase(job.state(), job.round_done, job.round_total)),
        format!(
            "  generations    {} of {}, {} candidates each",
            job.generations_done, job.generations_total, job.population
        ),
        format!("  best           {best}"),
        format!(
            "  evaluations    {} ({} failed), {} rollouts, {} of simulated time",
            count(job.evaluations),
            count(job.failed_evaluations),
            count(counts.rollouts),
            console::seconds(counts.simulated_ms as f64 / 1000.0)
        ),
        format!("  submitted      {} UTC, ran {}", console::moment(job.submitted_at_ms), running_time(&job)),
        format!("  priority       {}", job.priority),
        format!("  engine         {engine}"),
        format!("  job digest     {}", hex(&job.job_digest)),
        format!("  engine digest  {}", hex(&job.engine_digest)),
    ];
    if let Some(standing) = &standing {
        lines.extend(standing::lines(&job, standing));
    }
    match job.state() {
        JobState::Succeeded => lines.push(format!("  next           evogait fetch {}", job.id)),
        JobState::Queued | JobState::Running | JobState::Finishing | JobState::Reporting => {
            lines.push(format!("  next           evogait watch {}", job.id));
        }
        _ => {}
    }
    console::say(&lines.join("\n"))
}

/// Engine and setting of a job that was submitted, as a word; the text is resolved.
fn toml_engine(job_toml: &str) -> String {
    let spec: Option<JobSpec> = toml::from_str(job_toml).ok();
    spec.as_ref().and_then(|spec| Setting::of_resolved(&spec.physics)).map_or("–".to_owned(), |s| s.to_string())
}
