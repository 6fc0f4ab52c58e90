//! Content of `fitness.json`.

use serde::Serialize;
use study::fitness::comparison::Found;

#[derive(Serialize)]
pub struct View {
    pub job: String,
    pub robot: String,
    pub environment: String,
    pub seed: u64,
    /// Duration of a gait, s.
    pub gait_seconds: f64,
    /// Number of gaits of a genotype, k.
    pub gaits: u32,
    /// Iterations of a tree, K.
    pub iterations: u32,
    /// Number of trees, each with its own random streams, that a genotype is scored on.
    pub trees: u32,
    /// Source of the genotypes, as a text: a search, or stored runs.
    pub from: String,
    /// Name of the score.
    pub score: &'static str,
    /// Unit of the score.
    pub unit: &'static str,
    /// Results of the comparison.
    #[serde(flatten)]
    pub found: Found,
}
