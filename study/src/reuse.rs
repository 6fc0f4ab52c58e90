//! Effect of transition reuse: the same genotypes scored with and without it, on the same random streams.
//!
//! A *column* is one way to score: a [`Reuse`], a number of trees that share one table, and a draw of random streams.
//! Column 0 is the plain method: tolerance 0, one tree, draw 0. A *row* has the results of one way to score: it
//! compares the scores of its draw 0 with the plain ones, and gives the spread between draws for comparison.

use crate::genotypes::Sample;
use crate::statistics::{Estimate, bootstrap, spearman};
use crate::threads::in_order;
use serde::{Deserialize, Serialize};
use sim_core::base::limits::MAX_REPEATS;
use sim_core::base::random::{Purpose, Stream};
use sim_core::base::statistics::{median, quantile};
use sim_core::evaluate::{Stopped, Trial, grow};
use sim_core::genotype::Genotype;
use sim_core::plan::Reuse;
use sim_core::problem::Job;

/// Parameters of a study of transition reuse.
#[derive(Clone, Debug, PartialEq)]
pub struct Study {
    /// Tolerances besides the job's own, rad (mu for height).
    pub tolerances: Vec<f64>,
    /// Numbers of variants, each combined with each of these tolerances and with the job's own.
    pub variants: Vec<u32>,
    /// Number of draws of random streams besides the first.
    pub seeds: u32,
    /// Numbers of trees per evaluation, with the job's own reuse.
    pub repeats: Vec<u32>,
}

/// One way to score a genotype.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Column {
    /// Tolerance and variants of transition reuse.
    #[serde(flatten, with = "Reused")]
    pub reuse: Reuse,
    /// Number of trees; the score is the mean of theirs.
    pub repeats: u32,
    /// Index of the draw of random streams.
    pub draw: u32,
}

/// Score and cost of a genotype in one column.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Mean score of the trees.
    pub score: f64,
    /// Number of rollouts simulated.
    pub rollouts: u64,
}

/// Results of one way to score, compared with the plain method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReuseRow {
    /// Tolerance, rad (mu for height).
    pub tolerance: f64,
    /// Number of variants, V.
    pub variants: u32,
    /// Trees per evaluation.
    pub repeats: u32,
    /// Spearman's rank correlation with the plain scores on the same random streams. `null` if all scores of either way
    /// are equal.
    pub spearman: Option<Estimate>,
    /// Median |difference| from the plain scores, in the unit of the score.
    pub median_difference: f64,
    /// 95th percentile of |difference| from the plain scores.
    pub p95_difference: f64,
    /// Mean of the rank correlations of the plain scores with this way's scores on the other draws. `null` without
    /// other draws.
    pub spearman_other_seeds: Option<Estimate>,
    /// Median |difference| between this way's scores on draw 0 and on other draws. `null` without other draws.
    pub median_difference_seeds: Option<f64>,
    /// Mean number of rollouts per evaluation.
    pub rollouts: f64,
    /// Rollouts of the plain method for as many trees, which expands each node once, divided by `rollouts`.
    pub fewer_than_plain: f64,
    /// Rollouts of the literal method for as many trees, K·k per tree even if a node was expanded before, divided by
    /// `rollouts`.
    pub fewer_than_literal: f64,
}

/// Serialised form of a [`Reuse`].
#[derive(Serialize)]
#[serde(remote = "Reuse")]
struct Reused {
    tolerance: f64,
    variants: u32,
}

/// Results in one environment.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Found {
    /// Name of the environment.
    pub environment: String,
    /// One row for each way to score, over all draws.
    pub rows: Vec<ReuseRow>,
    /// Columns of `genotypes[].measured`.
    pub columns: Vec<Column>,
    /// Genotypes with their scores.
    #[serde(rename = "genomes")]
    pub genotypes: Vec<Entry>,
}

/// Scores of a genotype in every column.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Entry {
    /// Generation of the genotype; 0 for random ones.
    pub generation: u32,
    /// Scores and costs by column.
    pub measured: Vec<Measured>,
}

impl Study {
    /// Scores all genotypes in every column on `threads` threads (at least 1), and compares the columns. `each` is
    /// called after every genotype.
    ///
    /// # Panics
    /// If there is no genotype, or one does not fit the job.
    pub fn measure(&self, job: &Job, samples: &[Sample], threads: usize, each: &(dyn Fn() + Sync)) -> Found {
        let columns = self.columns(job);
        let measured = in_order(samples.len(), threads, |i| {
            let measured = measure(job, &columns, i as u32, &samples[i].genotype, &|| false);
            each();
            measured.unwrap_or_else(|_| unreachable!("the stop callback always returns false"))
        });
        let rows = rows(job, &columns, &measured);
        let entry = |(s, measured): (&Sample, Vec<Measured>)| Entry { generation: s.generation, measured };
        let genotypes = samples.iter().zip(measured).map(entry).collect();
        Found { environment: job.environment().name.clone(), rows, columns, genotypes }
    }

