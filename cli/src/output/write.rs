//! Everything that a finished job leaves behind, derived from the coordinator's answer alone.

use super::{Folder, JOB, REPORT, RESULT, ResultFile, atomic::Batch, csv, gaits, pictures};
use crate::client::Url;
use crate::console;
use crate::error::Error;
use proto::v1;
use sim_core::identity::Digest;
use sim_core::job::Job;
use sim_core::report::Report;

/// Writes a result to its folder: all files or none, `result.json` last.
pub fn write(folder: &Folder, job: &Job, answer: &v1::GetResultResponse, from: &Url) -> Result<ResultFile, Error> {
    let unreadable = |reason: String| Error::Answer { url: from.to_string(), reason };
    let status = answer.job.as_ref().ok_or_else(|| unreadable("a result without its job".to_owned()))?;
    let result_digest = digest("result digest", &answer.result_digest).map_err(unreadable)?;
    let job_digest = digest("job digest", &status.job_digest).map_err(unreadable)?;
    let report: Option<Report> = match answer.report_json.as_slice() {
        [] => None,
        bytes => Some(serde_json::from_slice(bytes).map_err(|e| unreadable(format!("the report: {e}")))?),
    };
    let result = ResultFile::new(job, job_digest, result_digest, answer, status, report.as_ref());

    let mut batch = Batch::new(folder.path());
    batch.add(JOB, answer.job_toml.as_bytes())?;
    batch.add("history.csv", csv::history(&answer.history).as_bytes())?;
    if let Some(report) = &report {
        batch.add(REPORT, &answer.report_json)?;
        batch.add("gaits.json", console::json(&gaits::file(job, report))?.as_bytes())?;
        batch.add("tree.json", console::json(&report.tree)?.as_bytes())?;
        for (i, gait) in report.gaits.iter().enumerate() {
            batch.add(&gaits::trajectory_name(i), csv::gait(gait).as_bytes())?;
        }
    }
    for (name, content) in pictures::all(job, &answer.history, report.as_ref())? {
        batch.add(&name, &content)?;
    }
    batch.add(RESULT, console::json(&result)?.as_bytes())?;
    batch.commit()?;
    Ok(result)
}

fn digest(what: &str, bytes: &[u8]) -> Result<Digest, String> {
    let bytes = bytes.try_into().map_err(|_| format!("a {what} of {} bytes instead of 32", bytes.len()))?;
    Ok(Digest(bytes))
}
