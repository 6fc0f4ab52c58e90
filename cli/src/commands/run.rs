//! `evogait run`: a whole job on this machine or on a coordinator's workers.

use crate::arguments::{Place, Run, RunTo};
use crate::client::{Client, Url};
use crate::console;
use crate::error::Error;
use crate::failed_task;
use crate::first_generation::{self, Scores};
use crate::local::Local;
use crate::output::{self, Finished, Folder, JOB, STORE};
use crate::plausibility;
use crate::progress::{Label, Progress};
use crate::signals::Interrupt;
use crate::values;
use crate::watch::{self, Watched};
use crate::{load, summary};
use proto::v1::{self, JobState};
use sim_core::problem::{Checked, JobKind, JobSpec};
use study::setting::PhysicsSetting;

/// Runs a job file.
pub fn run(args: Run, quiet: bool) -> Result<(), Error> {
    carry_out(&load::checked(&args.file)?, args.to, quiet)
}

/// Runs a job, or reports its result if it is done already.
pub fn carry_out(job: &Checked, to: RunTo, quiet: bool) -> Result<(), Error> {
    let digest = job.digest();
    let path = to.out.unwrap_or_else(|| Folder::default_path(&job.spec().name, &digest));
    let mut folder = Folder::open(&path, &digest)?;
    let result = if folder.is_done() {
        if !quiet {
            console::note(&format!("this job is already done: its result is in {}", path.display()));
        }
        output::finished(&path, job)?
    } else {
        let fresh = !folder.has_job();
        let job_toml = folder.keep_job(job.to_toml())?.to_owned();
        match super::with_runtime(wait_for(job, job_toml, &folder, &to.place, quiet)) {
            Ok(result) => result,
            Err(error) => {
                if fresh && matches!(error, Error::Unprepared { .. }) {
                    folder.discard();
                }
                return Err(error);
            }
        }
    };
    if to.json {
        console::say_json(&result)
    } else if quiet {
        Ok(())
    } else {
        console::say(&summary::text(&result, &path))
    }
}

async fn wait_for(
    job: &Checked,
    job_toml: String,
    folder: &Folder,
    place: &Place,
    quiet: bool,
) -> Result<Finished, Error> {
    let interrupt = Interrupt::listen();
    match place {
        Place::There { url, from_environment } => {
            if *from_environment && !quiet {
                console::note(&format!(
                    "using the workers of {url} from EVOGAIT_COORDINATOR; to run on this machine add --workers N"
                ));
            }
            finish(job, job_toml, folder, url, quiet, &interrupt).await.map_err(|error| match error {
                Error::Interrupted { hint } => Error::Interrupted {
                    hint: format!("{hint}; the job continues at {url}, and the same command shows its progress again"),
                },
                other => other,
            })
        }
        Place::Here { slots } => {
            let mut local = Local::start(&folder.path().join(STORE), *slots).await?;
            let url = local.url().clone();
            let finished = tokio::select! {
                finished = finish(job, job_toml, folder, &url, quiet, &interrupt) => finished,
                error = local.broken() => Err(error),
            };
            let stopped = local.stop().await;
            let finished = finished.and_then(|result| stopped.map(|()| result));
            finished.map_err(|error| match error {
                Error::Interrupted { hint } => {
                    Error::Interrupted { hint: format!("{hint}; the same command continues from there") }
                }
                other => other,
            })
        }
    }
}

/// Submits the job, watches it and writes its result. A repeated call finds the same job by its digest.
async fn finish(
    job: &Checked,
    job_toml: String,
    folder: &Folder,
    url: &Url,
    quiet: bool,
    interrupt: &Interrupt,
) -> Result<Finished, Error> {
    let mut client = Client::connect(url).await?;
    let request = v1::SubmitJobRequest { request_id: job.digest().to_string(), job_toml, priority: 0 };
    let (status, created) = client.submit(request).await?;
    if !quiet {
        let how = match (created, job.kind()) {
            (true, JobKind::Evolve) => "evolving",
            (true, JobKind::Plan) => "planning",
            (true, JobKind::Simulate) => "simulating",
            (false, _) => "continuing",
        };
        console::note(&format!(
            "{how} \"{}\" in {}: {} on {} ({})",
            status.name,
            folder.path().display(),
            amount(job),
            PhysicsSetting::of(job),
            job.chosen()
        ));
        plausibility::warnings(job).iter().for_each(|doubt| console::note(&format!("warning: {doubt}")));
    }
    let mut progress = Progress::new(&status, &Label::of_job(job), quiet);
    let mut progress_so_far = values::progress(&status);
    let watched = watch::watch(&mut client, &status.id, interrupt, |event| {
        progress.observe(event);
        if let Some(job) = &event.job {
            progress_so_far = values::progress(job);
        }
        if let Some(warning) = Scores::of_event(event).and_then(|scores| first_generation::warning(Some(job), &scores))
        {
            progress.warn(&warning);
        }
        Ok(())
    })
    .await;
    progress.finish();
    match watched? {
        Watched::Interrupted => {
            let v1::Progress { done, total, unit, .. } = progress_so_far;
            Err(Error::Interrupted { hint: format!(" after {done} of {total} {unit}") })
        }
        Watched::Ended(ended)
            if ended.state() == JobState::Failed && ended.poisoned.is_none() && unprepared(&ended) =>
        {
            let v1::Job { name, id, reason, .. } = *ended;
            Err(Error::Unprepared { name, id, reason })
        }
        Watched::Ended(ended) => {
            let see = ended.poisoned.as_ref().map(|poisoned| {
                let file = folder.path().join(JOB);
                format!("to repeat the failure: {}", failed_task::command_for_job_file(&file, poisoned))
            });
            watch::succeeded_or(&ended, see)?;
            let answer = client.result(&ended.id).await?;
            output::write(folder, job, &answer, url)
        }
    }
}

/// Returns the size of a job, as text for the user.
fn amount(job: &Checked) -> String {
    let JobSpec { plan, simulate, planner, .. } = job.spec();
    match (plan, simulate) {
        (Some(plan), _) => format!("{} trees of at most {} iterations", plan.seeds, planner.iterations),
        (None, Some(simulate)) => summary::motion(job, simulate),
        (None, None) => {
            let optimiser = job.optimiser_spec();
            format!("{} generations of {}", optimiser.generations(), summary::candidates(optimiser))
        }
    }
}

/// Returns true if a job ended before its robot had settled.
fn unprepared(job: &v1::Job) -> bool {
    values::progress(job).phase == "preparing"
}
