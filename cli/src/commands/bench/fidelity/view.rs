//! What was found, as `fidelity.json` has it.

use super::super::subject::Machine;
use serde::Serialize;
use study::fidelity::Fidelity;
use study::setting::Setting;
use study::statistics::Estimate;

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

/// All that was found with one kind of gaits.
#[derive(Serialize)]
pub struct Set {
    /// "random" or "evolved".
    pub gaits: &'static str,
    /// Simulated s a CPU s.
    pub reference_speed: Estimate,
    pub settings: Vec<Row>,
    /// The reference against half of its own step.
    pub halved: Vec<Halved>,
    pub ceiling: Ceiling,
}

#[derive(Serialize)]
pub struct Row {
    pub setting: Setting,
    #[serde(flatten)]
    pub against: Against,
}

/// Something against the reference.
#[derive(Serialize)]
pub struct Against {
    /// Simulated s a CPU s.
    #[serde(rename = "simulated_per_cpu")]
    pub speed: Estimate,
    /// `null` if no gait completed with both.
    pub fidelity: Option<Fidelity>,
}

/// The reference against itself, from starts whose joint angles are off by a millionth rad.
#[derive(Serialize)]
pub struct Ceiling {
    #[serde(flatten)]
    pub against: Against,
}

#[derive(Serialize)]
pub struct Halved {
    pub setting: Setting,
    /// Whether halving changes no more than the ceiling allows: the interval of the median position error begins no higher
    /// than the ceiling's ends.
    pub within_ceiling: bool,
    #[serde(flatten)]
    pub against: Against,
}

impl Halved {
    pub fn new(setting: Setting, against: Against, ceiling: &Ceiling) -> Self {
        let within_ceiling = match (&against.fidelity, &ceiling.against.fidelity) {
            (Some(halved), Some(ceiling)) => halved.position.median.low <= ceiling.position.median.high,
            _ => false,
        };
        Self { setting, within_ceiling, against }
    }
}
