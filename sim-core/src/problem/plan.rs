//! The `[plan]` table of a job: given gaits, and the number of trees grown with them.

use super::Reference;
use crate::base::error::{Faults, Invalid, whole_in_range};
use crate::base::limits::{MAX_PLAN_SEEDS, MAX_PLAN_STEPS};
use crate::control::GaitsSpec;
use crate::genotype::{Genotype, Misfit, Space};
use crate::model::Robot;
use serde::{Deserialize, Serialize};

/// Name of the procedure that this table belongs to.
pub const PLAN: &str = "plan";

/// The `[plan]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanSpec {
    /// Number of trees, each with its own random numbers.
    #[serde(default = "seeds")]
    pub seeds: u32,
    /// The gaits: a path to a run's folder or to its gaits.json, or the table itself.
    pub gaits: Reference<GaitSet>,
}

fn seeds() -> u32 {
    20
}

/// Gaits with all their parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GaitSet {
    /// Names of the robot's joints, in the robot's order. Gaits of another robot are rejected.
    pub joints: Vec<String>,
    /// Parameters of each gait, in the controller's order, joint after joint.
    pub genome: Vec<Vec<f64>>,
}

impl GaitSet {
    /// Returns the gaits as a candidate of a job's space. Rejects gaits of another robot or controller. `field` is the
    /// key that holds the gaits.
    pub(super) fn genotype(
        &self,
        field: &str,
        robot: &Robot,
        gaits: &GaitsSpec,
        space: &Space,
    ) -> Result<Genotype, Invalid> {
        let conflict = |field: String, reason: String| Err(Invalid::Conflict { field, reason });
        let joints = robot.joint_names();
        if self.joints != joints {
            let reason = format!(
                "they belong to a robot with joints {}, but \"{}\" has {}: give gaits of this robot",
                self.joints.join(", "),
                robot.name,
                joints.join(", ")
            );
            return conflict(field.to_owned(), reason);
        }
        if self.genome.len() != gaits.count as usize {
            let reason =
                format!("it has {} gaits, but gaits.count = {}: both must be the same", self.genome.len(), gaits.count);
            return conflict(format!("{field}.genome"), reason);
        }
        let genes = space.genes.len() / self.genome.len();
        if let Some((i, gait)) = self.genome.iter().enumerate().find(|(_, gait)| gait.len() != genes) {
            let reason = format!(
                "it has {} numbers, but a gait of controller \"{}\" on this robot has {genes}: give gaits of \
                 this controller",
                gait.len(),
                gaits.controller.0.name()
            );
            return conflict(format!("{field}.genome[{i}]"), reason);
        }
        let genotype: Genotype = self.genome.iter().flatten().copied().collect();
        match space.check(&genotype) {
            Ok(()) => Ok(genotype),
            Err(
                Misfit::OutOfBounds { index, .. } | Misfit::NotFinite { index, .. } | Misfit::NotWhole { index, .. },
            ) => {
                let (gene, value) = (&space.genes[index], genotype.numbers()[index]);
                let (low, high) = gene.gene.bounds();
                let place = format!("{field}.genome[{}][{}]", index / genes, index % genes);
                conflict(place, format!("{} = {value} is out of range: allowed is {low} to {high}", gene.name))
            }
            Err(misfit) => conflict(format!("{field}.genome"), misfit.to_string()),
        }
    }
}

/// Returns gaits that are written out in the job; rejects a path. `field` is the key that holds the gaits.
pub(super) fn written_out<'a>(field: &str, gaits: &'a Reference<GaitSet>) -> Result<&'a GaitSet, Invalid> {
    match gaits {
        Reference::Inline(gaits) => Ok(gaits),
        Reference::Named(path) => Err(Invalid::Conflict {
            field: field.into(),
            reason: format!(
                "\"{path}\" is a path, which only the `evogait` command reads, and only if the robot and [gaits] are \
                 valid: correct them, or write the gaits into the job"
            ),
        }),
    }
}

impl PlanSpec {
    /// Rejects numbers out of range, and gaits that are not written out.
    pub(super) fn validate(&self, iterations: u32) -> Result<(), Invalid> {
        let mut faults = Faults::default();
        faults.take(whole_in_range("plan.seeds", self.seeds, (1, MAX_PLAN_SEEDS.into()), ""));
        let all = u64::from(self.seeds) * u64::from(iterations);
        faults.take(whole_in_range("plan.seeds * planner.iterations", all, (1, MAX_PLAN_STEPS), ""));
        faults.take(written_out("plan.gaits", &self.gaits).map(|_| ()));
        faults.end()
    }
}
