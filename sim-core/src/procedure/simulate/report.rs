//! The report of a job that simulated: put together by the coordinator, stored with the job, drawn by the command line.

use super::{Recorded, Run};
use crate::base::score::Counts;
use serde::{Deserialize, Serialize};

/// The report. Lengths in mu, angles in rad, times in s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SimulationReport {
    /// Names of the joints, the columns of a sample's targets and angles.
    pub joints: Vec<String>,
    /// Names of the bodies, the columns of contacts.
    pub bodies: Vec<String>,
    /// The motion with nothing varied, once in each way.
    pub unvaried: Vec<Recorded>,
    /// The repeats, each in all ways.
    pub repeats: Vec<Vec<Run>>,
    /// Effort of all runs.
    pub counts: Counts,
}
