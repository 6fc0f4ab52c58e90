//! `evogait show`: state and facts of one job of a coordinator.

use crate::arguments::Show;
use crate::client::Client;
use crate::console::{self, quoted};
use crate::error::Error;
use crate::failed_task::{self, Subject};
use crate::progress::Label;
use crate::standing::{self, StandingView};
use crate::summary;
use crate::values::{self, count, number};
use crate::view::{JobView, generations, hex, ruling, running_time};
use crate::watch;
use proto::v1::{self, JobState};
use serde::Serialize;
use sim_core::job::JobSpec;
use study::setting::PhysicsSetting;

/// A job and, unless it has ended, its current tasks.
#[derive(Serialize)]
struct ShowView {
    #[serde(flatten)]
    job: JobView,
    #[serde(skip_serializing_if = "Option::is_none")]
    standing: Option<StandingView>,
}

/// Prints the facts of a job, or its job file.
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
    let spec: Option<JobSpec> = toml::from_str(&job_toml).ok();
    // The text is that of a resolved job.
    let setting = spec.as_ref().and_then(|spec| PhysicsSetting::of_resolved(&spec.physics));
    let optimiser = spec.as_ref().and_then(|spec| spec.optimiser.as_ref());
    let candidates =
        optimiser.map_or_else(String::new, |optimiser| format!(", {} each", summary::candidates(optimiser)));
    let v1::Progress { done, total, unit, values, .. } = values::progress(&job);
    let counts = values::counts(&values);
    let because = if job.reason.is_empty() { String::new() } else { format!(": {}", job.reason) };
    let best = number(&values, "best").map_or_else(
        || "none yet".to_owned(),
        |best| {
            let score = console::score_with(Some(best), &label.unit);
            let whose = number(&values, "best_generation").map_or_else(String::new, |generation| {
                format!(" (generation {generation}, candidate {})", count(&values, "best_candidate"))
            });
            format!("{} {score}{whose}", label.name)
        },
    );
    let mut lines = vec![
        format!("{} ({})", job.name, job.id),
        format!("  state          {}{because}", watch::standing(&job)),
        format!("  {unit:<13}  {done} of {total}{candidates}"),
        format!("  best           {best}"),
        format!(
            "  evaluations    {} ({} failed), {} rollouts, {} of simulated time",
            console::count(count(&values, "evaluations")),
            console::count(count(&values, "failed")),
            console::count(counts.rollouts),
            console::seconds(counts.simulated_ms as f64 / 1000.0)
        ),
        format!("  submitted      {} UTC, ran {}", console::moment(job.submitted_at_ms), running_time(&job)),
        format!("  priority       {}", job.priority),
        format!("  engine         {}", setting.map_or("–".to_owned(), |s| s.to_string())),
        format!("  job digest     {}", hex(&job.job_digest)),
        format!("  engine digest  {}", hex(&job.engine_digest)),
    ];
    if let Some(standing) = &standing {
        lines.extend(standing::lines(&job, standing));
    }
    if let Some(origin) = &job.restarted_from {
        let what = match generations(origin) {
            0 => "nothing of it was taken over".to_owned(),
            n => format!("generations 0 to {} were taken over", n - 1),
        };
        lines.push(format!("  repeats        {}: {what}", origin.job_id));
    }
    lines.extend(job.disputes.iter().map(dispute));
    if let Some(poisoned) = &job.poisoned {
        lines.push(format!("  failed         {}, {} times", poisoned.what, poisoned.attempts));
        lines.extend(Subject::of(poisoned).map(|subject| format!("  genome         {}", subject.genotype())));
        lines.push(format!(
            "  next           {} repeats it on this machine",
            failed_task::command_for_remote_job(&job.id, poisoned)
        ));
    }
    match job.state() {
        JobState::Tainted => lines.push(format!("  next           evogait restart {}", quoted(&job.id))),
        JobState::Succeeded => lines.push(format!("  next           evogait fetch {}", quoted(&job.id))),
        JobState::Queued | JobState::Running | JobState::Waiting => {
            lines.push(format!("  next           evogait watch {}", quoted(&job.id)));
        }
        _ => {}
    }
    console::say(&lines.join("\n"))
}

/// Returns the line about a dispute: its task, the ruling, and the result of each worker.
fn dispute(dispute: &v1::Dispute) -> String {
    let claim = |claim: &v1::Claim| {
        let who = if claim.worker_name.is_empty() { "a worker that has left" } else { &claim.worker_name };
        match claim.what.as_str() {
            "" => format!("{who}: {}", hex(&claim.digest)),
            what => format!("{who}: {what}"),
        }
    };
    let claims: Vec<String> = dispute.claims.iter().map(claim).collect();
    format!("  dispute        {}, {}: {}", dispute.what, ruling(dispute), claims.join("; "))
}
