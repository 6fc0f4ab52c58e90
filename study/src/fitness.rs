//! Agreement of engine settings on the scores of genotypes. Every setting scores the same genotypes with the same
//! random streams.

pub mod comparison;

use crate::fidelity::disturbed;
use crate::statistics::{Estimate, bootstrap, spearman};
use serde::{Deserialize, Serialize};
use sim_core::base::random::{Purpose, Stream};
use sim_core::base::statistics::{median, quantile};
use sim_core::evaluate::{Stopped, Trial, grow};
use sim_core::genotype::Genotype;
use sim_core::plan::Transitions;
use sim_core::problem::Job;

/// Scores of a genotype on several trees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Score of each tree.
    pub scores: Vec<f64>,
    /// Rollouts of all trees together. The trees share a table of transitions.
    pub rollouts: u64,
    /// Unstable rollouts, counted in `rollouts` too.
    pub unstable: u64,
}

impl Measured {
    /// Returns the mean of the trees' scores.
    pub fn mean(&self) -> f64 {
        self.scores.iter().sum::<f64>() / self.scores.len() as f64
    }
}

/// Agreement of a setting's scores with a reference's. Differences are in the unit of the score.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Agreement {
    /// Spearman's rank correlation, with a 95 % bootstrap interval over the genotypes. `null` if all scores of either
    /// setting are equal.
    pub spearman: Option<Estimate>,
    /// Mean of the setting's scores divided by the mean of the reference's. `null` if the reference's mean is 0.
    pub ratio: Option<Estimate>,
    /// Median |difference|.
    pub median_difference: f64,
    /// 95th percentile of |difference|.
    pub p95_difference: f64,
}

/// Scores genotypes with the job's setting, each on `trees` trees. `first`: index of the first genotype in its study.
/// Random streams depend only on the job's seed, the genotype's index and the tree, so a genotype's trees grow towards
/// the same random places with every setting. `off`: the trees start from joint angles disturbed by 1e-6 rad, which
/// shows how repeatable a setting's own scores are.
///
/// # Errors
/// If `stop` returns true before the trees are complete.
///
/// # Panics
/// If a genotype's length does not fit the job.
pub fn measure(
    job: &Job,
    first: u32,
    genotypes: &[&Genotype],
    trees: u32,
    off: bool,
    stop: &dyn Fn() -> bool,
) -> Result<Vec<Measured>, Stopped> {
    let gaits = job.gaits().count as usize;
    let trial = |(index, genotype): (u32, &&Genotype)| {
        let streams = (0..trees).map(|tree| Stream::new(job.spec().seed, Purpose::Rescore, 0, index, tree));
        let mut trial = Trial::with_reuse(job, genotype, job.reuse(), streams);
        if off {
            trial.table = Transitions::new(gaits, job.reuse(), &disturbed(job.start(), index));
        }
        trial
    };
    let mut trials: Vec<Trial> = (first..).zip(genotypes).map(trial).collect();
    grow(job, &mut trials, stop)?;
    let measured = |t: &Trial| {
        let counts = t.counts();
        Measured { scores: t.scores(job), rollouts: counts.rollouts, unstable: counts.unstable }
    };
    Ok(trials.iter().map(measured).collect())
}

