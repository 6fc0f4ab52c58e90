//! Writer of all files of a finished job, from the coordinator's answer alone.

use super::result::Digests;
use super::{
    Finished, Folder, JOB, PLANS, PlanFile, REPORT, RESULT, ResultFile, SIMULATION, SimulationFile, atomic::Batch, csv,
    gaits, pictures, plans, simulations,
};
use crate::client::Url;
use crate::console;
use crate::error::Error;
use crate::gait_set::GAITS;
use crate::values::Generation;
use proto::{ConvertError, v1};
use sim_core::problem::{Checked, JobKind};
use sim_core::procedure::evolve::report::Report;
use sim_core::procedure::plan::PlanReport;
use sim_core::procedure::simulate::SimulationReport;
use sim_core::report::GaitTrace;

/// Writes a result to its folder: all files or none, with `result.json` as the last one.
pub fn write(folder: &Folder, job: &Checked, answer: &v1::GetResultResponse, from: &Url) -> Result<Finished, Error> {
    let unreadable = |reason: String| Error::Answer { url: from.to_string(), reason };
    let status = answer.job.as_ref().ok_or_else(|| unreadable("the result has no job".to_owned()))?;
    let wrong = |e: ConvertError| unreadable(e.to_string());
    let digests = Digests {
        job: proto::digest("the job digest", &status.job_digest).map_err(wrong)?,
        result: proto::digest("the result digest", &answer.result_digest).map_err(wrong)?,
        // Digest of the engine that computed the result, which may be another build.
        engine: proto::digest("the engine digest", &status.engine_digest).map_err(wrong)?,
    };
    let artefact = |name: &str| answer.artefacts.iter().find(|a| a.name == name).map(|a| a.content.as_slice());
    let mut batch = Batch::new(folder.path());
    if !folder.has_job() {
        batch.add(JOB, answer.job_toml.as_bytes())?;
    }
    let no_report = || unreadable("the result has no report".to_owned());
    let damaged = |e: serde_json::Error| unreadable(format!("the report is invalid: {e}"));
    let finished = match job.kind() {
        JobKind::Plan => {
            let json = artefact("plans").ok_or_else(no_report)?;
            let report = serde_json::from_slice(json).map_err(damaged)?;
            planned(&mut batch, job, &report, json)?;
            Finished::Planned(Box::new(PlanFile::new(job, status, &digests, &report)))
        }
        JobKind::Simulate => {
            let json = artefact("simulation").ok_or_else(no_report)?;
            let report = serde_json::from_slice(json).map_err(damaged)?;
            simulated(&mut batch, job, &report, json)?;
            Finished::Simulated(Box::new(SimulationFile::new(job, status, &digests, &report)))
        }
        JobKind::Evolve => {
            let json = artefact("report");
            let report: Option<Report> = json.map(|json| serde_json::from_slice(json).map_err(damaged)).transpose()?;
            let history: Vec<Generation> = answer.history.iter().filter_map(Generation::of).collect();
            let result = ResultFile::new(job, status, digests, report.as_ref());
            evolved(&mut batch, job, &history, &result, report.as_ref().zip(json))?;
            Finished::Evolved(Box::new(result))
        }
    };
    batch.add(RESULT, console::json(&finished)?.as_bytes())?;
    batch.commit()?;
    Ok(finished)
}

/// Adds the files of a job that evolved, except result.json.
fn evolved(
    batch: &mut Batch,
    job: &Checked,
    history: &[Generation],
    result: &ResultFile,
    report: Option<(&Report, &[u8])>,
) -> Result<(), Error> {
    batch.add("history.csv", csv::history(history).as_bytes())?;
    if let Some((report, json)) = report {
        batch.add(REPORT, json)?;
        batch.add("tree.json", console::json(&report.tree)?.as_bytes())?;
        if !result.archive.is_empty() {
            batch.add("archive.csv", csv::archive(&result.archive).as_bytes())?;
        }
        if let Some(audits) = &result.audits {
            batch.add("audits.csv", csv::audits(&audits.bests).as_bytes())?;
        }
        gaits(batch, job, &report.gaits)?;
    }
    for (name, content) in pictures::all(job, history, report.map(|(report, _)| report))? {
        batch.add(&name, &content)?;
    }
    Ok(())
}

/// Adds the files of a job that planned, except result.json.
fn planned(batch: &mut Batch, job: &Checked, report: &PlanReport, json: &[u8]) -> Result<(), Error> {
    batch.add(PLANS, json)?;
    batch.add("plans.csv", plans::table(job, report).as_bytes())?;
    batch.add("plan.csv", plans::best(job, report).as_bytes())?;
    batch.add("paths.csv", csv::paths(&report.paths).as_bytes())?;
    batch.add("tree.json", console::json(&report.tree)?.as_bytes())?;
    gaits(batch, job, &report.gaits)?;
    for (name, content) in pictures::of_plans(job, report)? {
        batch.add(&name, &content)?;
    }
    Ok(())
}

/// Adds the files of a job that simulated, except result.json.
fn simulated(batch: &mut Batch, job: &Checked, report: &SimulationReport, json: &[u8]) -> Result<(), Error> {
    batch.add(SIMULATION, json)?;
    batch.add("runs.csv", simulations::table(job, report).as_bytes())?;
    batch.add("paths.csv", simulations::paths(report).as_bytes())?;
    for recorded in &report.unvaried {
        let name = format!("motion-{}.csv", recorded.run.way.name());
        batch.add(&name, simulations::motion(report, recorded).as_bytes())?;
    }
    for (name, content) in pictures::of_simulation(job, report)? {
        batch.add(&name, &content)?;
    }
    Ok(())
}

/// Adds gaits.json, the trajectory of each gait, and the text of gaits that are motion sequences.
fn gaits(batch: &mut Batch, job: &Checked, traces: &[GaitTrace]) -> Result<(), Error> {
    batch.add(GAITS, console::json(&gaits::file(job, traces))?.as_bytes())?;
    for (i, gait) in traces.iter().enumerate() {
        batch.add(&gaits::trajectory_name(i), csv::gait(gait).as_bytes())?;
        if let Some(program) = gaits::program(job, gait) {
            batch.add(&gaits::program_name(i), program.as_bytes())?;
        }
    }
    Ok(())
}
