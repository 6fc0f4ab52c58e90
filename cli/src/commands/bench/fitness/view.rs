//! What was found, as `fitness.json` has it.

use serde::Serialize;
use study::fitness::comparison::Found;

#[derive(Serialize)]
pub struct View {
    pub job: String,
    pub robot: String,
    pub environment: String,
    pub seed: u64,
    /// s.
    pub gait_seconds: f64,
    /// k.
    pub gaits: u32,
    /// K.
    pub iterations: u32,
    /// Random streams that each genotype is scored on.
    pub trees: u32,
    /// Source of the genotypes: an evolution, or stored runs.
    pub from: String,
    /// Name of the score.
    pub score: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// The comparison.
    #[serde(flatten)]
    pub found: Found,
}
