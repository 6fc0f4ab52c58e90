//! `evogait verify`: computes a stored result again and compares its bits.

mod plans;
mod simulations;

use crate::arguments::Verify;
use crate::console;
use crate::error::Error;
use crate::output::{PlanFile, ResultFile, SimulationFile, Stored, StoredPlans, StoredSimulation};
use serde::Serialize;
use sim_core::base::digest::Digest;
use sim_core::base::encoding::Unreadable;
use sim_core::base::score::mean;
use sim_core::evaluate::evaluate;
use sim_core::problem::Job;
use sim_core::procedure::evolve::finish::{Answer, Done, Examination, Plan, Question, examine, total};
use sim_core::procedure::evolve::report::{Report, report};
use sim_core::procedure::{Hooks, ProcedureKind};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

#[derive(Serialize)]
struct View {
    verified: bool,
    folder: String,
    job_digest: Digest,
    engine_digest: Digest,
    /// Engine of this build. Another engine may compute other bits.
    engine_digest_here: Digest,
    checks: Vec<Check>,
}

/// Comparison of a stored with a recomputed value.
#[derive(Serialize)]
struct Check {
    what: &'static str,
    same: bool,
    /// Both values, if they differ and are short.
    #[serde(skip_serializing_if = "Option::is_none")]
    difference: Option<String>,
}

/// Computes the result again, compares it and prints the checks.
pub fn run(args: Verify, quiet: bool) -> Result<(), Error> {
    let (checks, made, here) = if let Some(stored) = StoredPlans::read(&args.folder)? {
        let PlanFile { job_digest, engine_digest, versions, .. } = &stored.result;
        let made = Made { job: *job_digest, engine: *engine_digest, version: versions.evogait.clone() };
        (plans::checks(&stored, args.full)?, made, stored.job.engine_digest())
    } else if let Some(stored) = StoredSimulation::read(&args.folder)? {
        let SimulationFile { job_digest, engine_digest, versions, .. } = &stored.result;
        let made = Made { job: *job_digest, engine: *engine_digest, version: versions.evogait.clone() };
        (simulations::checks(&stored, args.full)?, made, stored.job.engine_digest())
    } else {
        let stored = Stored::read(&args.folder)?;
        let ResultFile { job_digest, engine_digest, versions, .. } = &stored.result;
        let made = Made { job: *job_digest, engine: *engine_digest, version: versions.evogait.clone() };
        (checks(&stored, args.full)?, made, stored.job.engine_digest())
    };
    let view = View {
        verified: checks.iter().all(|check| check.same),
        folder: args.folder.display().to_string(),
        job_digest: made.job,
        engine_digest: made.engine,
        engine_digest_here: here,
        checks,
    };
    if args.json {
        console::say_json(&view)?;
    } else if !quiet {
        console::say(&text(&view, args.full))?;
    }
    match view.checks.iter().find(|check| !check.same) {
        None => Ok(()),
        Some(check) => Err(Error::Different { folder: args.folder, difference: explain(check, &made, &here) }),
    }
}

fn checks(stored: &Stored, full: bool) -> Result<Vec<Check>, Error> {
    let result = &stored.result;
    let no_winner = || Error::NoWinner { folder: stored.folder.clone() };
    let winner = result.winner.as_ref().ok_or_else(no_winner)?.scored();
    let mut checks = Vec::new();
    // The job digest depends on the engine digest, so digests of different engines can't be compared.
    if result.engine_digest == stored.job.engine_digest() {
        checks.push(compare("job digest", &result.job_digest, &stored.job.digest()));
    }
    let again = evaluate(&stored.job, winner.generation, &[(winner.candidate, winner.genotype.clone())], &|| false)
        .map_err(|_| Error::Interrupted { hint: String::new() })?;
    let score = again.first().and_then(|evaluation| evaluation.score);
    checks.push(compare_score("the winner's score", Some(winner.score), score));
    let kept = stored.report()?;
    checks.push(same("the winner in the report", &winner, &kept.winner));
    let told = result.winner.as_ref().ok_or_else(no_winner)?;
    if full {
        let made = report_again(&stored.job, &kept)?;
        checks.extend(compare_reports(&kept, &made));
        checks.push(same("fresh scores in result.json", &told.fresh, &kept.winner_scores.fresh));
    } else if stored.job.reference().is_some() {
        let answers = examine_all(&stored.job, &[Examination::new(Question::Reference, &winner)])?;
        let made = answers.first().and_then(|answer| mean(&answer.scores));
        checks.push(compare_score("the winner's score on the reference setting", told.reference, made));
    }
    Ok(checks)
}

/// Repeats all examinations of a report, with the stored findings of the search.
fn report_again(job: &Job, kept: &Report) -> Result<Report, Error> {
    let plan = Plan::of(job);
    let found = kept.found(&plan);
    let round = |examinations: Vec<Examination>| -> Result<(Vec<Done>, Vec<Answer>), Error> {
        let answers = examine_all(job, &examinations)?;
        let scores = answers.iter().map(|answer| answer.scores.clone());
        Ok((examinations.into_iter().zip(scores).collect(), answers))
    };
    let (mut done, mut answers) = round(plan.finishing(&found))?;
    let winner = plan.winner(&found, &done);
    let (reported, more) = round(plan.reporting(&found, &winner, &done))?;
    done.extend(reported);
    answers.extend(more);
    let counts = total(answers.iter().map(|answer| &answer.counts));
    let traces = answers.into_iter().find_map(|answer| answer.traces).unwrap_or_default();
    Ok(report(&plan, found, winner, &done, traces, counts))
}

