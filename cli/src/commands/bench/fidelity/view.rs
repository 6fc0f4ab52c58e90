//! What was found, as `fidelity.json` has it.

use super::super::subject::Machine;
use serde::Serialize;
use study::fidelity::comparison::Set;
use study::setting::Setting;

#[derive(Serialize)]
pub struct View {
    pub robot: String,
    /// What it stands on and among.
    pub environment: String,
    /// mu/s².
    pub gravity: f32,
    /// Of a gait, s.
    pub duration: f64,
    pub seed: u64,
    pub threads: u32,
    /// Where the evolved gaits are from.
    pub evolved: String,
    pub machine: Machine,
    pub reference: Setting,
    pub sets: Vec<Set>,
}