/// Compares a setting's scores with the reference's, genotype by genotype.
///
/// # Panics
/// If the two slices differ in length.
pub fn compare(reference: &[f64], setting: &[f64]) -> Agreement {
    assert_eq!(reference.len(), setting.len(), "both settings need a score for every genotype");
    let apart: Vec<f64> = reference.iter().zip(setting).map(|(r, s)| (r - s).abs()).collect();
    let estimate = |statistic: fn(&[f64], &[f64]) -> Option<f64>| {
        // All estimates use the same resamples, so that differences between settings do not come from the resampling.
        bootstrap(reference.len() as u32, &mut Stream::new(0, Purpose::Bootstrap, 0, 0, 0), |members| {
            let picked = |values: &[f64]| members.iter().map(|&i| values[i]).collect::<Vec<f64>>();
            statistic(&picked(reference), &picked(setting))
        })
    };
    let ratio = |r: &[f64], s: &[f64]| {
        let sum = r.iter().sum::<f64>();
        (sum != 0.0).then(|| s.iter().sum::<f64>() / sum)
    };
    Agreement {
        spearman: estimate(spearman),
        ratio: estimate(ratio),
        median_difference: median(&apart).unwrap_or(f64::NAN),
        p95_difference: quantile(&apart, 0.95).unwrap_or(f64::NAN),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sim_core::physics::{EngineKind, PhysicsSpec};

    fn job(engine: EngineKind) -> Job {
        let job = Job::from_toml(
            r#"
            name = "scored"
            robot = "quadropod"
            environment = "empty-goal"
            gaits = { count = 2, duration = 2.0 }
            planner = { iterations = 12 }
            fitness = { kind = "distance" }
            optimiser = { kind = "pso", particles = 4, generations = 3 }
            "#,
        );
        job.unwrap().with_physics(PhysicsSpec { engine: engine.into(), ..PhysicsSpec::default() }).unwrap()
    }

    #[test]
    fn scores_depend_on_index_and_not_on_batch() {
        for engine in [EngineKind::Rapier, EngineKind::Lockstep] {
            let job = job(engine);
            let genotypes = job.optimiser().ask().genotypes;
            let genotypes: Vec<&Genotype> = genotypes.iter().collect();
            let together = measure(&job, 0, &genotypes[..3], 4, false, &|| false).unwrap();
            let alone = measure(&job, 2, &genotypes[2..3], 4, false, &|| false).unwrap();
            assert_eq!(alone, together[2..]);
            assert_eq!(alone[0].scores.len(), 4);
            let fewer = measure(&job, 2, &genotypes[2..3], 2, false, &|| false).unwrap();
            assert_eq!(fewer[0].scores, alone[0].scores[..2], "the first trees must not depend on the number of trees");
            assert!(measure(&job, 0, &genotypes[..1], 4, false, &|| true).is_err());
        }
    }

    #[test]
    fn disturbed_start_changes_scores_slightly() {
        let job = job(EngineKind::Rapier);
        let genotypes = job.optimiser().ask().genotypes;
        let genotypes: Vec<&Genotype> = genotypes.iter().collect();
        let trial = |off| measure(&job, 0, &genotypes, 3, off, &|| false).unwrap();
        let (settled, off) = (trial(false), trial(true));
        let scores = |m: &[Measured]| m.iter().map(Measured::mean).collect::<Vec<f64>>();
        assert_ne!(settled, off, "a disturbance of 1e-6 rad must change some tree");
        assert!(
            compare(&scores(&settled), &scores(&off)).median_difference < 1.0,
            "a disturbance of 1e-6 rad must not change the median score by 1 or more"
        );
    }

    #[test]
    fn scores_scaled_by_nine_tenths_keep_their_ranks() {
        let reference: Vec<f64> = (1..=20).map(f64::from).collect();
        let setting: Vec<f64> = reference.iter().map(|r| 0.9 * r).collect();
        let found = compare(&reference, &setting);
        assert_eq!(found.spearman.unwrap(), Estimate { value: 1.0, low: 1.0, high: 1.0 });
        let ratio = found.ratio.unwrap();
        assert!([ratio.low, ratio.value, ratio.high].iter().all(|v| (v - 0.9).abs() < 1e-12), "{ratio:?}");
        // 0.1 · 10.5; 0.1 · 19.05.
        assert!((found.median_difference - 1.05).abs() < 1e-12 && (found.p95_difference - 1.905).abs() < 1e-12);
    }

    #[test]
    fn equal_scores_have_no_rank_correlation() {
        let found = compare(&[0.0, 0.0, 0.0], &[1.0, 2.0, 3.0]);
        assert_eq!((found.spearman, found.ratio), (None, None));
        assert_eq!(found.median_difference, 2.0);
    }
}