/// Runs a task of a procedure as a worker does.
fn again<R>(
    kind: &dyn ProcedureKind,
    job: &Job,
    task: Vec<u8>,
    decode: fn(&[u8]) -> Result<R, Unreadable>,
) -> Result<R, Error> {
    struct Never;
    impl Hooks for Never {
        fn stop(&self) -> bool {
            false
        }
    }
    let failed = |reason: String| Error::NotRepeated { reason };
    let results = kind.run(job, &[(0, task)], &Never).map_err(|e| failed(e.to_string()))?;
    decode(&results.concat()).map_err(|e| failed(e.to_string()))
}

/// Returns the answers in the order of the examinations. Uses all cores.
fn examine_all(job: &Job, examinations: &[Examination]) -> Result<Vec<Answer>, Error> {
    each(examinations.len(), |index| {
        examine(job, &examinations[index], &|| false).map_err(|_| Error::Interrupted { hint: String::new() })
    })
}

/// Does `count` pieces of work on all cores. Returns the results in order of their index.
fn each<T: Send>(count: usize, work: impl Fn(usize) -> Result<T, Error> + Sync) -> Result<Vec<T>, Error> {
    let next = AtomicUsize::new(0);
    let done: Mutex<Vec<(usize, T)>> = Mutex::new(Vec::new());
    let thread = || {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            if index >= count {
                return Ok(());
            }
            let result = work(index)?;
            done.lock().unwrap_or_else(PoisonError::into_inner).push((index, result));
        }
    };
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get()).min(count);
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..cores).map(|_| scope.spawn(thread)).collect();
        threads.into_iter().try_for_each(|t| t.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    })?;
    let mut done = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    done.sort_by_key(|(index, _)| *index);
    Ok(done.into_iter().map(|(_, result)| result).collect())
}

fn compare_reports(kept: &Report, made: &Report) -> Vec<Check> {
    vec![
        same("the choice of the winner", &kept.winner, &made.winner),
        same("the archive's scores on the reference setting", &kept.archive, &made.archive),
        same("the audits without reuse", &kept.audits, &made.audits),
        same("the winner's scores", &kept.winner_scores, &made.winner_scores),
        same("the first generation's scores", &kept.first_scores, &made.first_scores),
        same("the gaits' trajectories", &kept.gaits, &made.gaits),
        same("the tree", &kept.tree, &made.tree),
        same("the paths", &kept.paths, &made.paths),
        same("what the finish took", &kept.counts, &made.counts),
    ]
}

/// Compares scores by their bits.
fn compare_score(what: &'static str, kept: Option<f64>, made: Option<f64>) -> Check {
    let same = kept.map(f64::to_bits) == made.map(f64::to_bits);
    let told = |value: Option<f64>| value.map_or_else(|| "a failed evaluation".to_owned(), |v| v.to_string());
    Check { what, same, difference: (!same).then(|| format!("stored is {}, recomputed {}", told(kept), told(made))) }
}

fn compare(what: &'static str, kept: &Digest, made: &Digest) -> Check {
    let same = kept == made;
    Check {
        what,
        same,
        difference: (!same).then(|| format!("stored is {}, recomputed {}", kept.short(), made.short())),
    }
}

/// Compares values by their stored text, which differs for numbers of different bits, also for 0 and −0.
fn same<T: Serialize>(what: &'static str, kept: &T, made: &T) -> Check {
    let text = |value: &T| serde_json::to_string(value).unwrap_or_default();
    Check { what, same: text(kept) == text(made), difference: None }
}

/// Job, engine and program version of a stored result.
struct Made {
    job: Digest,
    engine: Digest,
    version: String,
}

fn explain(check: &Check, made: &Made, here: &Digest) -> String {
    let mut text = format!("{} differs", check.what);
    if let Some(difference) = &check.difference {
        text += &format!(" ({difference})");
    }
    if made.engine != *here {
        text += &format!(
            "; the result is from engine {} of evogait {}, this is engine {} of evogait {}: verify it with the version that made it",
            made.engine.short(),
            made.version,
            here.short(),
            env!("CARGO_PKG_VERSION")
        );
    }
    text
}

fn text(view: &View, full: bool) -> String {
    let mut lines: Vec<String> = view
        .checks
        .iter()
        .map(|check| format!("  {}  {}", if check.same { "same     " } else { "DIFFERENT" }, check.what))
        .collect();
    if view.engine_digest != view.engine_digest_here {
        lines.push("  note: this result is from another engine, so the job digest could not be compared".to_owned());
    }
    lines.insert(0, format!("{}: recomputed, compared bit by bit", Path::new(&view.folder).display()));
    if view.verified && !full {
        lines.push(format!(
            "  next: evogait verify {} --full recomputes the whole report",
            console::quoted(&view.folder)
        ));
    }
    lines.join("\n")
}
