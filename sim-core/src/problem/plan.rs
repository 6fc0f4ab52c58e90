//! The `[plan]` table of a job: gaits that are given, and how many trees are grown with them.

use super::Reference;
use crate::base::error::{Faults, Invalid, whole_in_range};
use crate::base::limits::{MAX_PLAN_SEEDS, MAX_PLAN_STEPS};
use crate::control::GaitsSpec;
use crate::genotype::{Genotype, Misfit, Space};
use crate::model::Robot;
use serde::{Deserialize, Serialize};

/// Name of the procedure that has this table.
pub const PLAN: &str = "plan";

/// The `[plan]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanSpec {
    /// Trees, each with random numbers of its own.
    #[serde(default = "seeds")]
    pub seeds: u32,
    /// The gaits: a path to a run's folder or to its gaits.json, or the table itself.
    pub gaits: Reference<GaitSet>,
}

fn seeds() -> u32 {
    20
}

/// Gaits with all their numbers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GaitSet {
    /// The robot's joints, in its order: gaits of another robot are refused.
    pub joints: Vec<String>,
    /// Of each gait its numbers, in the order of the controller's parameters, joint after joint.
    pub genome: Vec<Vec<f64>>,
}

impl GaitSet {
    /// As one genotype.
    pub fn genotype(&self) -> Genotype {
        self.genome.iter().flatten().copied().collect()
    }
}

impl PlanSpec {
    /// Refuses numbers out of range, and gaits that are not written out.
    pub(super) fn validate(&self, iterations: u32) -> Result<(), Invalid> {
        let mut faults = Faults::default();
        faults.take(whole_in_range("plan.seeds", self.seeds, (1, MAX_PLAN_SEEDS.into()), ""));
        let all = u64::from(self.seeds) * u64::from(iterations);
        faults.take(whole_in_range("plan.seeds * planner.iterations", all, (1, MAX_PLAN_STEPS), ""));
        faults.take(self.given().map(|_| ()));
        faults.end()
    }

    /// The gaits.
    pub(super) fn given(&self) -> Result<&GaitSet, Invalid> {
        match &self.gaits {
            Reference::Inline(gaits) => Ok(gaits),
            Reference::Named(path) => Err(Invalid::Conflict {
                field: "plan.gaits".into(),
                reason: format!("\"{path}\" is a path, which only `evogait` follows: write the gaits out"),
            }),
        }
    }

    /// The gaits as a candidate of the job's space; refuses those of another robot or controller.
    pub(super) fn genotype(&self, robot: &Robot, gaits: &GaitsSpec, space: &Space) -> Result<Genotype, Invalid> {
        let given = self.given()?;
        let conflict = |field: &str, reason: String| Err(Invalid::Conflict { field: field.into(), reason });
        let joints = robot.joint_names();
        if given.joints != joints {
            let reason = format!(
                "they are of a robot with joints {}, and \"{}\" has {}",
                given.joints.join(", "),
                robot.name,
                joints.join(", ")
            );
            return conflict("plan.gaits", reason);
        }
        if given.genome.len() != gaits.count as usize {
            let reason = format!("there are {}, and gaits.count = {}", given.genome.len(), gaits.count);
            return conflict("plan.gaits.genome", reason);
        }
        let genes = space.genes.len() / given.genome.len();
        if let Some((i, gait)) = given.genome.iter().enumerate().find(|(_, gait)| gait.len() != genes) {
            let reason = format!(
                "it has {} numbers, and a gait of controller \"{}\" on this robot has {genes}",
                gait.len(),
                gaits.controller.0.name()
            );
            return conflict(&format!("plan.gaits.genome[{i}]"), reason);
        }
        let genotype = given.genotype();
        match space.check(&genotype) {
            Ok(()) => Ok(genotype),
            Err(
                Misfit::OutOfBounds { index, .. } | Misfit::NotFinite { index, .. } | Misfit::NotWhole { index, .. },
            ) => {
                let (gene, value) = (&space.genes[index], genotype.numbers()[index]);
                let (low, high) = gene.gene.bounds();
                let field = format!("plan.gaits.genome[{}][{}]", index / genes, index % genes);
                conflict(&field, format!("{} = {value} is out of range: allowed is {low} to {high}", gene.name))
            }
            Err(misfit) => conflict("plan.gaits.genome", misfit.to_string()),
        }
    }
}
