//! The output folder: what is in it, how it gets there, how it is read back.

pub mod atomic;
mod csv;
mod folder;
mod gaits;
mod pictures;
mod plans;
mod result;
mod simulations;
mod stored;
mod write;

pub use csv::{gait as gait_csv, mode as mode_word, paths as paths_csv};
pub use folder::Folder;
pub use gaits::displacement;
pub use pictures::png;
pub use plans::{PlanFile, Spread};
pub use result::{Candidate, ResultFile};
pub use simulations::{OfWay, Share, SimulationFile, Statistics, Told, Values};
pub use stored::{Stored, StoredPlans, StoredSimulation, finished};
pub use write::write;

use serde::Serialize;

/// The summary of all that was found; written last, so where it is, the rest is.
pub const RESULT: &str = "result.json";
/// The resolved job.
pub const JOB: &str = "job.toml";
/// The report as the worker made it.
pub const REPORT: &str = "report.json";
/// The report of a job that planned, as the coordinator put it together.
pub const PLANS: &str = "plans.json";
/// The report of a job that simulated, likewise.
pub const SIMULATION: &str = "simulation.json";
/// The store of a run on this machine.
pub const STORE: &str = "store.sqlite";

/// Content of a result.json, by procedure.
#[derive(Debug, Serialize)]
#[serde(untagged)]
pub enum Finished {
    /// A gait set.
    Evolved(Box<ResultFile>),
    /// Plans with a gait set.
    Planned(Box<PlanFile>),
    /// Runs of a motion.
    Simulated(Box<SimulationFile>),
}
