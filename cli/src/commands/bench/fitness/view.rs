//! What was found, as `fitness.json` has it.

use serde::Serialize;
use study::fitness::Agreement;
use study::setting::Setting;
use study::statistics::Estimate;

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
    /// What the genotypes are from.
    pub from: String,
    /// Name of the score.
    pub score: &'static str,
    /// Its unit.
    pub unit: &'static str,
    pub reference: Setting,
    /// The settings in their order, then the reference.
    pub settings: Vec<Row>,
    /// The reference from starts whose joint angles are off by a millionth rad, against itself.
    pub ceiling: Row,
    /// Spearman of every pair of `settings`.
    pub pairs: Vec<Vec<Option<Estimate>>>,
    /// What stored runs found.
    pub finalists: Vec<Finalist>,
    #[serde(rename = "genomes")]
    pub genotypes: Vec<Entry>,
}

/// One setting, over the genotypes of all ages.
#[derive(Serialize)]
pub struct Row {
    pub setting: Setting,
    /// Mean score; `null` if there were no such genotypes.
    pub mean: Option<f64>,
    /// Against the reference.
    pub agreement: Option<Agreement>,
    /// CPU s a genotype, all its trees.
    pub cpu_seconds: f64,
    /// Rollouts a genotype.
    pub rollouts: f64,
    /// Unstable rollouts of all genotypes.
    pub unstable: u64,
}

/// A candidate that a run ended with.
#[derive(Serialize)]
pub struct Finalist {
    pub run: String,
    /// "winner", as published, or "search's best".
    pub role: &'static str,
    pub generation: u32,
    /// What it scored in its search.
    pub search: f64,
    /// Mean score with each of `settings`.
    pub means: Vec<f64>,
    /// The reference's score over the first setting's.
    pub kept: Option<f64>,
}

/// A genotype of some age.
#[derive(Serialize)]
pub struct Entry {
    /// Which of the runs it is from.
    pub run: Option<usize>,
    /// 0: random.
    pub generation: u32,
    /// By setting, then by tree.
    pub scores: Vec<Vec<f64>>,
}