    /// Returns the columns without duplicates, the plain method first.
    pub fn columns(&self, job: &Job) -> Vec<Column> {
        let own = job.reuse();
        let one = |reuse| Column { reuse, repeats: 1, draw: 0 };
        let mut columns = vec![one(Reuse { tolerance: 0.0, variants: 1 })];
        let mut add = |column| {
            if !columns.contains(&column) {
                columns.push(column);
            }
        };
        add(one(own));
        for &tolerance in std::iter::once(&own.tolerance).chain(&self.tolerances) {
            self.variants.iter().for_each(|&variants| add(one(Reuse { tolerance, variants })));
        }
        (1..=self.seeds).for_each(|draw| add(Column { draw, ..one(own) }));
        for &repeats in &self.repeats {
            (0..=self.seeds).for_each(|draw| add(Column { reuse: own, repeats, draw }));
        }
        columns
    }
}

/// Scores a genotype in every column. `index`: its index in the study. Random streams depend only on the job's seed,
/// the index, the draw and the tree, so columns of the same draw grow their trees towards the same random places.
///
/// # Errors
/// If `stop` returns true before the trees are complete.
///
/// # Panics
/// If the genotype's length does not fit the job.
pub fn measure(
    job: &Job,
    columns: &[Column],
    index: u32,
    genotype: &Genotype,
    stop: &dyn Fn() -> bool,
) -> Result<Vec<Measured>, Stopped> {
    let seed = job.spec().seed;
    let trial = |column: &Column| {
        let first = column.draw * MAX_REPEATS;
        let streams = (first..first + column.repeats).map(|r| Stream::new(seed, Purpose::Rescore, 0, index, r));
        Trial::with_reuse(job, genotype, column.reuse, streams)
    };
    let mut trials: Vec<Trial> = columns.iter().map(trial).collect();
    grow(job, &mut trials, stop)?;
    let measured = |t: &Trial| Measured { score: t.score(job), rollouts: t.counts().rollouts };
    Ok(trials.iter().map(measured).collect())
}

/// Computes the rows from measurements, which are ordered by genotype, then by column.
///
/// # Panics
/// If there is no genotype, or one was not measured in every column.
pub fn rows(job: &Job, columns: &[Column], measured: &[Vec<Measured>]) -> Vec<ReuseRow> {
    assert!(!measured.is_empty(), "a study needs at least one genotype");
    let scores = |column: usize| measured.iter().map(|m| m[column].score).collect::<Vec<f64>>();
    let rollouts =
        |column: usize| measured.iter().map(|m| m[column].rollouts as f64).sum::<f64>() / measured.len() as f64;
    let literal = f64::from(job.spec().planner.iterations) * f64::from(job.gaits().count);
    let (plain, plain_rollouts) = (scores(0), rollouts(0));
    let row = |(i, column): (usize, &Column)| {
        let own = scores(i);
        let others: Vec<Vec<f64>> = (0..columns.len())
            .filter(|&j| j != i && Column { draw: column.draw, ..columns[j] } == *column)
            .map(scores)
            .collect();
        let apart = differences(&plain, &own);
        let from_seeds: Vec<f64> = others.iter().flat_map(|other| differences(&own, other)).collect();
        ReuseRow {
            tolerance: column.reuse.tolerance,
            variants: column.reuse.variants,
            repeats: column.repeats,
            spearman: correlation(&plain, std::slice::from_ref(&own)),
            median_difference: median(&apart).unwrap_or(f64::NAN),
            p95_difference: quantile(&apart, 0.95).unwrap_or(f64::NAN),
            spearman_other_seeds: correlation(&plain, &others),
            median_difference_seeds: median(&from_seeds),
            rollouts: rollouts(i),
            fewer_than_plain: f64::from(column.repeats) * plain_rollouts / rollouts(i),
            fewer_than_literal: f64::from(column.repeats) * literal / rollouts(i),
        }
    };
    columns.iter().enumerate().filter(|(_, c)| c.draw == 0).map(row).collect()
}

fn differences(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).collect()
}

