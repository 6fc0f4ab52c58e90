//! Report of a job that simulates. The coordinator assembles it and stores it with the job; the command line draws it.

use super::{Recorded, Run};
use crate::base::score::Counts;
use serde::{Deserialize, Serialize};

/// Report of a job that simulates. Lengths in mu, angles in rad, times in s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SimulationReport {
    /// Names of the joints: the columns of a sample's targets and angles.
    pub joints: Vec<String>,
    /// Names of the bodies: the columns of contacts.
    pub bodies: Vec<String>,
    /// Runs with nothing varied, one for each way.
    pub unvaried: Vec<Recorded>,
    /// Runs of each repeat, one for each way.
    pub repeats: Vec<Vec<Run>>,
    /// Effort of all runs.
    pub counts: Counts,
}
