//! Scores and counts of an evaluation, in the types that optimisers, scheduler and store share.

use serde::{Deserialize, Serialize};

/// Direction of a score: larger or smaller values are better.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Direction {
    /// Larger is better: coverage.
    Maximise,
    /// Smaller is better: distance to a goal.
    Minimise,
}

impl Direction {
    /// Returns true if `a` is strictly better than `b`. A failed evaluation (`None`) and NaN are worse than any number,
    /// and not better than each other.
    pub fn better(self, a: Option<f64>, b: Option<f64>) -> bool {
        match (a.filter(|v| !v.is_nan()), b.filter(|v| !v.is_nan())) {
            (Some(a), Some(b)) => match self {
                Direction::Maximise => a > b,
                Direction::Minimise => a < b,
            },
            (Some(_), None) => true,
            (None, _) => false,
        }
    }

    /// Returns index and score of the best of a generation's scores; on a tie, the lowest index. `None` if all failed.
    pub fn best(self, scores: &[Option<f64>]) -> Option<(usize, f64)> {
        let mut best: Option<(usize, f64)> = None;
        for (i, &score) in scores.iter().enumerate() {
            if self.better(score, best.map(|b| b.1)) {
                best = score.map(|s| (i, s));
            }
        }
        best
    }
}

/// Returns the mean of the scores that did not fail; `None` if all failed.
pub fn mean(scores: &[Option<f64>]) -> Option<f64> {
    let present = scores.iter().flatten().count();
    (present > 0).then(|| scores.iter().flatten().sum::<f64>() / present as f64)
}

/// Effort of an evaluation. All counts follow from the job and the candidate alone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// Rollouts simulated.
    pub rollouts: u64,
    /// Rollouts that did not run to their end: unstable, or refused by the engine.
    pub unstable: u64,
    /// Simulated time of all physics ticks, ms.
    pub simulated_ms: u64,
    /// Edges that the planner tried, simulated or taken from the table of transitions.
    pub edges: u64,
    /// Edges rejected because of an obstacle, the map's border or instability.
    pub rejected: u64,
    /// Nodes of the trees.
    pub nodes: u64,
}

impl std::ops::AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.rollouts += other.rollouts;
        self.unstable += other.unstable;
        self.simulated_ms += other.simulated_ms;
        self.edges += other.edges;
        self.rejected += other.rejected;
        self.nodes += other.nodes;
    }
}
