//! The `[planner]` table of a job.

use super::PlannerKind;
use crate::base::error::{Faults, Invalid, in_range, whole_in_range};
use crate::base::limits;
use crate::base::registry::Chosen;
use serde::{Deserialize, Serialize};

/// The `[planner]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlannerSpec {
    /// The planner.
    pub algorithm: Chosen<dyn PlannerKind>,
    /// K_max, iterations.
    pub iterations: u32,
    /// w of the metric √(Δx² + Δy² (+ Δz²) + (w·Δyaw)²), mu/rad.
    pub yaw_weight: f64,
    /// How far joint angles (rad), tilt (rad) and height (mu) may differ for a transition to be reused. 0: every
    /// expansion is simulated.
    pub reuse_tolerance: f64,
    /// V, how many configurations of a local state transitions are simulated from. 1: always its first one.
    pub variants: u32,
    /// Trees a candidate; its fitness is their mean.
    pub repeats: u32,
    /// Rollouts that an evaluation may simulate for all of its trees; one that needs more has failed. Not given: as many
    /// as it can ever need.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_rollouts: Option<u64>,
    /// Whether a tree's growth ends once a node is within the goal's radius. Not given: true in jobs that plan, if there is
    /// a goal; else false, which is not written out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stop_at_goal: Option<bool>,
}

impl Default for PlannerSpec {
    fn default() -> Self {
        Self {
            algorithm: Chosen::default(),
            iterations: 150,
            yaw_weight: 0.5,
            reuse_tolerance: 0.05,
            variants: 1,
            repeats: 1,
            max_rollouts: None,
            stop_at_goal: None,
        }
    }
}

/// Refuses settings out of range.
pub(crate) fn validate_planner(planner: &PlannerSpec) -> Result<(), Invalid> {
    let mut faults = Faults::default();
    faults.take(whole_in_range("planner.iterations", planner.iterations, (1, limits::MAX_ITERATIONS.into()), ""));
    faults.take(in_range("planner.yaw_weight", planner.yaw_weight, (0.0, 1000.0), "mu/rad"));
    faults.take(in_range("planner.reuse_tolerance", planner.reuse_tolerance, (0.0, 1.0), "rad (mu for height)"));
    faults.take(whole_in_range("planner.variants", planner.variants, (1, limits::MAX_VARIANTS.into()), ""));
    faults.take(whole_in_range("planner.repeats", planner.repeats, (1, limits::MAX_REPEATS.into()), ""));
    faults.end()
}
