//! Output folder of a job: its files, and how they are written and read back.

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
pub use simulations::{OfWay, RunNumbers, Share, SimulationFile, Statistics, Values};
pub use stored::{Stored, StoredPlans, StoredSimulation, finished};
pub use write::write;

use serde::Serialize;

/// Summary of the result. It is written last: if it exists, all other files exist, too.
pub const RESULT: &str = "result.json";
/// Resolved job.
pub const JOB: &str = "job.toml";
/// Report of a job that evolved, as the worker made it.
pub const REPORT: &str = "report.json";
/// Report of a job that planned, as the coordinator assembled it.
pub const PLANS: &str = "plans.json";
/// Report of a job that simulated, as the coordinator assembled it.
pub const SIMULATION: &str = "simulation.json";
/// Store of the coordinator of a run on this machine.
pub const STORE: &str = "store.sqlite";

/// Content of a result.json, by procedure.
#[derive(Debug, Serialize)]
#[serde(untagged)]
pub enum Finished {
    /// Result of a job that evolved a gait set.
    Evolved(Box<ResultFile>),
    /// Result of a job that planned with a gait set.
    Planned(Box<PlanFile>),
    /// Result of a job that simulated a motion.
    Simulated(Box<SimulationFile>),
}
