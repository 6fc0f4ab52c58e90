//! Content of `fidelity.json`.

use super::super::subject::Machine;
use serde::Serialize;
use study::fidelity::comparison::Set;
use study::setting::PhysicsSetting;

#[derive(Serialize)]
pub struct View {
    pub robot: String,
    /// Name of the environment.
    pub environment: String,
    /// Gravity, mu/s².
    pub gravity: f32,
    /// Duration of a gait, s.
    pub duration: f64,
    pub seed: u64,
    pub threads: u32,
    /// Source of the evolved gaits, as a text.
    pub evolved: String,
    pub machine: Machine,
    pub reference: PhysicsSetting,
    pub sets: Vec<Set>,
}
