//! The `[planner]` table of a job.

use super::{Metric, PlannerKind};
use crate::base::error::{Faults, Invalid, in_range, whole_in_range};
use crate::base::limits;
use crate::base::registry::Chosen;
use serde::{Deserialize, Serialize};

/// The `[planner]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlannerSpec {
    /// Planner to use.
    pub algorithm: Chosen<dyn PlannerKind>,
    /// K_max, the number of iterations.
    pub iterations: u32,
    /// w, weight of the heading in the metric √(Δx² + Δy² (+ Δz²) + (w·Δyaw)²), mu/rad.
    pub yaw_weight: f64,
    /// Weights of the metric's other coordinates.
    #[serde(skip_serializing_if = "MetricSpec::is_default")]
    pub metric: MetricSpec,
    /// Greatest difference of joint angles (rad), tilt (rad) and height (mu) at which a transition is reused. 0: every
    /// expansion is simulated.
    pub reuse_tolerance: f64,
    /// V, number of configurations of a local state from which transitions are simulated. 1: only the first one.
    pub variants: u32,
    /// Trees per candidate; its fitness is the mean of their scores.
    pub repeats: u32,
    /// Limit on the rollouts that an evaluation may simulate for all of its trees; an evaluation that needs more fails.
    /// Default: the greatest number it can need.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_rollouts: Option<u64>,
    /// Ends a tree's growth once a node is within the goal's radius. Default: true in jobs that plan, if there is a
    /// goal; else false, which is not written out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stop_at_goal: Option<bool>,
}

/// Weights of the metric's coordinates other than x, y and yaw.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MetricSpec {
    /// Weight of the height. Default: 1 over terrain, 0 on flat ground.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub z: Option<f64>,
    /// Weight of the tilt about the heading, mu/rad. Default: 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub roll: Option<f64>,
    /// Weight of the tilt about the axis to the left, mu/rad. Default: 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pitch: Option<f64>,
    /// Weight of each joint angle, mu/rad. Default: 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joints: Option<f64>,
}

impl MetricSpec {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Returns the metric with this weight of the heading. `flat` selects the default weight of the height.
    pub fn metric(&self, yaw_weight: f64, flat: bool) -> Metric {
        Metric {
            yaw_weight,
            z: self.z.unwrap_or(if flat { 0.0 } else { 1.0 }),
            roll: self.roll.unwrap_or(0.0),
            pitch: self.pitch.unwrap_or(0.0),
            joints: self.joints.unwrap_or(0.0),
        }
    }
}

impl Default for PlannerSpec {
    fn default() -> Self {
        Self {
            algorithm: Chosen::default(),
            iterations: 150,
            yaw_weight: 0.5,
            metric: MetricSpec::default(),
            reuse_tolerance: 0.05,
            variants: 1,
            repeats: 1,
            max_rollouts: None,
            stop_at_goal: None,
        }
    }
}

/// Rejects settings out of range.
pub(crate) fn validate_planner(planner: &PlannerSpec) -> Result<(), Invalid> {
    let mut faults = Faults::default();
    faults.take(whole_in_range("planner.iterations", planner.iterations, (1, limits::MAX_ITERATIONS.into()), ""));
    faults.take(in_range("planner.yaw_weight", planner.yaw_weight, (0.0, 1000.0), "mu/rad"));
    let MetricSpec { z, roll, pitch, joints } = planner.metric;
    for (name, weight, unit) in
        [("z", z, ""), ("roll", roll, "mu/rad"), ("pitch", pitch, "mu/rad"), ("joints", joints, "mu/rad")]
    {
        let field = format!("planner.metric.{name}");
        faults.take(weight.map_or(Ok(()), |weight| in_range(field, weight, (0.0, 1000.0), unit)));
    }
    faults.take(in_range("planner.reuse_tolerance", planner.reuse_tolerance, (0.0, 1.0), "rad (mu for height)"));
    faults.take(whole_in_range("planner.variants", planner.variants, (1, limits::MAX_VARIANTS.into()), ""));
    faults.take(whole_in_range("planner.repeats", planner.repeats, (1, limits::MAX_REPEATS.into()), ""));
    faults.end()
}