/// Returns the mean rank correlation of the plain scores with each of `others`, with a bootstrap interval over the
/// genotypes. All rows use the same resamples, so that differences between rows do not come from the resampling.
fn correlation(plain: &[f64], others: &[Vec<f64>]) -> Option<Estimate> {
    if others.is_empty() {
        return None;
    }
    let mut stream = Stream::new(0, Purpose::Bootstrap, 0, 0, 0);
    bootstrap(plain.len() as u32, &mut stream, |members| {
        let picked = |values: &[f64]| members.iter().map(|&i| values[i]).collect::<Vec<f64>>();
        let x = picked(plain);
        let each: Option<Vec<f64>> = others.iter().map(|other| spearman(&x, &picked(other))).collect();
        each.map(|each| each.iter().sum::<f64>() / each.len() as f64)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn job() -> Job {
        Job::from_toml(
            r#"
            name = "studied"
            robot = "quadropod"
            environment = "empty"
            gaits = { count = 2, duration = 1.0 }
            planner = { iterations = 12 }
            fitness = { kind = "coverage", cell = 0.2 }
            optimiser = { kind = "pso", particles = 4, generations = 3 }
            "#,
        )
        .unwrap()
    }

    fn study() -> Study {
        Study { tolerances: vec![0.0, 0.05, 0.2], variants: vec![1, 4], seeds: 2, repeats: vec![1, 3] }
    }

    #[test]
    fn columns_begin_with_plain_and_are_unique() {
        let columns = study().columns(&job());
        assert_eq!(columns[0], Column { reuse: Reuse { tolerance: 0.0, variants: 1 }, repeats: 1, draw: 0 });
        assert_eq!(columns[1].reuse, job().reuse());
        for (i, column) in columns.iter().enumerate() {
            assert!(!columns[..i].contains(column), "{column:?}");
        }
        // Plain, with 4 variants too; 0.05 and 0.2 with 1 and 4; two more draws; three trees on three draws.
        assert_eq!(columns.len(), 2 + 4 + 2 + 3);
    }

    #[test]
    fn column_does_not_depend_on_other_columns() {
        let job = job();
        let columns = study().columns(&job);
        let genotype = &job.optimiser().ask().genotypes[1];
        let all = measure(&job, &columns, 1, genotype, &|| false).unwrap();
        for (column, expected) in columns.iter().zip(&all) {
            assert_eq!(&measure(&job, &[*column], 1, genotype, &|| false).unwrap()[0], expected);
        }
        assert!(measure(&job, &columns, 1, genotype, &|| true).is_err());
        let [plain, own] = [all[0], all[1]];
        assert!(own.rollouts <= plain.rollouts && plain.rollouts <= 12 * 2);
    }

    #[test]
    fn rows_compare_with_plain_scores_and_other_draws() {
        let job = job();
        let columns = Study { tolerances: vec![], variants: vec![], seeds: 2, repeats: vec![2] }.columns(&job);
        assert_eq!(columns.len(), 2 + 2 + 3);
        // Columns: plain, own, draws 1 and 2, two trees on draws 0 to 2.
        let scored = |s: [f64; 7], r: [u64; 7]| {
            s.into_iter().zip(r).map(|(score, rollouts)| Measured { score, rollouts }).collect::<Vec<_>>()
        };
        let rollouts = [20, 4, 4, 4, 5, 5, 5];
        let measured = [
            scored([1.0, 1.5, 2.0, 1.5, 1.0, 1.0, 1.0], rollouts),
            scored([2.0, 2.5, 2.0, 2.5, 2.0, 2.0, 2.0], rollouts),
            scored([3.0, 3.5, 4.5, 3.5, 3.0, 3.0, 4.0], rollouts),
        ];
        let rows = rows(&job, &columns, &measured);
        assert_eq!(rows.len(), 3);
        let [plain, own, two] = [&rows[0], &rows[1], &rows[2]];
        assert_eq!((plain.median_difference, plain.p95_difference), (0.0, 0.0));
        assert_eq!((plain.fewer_than_plain, plain.fewer_than_literal), (1.0, 24.0 / 20.0));
        assert_eq!((plain.spearman_other_seeds, plain.median_difference_seeds), (None, None));
        assert_eq!((own.spearman.unwrap().value, own.median_difference, own.p95_difference), (1.0, 0.5, 0.5));
        assert_eq!((own.rollouts, own.fewer_than_plain, own.fewer_than_literal), (4.0, 5.0, 6.0));
        // Draw 1 ranks 1.5, 1.5, 3 (correlation √3/2), draw 2 as plain; |differences| 0.5, 0.5, 1, 0, 0, 0.
        let expected = (0.75_f64.sqrt() + 1.0) / 2.0;
        assert!((own.spearman_other_seeds.unwrap().value - expected).abs() < 1e-12);
        assert_eq!(own.median_difference_seeds, Some(0.25));
        assert_eq!(
            (two.repeats, two.rollouts, two.fewer_than_plain, two.fewer_than_literal),
            (2, 5.0, 8.0, 48.0 / 5.0)
        );
    }
}
