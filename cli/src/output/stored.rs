//! Reader of finished output folders.

use super::{Finished, JOB, PLANS, PlanFile, REPORT, RESULT, ResultFile, SIMULATION, SimulationFile};
use crate::error::Error;
use crate::{inputs, load};
use serde::de::DeserializeOwned;
use sim_core::genotype::Misfit;
use sim_core::problem::{Checked, Job, JobKind};
use sim_core::procedure::evolve::report::Report;
use sim_core::procedure::plan::PlanReport;
use sim_core::procedure::simulate::SimulationReport;
use std::fs;
use std::path::{Path, PathBuf};

/// Job and result of a finished run of a job that evolved.
pub struct Stored {
    /// Path of the folder.
    pub folder: PathBuf,
    /// Job, compiled and settled by this build.
    pub job: Job,
    /// Stored result.
    pub result: ResultFile,
}

impl Stored {
    /// Reads job.toml and result.json, and checks that they match.
    pub fn read(folder: &Path) -> Result<Self, Error> {
        let result_path = folder.join(RESULT);
        if folder.join(JOB).is_file() && !result_path.exists() {
            return Err(Error::NotFinished { folder: folder.to_owned() });
        }
        let text = read_text(&result_path)?;
        let job_path = folder.join(JOB);
        let (job, _) = load::resolved(&job_path, Job::from_toml)?;
        inputs::record(&job_path);
        load::must_evolve(&job, &folder.display().to_string())?;
        let result: ResultFile = parse(&result_path, &text)?;
        let lengths = [&result.winner, &result.first].map(|c| c.as_ref().map(|c| c.genotype.len()));
        if let Some(reason) = wrong_genotype(&job, lengths.into_iter().flatten()) {
            return Err(Error::Damaged { path: result_path, reason });
        }
        Ok(Self { folder: folder.to_owned(), job, result })
    }

    /// Reads the report. Fails if every evaluation failed: there is no report then.
    pub fn report(&self) -> Result<Report, Error> {
        if self.result.winner.is_none() {
            return Err(Error::NoWinner { folder: self.folder.clone() });
        }
        let path = self.folder.join(REPORT);
        let report: Report = read_json(&path)?;
        let candidates = [&report.winner, &report.first, &report.best].into_iter();
        let candidates = candidates.chain(report.archive.iter().map(|a| &a.candidate));
        let candidates = candidates.chain(report.audits.iter().map(|a| &a.candidate));
        match wrong_genotype(&self.job, candidates.map(|c| c.genotype.numbers().len())) {
            None => Ok(report),
            Some(reason) => Err(Error::Damaged { path, reason }),
        }
    }
}

/// Returns the fault of the first length that is not a valid length of the job's genotypes.
fn wrong_genotype(job: &Job, lengths: impl IntoIterator<Item = usize>) -> Option<String> {
    let misfit = lengths.into_iter().find_map(|found| job.space().check_length(found).err())?;
    Some(match misfit {
        Misfit::Length { found, wanted } => {
            format!("a genome has {found} parameters, but the genomes of {JOB} have {wanted}")
        }
        other => other.to_string(),
    })
}

fn read_text(path: &Path) -> Result<String, Error> {
    let text = fs::read_to_string(path).map_err(|e| Error::read(path, e))?;
    inputs::record(path);
    Ok(text)
}

fn parse<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T, Error> {
    serde_json::from_str(text).map_err(|e| Error::Damaged { path: path.to_owned(), reason: e.to_string() })
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, Error> {
    parse(path, &read_text(path)?)
}

/// Job, result and report of a finished run of a job that planned.
pub struct StoredPlans {
    /// Job, compiled and settled by this build.
    pub job: Job,
    /// Stored result.
    pub result: PlanFile,
    /// Stored report.
    pub report: PlanReport,
}

impl StoredPlans {
    /// Reads a folder; `None` if its job has another procedure.
    pub fn read(folder: &Path) -> Result<Option<Self>, Error> {
        let Some(job) = job_that(folder, JobKind::Plan)? else { return Ok(None) };
        let (result, report) = (read_json(&folder.join(RESULT))?, read_json(&folder.join(PLANS))?);
        Ok(Some(Self { job, result, report }))
    }
}

/// Job, result and report of a finished run of a job that simulated.
pub struct StoredSimulation {
    /// Job, compiled and settled by this build.
    pub job: Job,
    /// Stored result.
    pub result: SimulationFile,
    /// Stored report.
    pub report: SimulationReport,
}

impl StoredSimulation {
    /// Reads a folder; `None` if its job has another procedure.
    pub fn read(folder: &Path) -> Result<Option<Self>, Error> {
        let Some(job) = job_that(folder, JobKind::Simulate)? else { return Ok(None) };
        let (result, report) = (read_json(&folder.join(RESULT))?, read_json(&folder.join(SIMULATION))?);
        Ok(Some(Self { job, result, report }))
    }
}

/// Returns the job of a folder with a finished run; `None` if it has another procedure.
fn job_that(folder: &Path, does: JobKind) -> Result<Option<Job>, Error> {
    let path = folder.join(JOB);
    if !path.is_file() || !load::resolved(&path, Checked::from_toml).is_ok_and(|(job, _)| job.kind() == does) {
        return Ok(None);
    }
    if !folder.join(RESULT).exists() {
        return Err(Error::NotFinished { folder: folder.to_owned() });
    }
    let (job, _) = load::resolved(&path, Job::from_toml)?;
    inputs::record(&path);
    Ok(Some(job))
}

/// Reads the result.json of a finished run.
pub fn finished(folder: &Path, job: &Checked) -> Result<Finished, Error> {
    let path = folder.join(RESULT);
    Ok(match job.kind() {
        JobKind::Plan => Finished::Planned(Box::new(read_json(&path)?)),
        JobKind::Simulate => Finished::Simulated(Box::new(read_json(&path)?)),
        JobKind::Evolve => Finished::Evolved(Box::new(Stored::read(folder)?.result)),
    })
}
