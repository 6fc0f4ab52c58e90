//! `evogait show`: one job of a coordinator.

use crate::arguments::Show;
use crate::client::Client;
use crate::console::{self, count, quoted};
use crate::error::Error;
use crate::poison;
use crate::progress::Label;
use crate::setting::Setting;
use crate::standing::{self, StandingView};
use crate::view::{JobView, bits, hex, ruling, running_time};
use crate::watch;
use proto::v1::{self, JobState};
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
        format!("  state          {}{because}", watch::standing(&job)),
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
    if let Some(origin) = &job.restarted_from {
        let what = match origin.generations {
            0 => "nothing of it was taken over".to_owned(),
            n => format!("generations 0 to {} were taken over", n - 1),
        };
        lines.push(format!("  does again     {}: {what}", origin.job_id));
    }
    lines.extend(job.disputes.iter().map(dispute));
    if let Some(poisoned) = &job.poisoned {
        lines.push(format!("  failed         {}, {} times", poison::what(poisoned), poisoned.attempts));
        lines.push(format!("  genome         {}", poison::genome(poisoned)));
        lines.push(format!("  next           {} does it again here", poison::command_there(&job.id)));
    }
    match job.state() {
        JobState::Tainted => lines.push(format!("  next           evogait restart {}", quoted(&job.id))),
        JobState::Succeeded => lines.push(format!("  next           evogait fetch {}", quoted(&job.id))),
        JobState::Queued | JobState::Running | JobState::Finishing | JobState::Reporting => {
            lines.push(format!("  next           evogait watch {}", quoted(&job.id)));
        }
        _ => {}
    }
    console::say(&lines.join("\n"))
}

/// Who said what about a task, and what became of it.
fn dispute(dispute: &v1::Dispute) -> String {
    let claim = |claim: &v1::Claim| {
        let who = if claim.worker_name.is_empty() { "a worker that has gone" } else { &claim.worker_name };
        let said: Vec<String> = claim
            .scores
            .iter()
            .map(|s| match s.score {
                Some(score) => format!("{score} ({})", bits(s.score)),
                None => bits(None),
            })
            .collect();
        format!("{who} says {}", if said.is_empty() { "other traces".to_owned() } else { said.join(" ") })
    };
    let claims: Vec<String> = dispute.claims.iter().map(claim).collect();
    format!("  dispute        {}, {}: {}", dispute.what, ruling(dispute), claims.join("; "))
}

/// Engine and setting of a job that was submitted, as a word; the text is resolved.
fn toml_engine(job_toml: &str) -> String {
    let spec: Option<JobSpec> = toml::from_str(job_toml).ok();
    spec.as_ref().and_then(|spec| Setting::of_resolved(&spec.physics)).map_or("–".to_owned(), |s| s.to_string())
}
