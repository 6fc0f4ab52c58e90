//! Everything that a finished job leaves behind, derived from the coordinator's answer alone.

use super::result::Digests;
use super::{Folder, JOB, REPORT, RESULT, ResultFile, atomic::Batch, csv, gaits, pictures};
use crate::client::Url;
use crate::console;
use crate::error::Error;
use crate::values::Generation;
use proto::{ConvertError, v1};
use sim_core::problem::Checked;
use sim_core::procedure::evolve::report::Report;

/// Writes a result to its folder: all files or none, `result.json` last.
pub fn write(folder: &Folder, job: &Checked, answer: &v1::GetResultResponse, from: &Url) -> Result<ResultFile, Error> {
    let unreadable = |reason: String| Error::Answer { url: from.to_string(), reason };
    let status = answer.job.as_ref().ok_or_else(|| unreadable("a result without its job".to_owned()))?;
    let wrong = |e: ConvertError| unreadable(e.to_string());
    let job_digest = proto::digest("the job digest", &status.job_digest).map_err(wrong)?;
    let result_digest = proto::digest("the result digest", &answer.result_digest).map_err(wrong)?;
    // That of the build that computed it, which need not be this one.
    let engine_digest = proto::digest("the engine digest", &status.engine_digest).map_err(wrong)?;
    let digests = Digests { job: job_digest, result: result_digest, engine: engine_digest };
    let report_json = answer.artefacts.iter().find(|a| a.name == "report").map(|a| a.content.as_slice());
    let report: Option<Report> = report_json
        .map(|json| serde_json::from_slice(json).map_err(|e| unreadable(format!("the report: {e}"))))
        .transpose()?;
    let history: Vec<Generation> = answer.history.iter().filter_map(Generation::of).collect();
    let result = ResultFile::new(job, status, digests, report.as_ref());

    let mut batch = Batch::new(folder.path());
    if !folder.has_job() {
        batch.add(JOB, answer.job_toml.as_bytes())?;
    }
    batch.add("history.csv", csv::history(&history).as_bytes())?;
    if let (Some(report), Some(json)) = (&report, report_json) {
        batch.add(REPORT, json)?;
        batch.add("gaits.json", console::json(&gaits::file(job, report))?.as_bytes())?;
        batch.add("tree.json", console::json(&report.tree)?.as_bytes())?;
        if !result.archive.is_empty() {
            batch.add("archive.csv", csv::archive(&result.archive).as_bytes())?;
        }
        if let Some(audits) = &result.audits {
            batch.add("audits.csv", csv::audits(&audits.bests).as_bytes())?;
        }
        for (i, gait) in report.gaits.iter().enumerate() {
            batch.add(&gaits::trajectory_name(i), csv::gait(gait).as_bytes())?;
        }
    }
    for (name, content) in pictures::all(job, &history, report.as_ref())? {
        batch.add(&name, &content)?;
    }
    batch.add(RESULT, console::json(&result)?.as_bytes())?;
    batch.commit()?;
    Ok(result)
}
