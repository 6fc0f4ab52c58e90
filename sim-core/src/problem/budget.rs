//! Limits on the cost of an evaluation, in rollouts and physics steps. With them every evaluation ends, with the same
//! bits on every machine.
//!
//! A tree of K iterations with k gaits requests at most K·k rollouts, and over terrain twice as many: first in the
//! canonical frame, then in place. With reuse it needs far fewer; a job can rely on that by setting
//! `planner.max_rollouts`.

use super::{Checked, JobSpec, SimulateSpec};
use crate::base::error::{Invalid, whole_in_range};
use crate::base::limits::{MAX_EVALUATION_STEPS, MAX_PREPARATION, MAX_SUBSTEPS_PER_SECOND};
use crate::control::GaitsSpec;
use crate::model::Robot;
use crate::model::environment::Environment;
use crate::physics::{JointKind, LONGEST_SETTLING, Physics};

impl Checked {
    /// Returns the most rollouts that one evaluation can take; with reuse it takes far fewer.
    pub fn most_rollouts(&self) -> u64 {
        self.rollouts_of(self.0.spec.planner.repeats)
    }

    /// Returns the substeps of a rollout: its physics steps times the substeps of each.
    pub fn steps_per_rollout(&self) -> u64 {
        steps_per_rollout(&self.0.gaits, &self.0.physics)
    }

    /// Returns the most rollouts that carry out a given motion in all of the job's ways; 0 for a job without a motion.
    /// Includes the steps of new plans, but not the rollouts needed to make these plans.
    pub fn motion_rollouts(&self) -> u64 {
        self.0.spec.simulate.as_ref().map_or(0, |simulate| motion_rollouts(simulate, &self.0.spec))
    }

    /// Returns the number of rollouts that `trees` trees of a candidate may simulate; an evaluation that needs more
    /// fails. `as_in_search` is true if the trees reuse transitions as the search does: then `planner.max_rollouts`
    /// applies.
    pub fn rollout_budget(&self, trees: u32, as_in_search: bool) -> u64 {
        let planner = &self.0.spec.planner;
        let asked = planner.max_rollouts.filter(|_| as_in_search);
        let share = |most: u64| most.saturating_mul(trees.into()).div_ceil(planner.repeats.into());
        asked.map_or_else(|| self.rollouts_of(trees), share).min(MAX_EVALUATION_STEPS / self.steps_per_rollout().max(1))
    }

    /// Returns the most work that a preparation can take, in body-substeps: the longest settling on the job's own
    /// setting and on the quiet setting that may follow, and both again on the reference setting.
    pub fn preparation_budget(&self) -> u64 {
        let own = [*self.physics(), self.quiet_setting(0.0).physics];
        let own: u64 = own.iter().map(|physics| settling(self.robot(), physics)).sum();
        own + self.on_reference().map_or(0, Self::preparation_budget)
    }

    fn rollouts_of(&self, trees: u32) -> u64 {
        most_rollouts(&self.0.spec, &self.0.gaits, &self.0.environment, trees)
    }
}

fn most_rollouts(spec: &JobSpec, gaits: &GaitsSpec, environment: &Environment, trees: u32) -> u64 {
    let ways = if environment.is_flat() { 1 } else { 2 };
    ways * u64::from(spec.planner.iterations) * u64::from(gaits.count) * u64::from(trees)
}

fn steps_per_rollout(gaits: &GaitsSpec, physics: &Physics) -> u64 {
    u64::from(physics.steps(gaits.duration)) * u64::from(physics.substeps)
}

fn motion_rollouts(simulate: &SimulateSpec, spec: &JobSpec) -> u64 {
    let steps = simulate.steps.as_ref().map_or(1, |steps| steps.len() as u64);
    let anew = simulate.replan.as_ref().map_or(0, |replan| u64::from(replan.most) * u64::from(spec.planner.iterations));
    let ways = simulate.ways.as_ref().map_or(1, |ways| ways.len() as u64);
    steps * ways + anew
}

/// Rejects a motion if a repeat of it could exceed the limit on physics steps.
pub(super) fn validate_motion(
    spec: &JobSpec,
    gaits: &GaitsSpec,
    physics: &Physics,
    planning: Option<&Checked>,
) -> Result<(), Invalid> {
    validate_substeps(physics)?;
    let Some(simulate) = &spec.simulate else { return Ok(()) };
    let own = motion_rollouts(simulate, spec).saturating_mul(steps_per_rollout(gaits, physics));
    let of_planning = simulate.replan.as_ref().zip(planning).map_or(0, |(replan, planning)| {
        let each = planning.rollout_budget(1, true).saturating_mul(planning.steps_per_rollout());
        each.saturating_mul(replan.most.into())
    });
    let steps = own.saturating_add(of_planning);
    if steps <= MAX_EVALUATION_STEPS {
        return Ok(());
    }
    Err(Invalid::Conflict {
        field: "simulate".into(),
        reason: format!(
            "one repeat could take {steps} physics steps (substeps included): at most {MAX_EVALUATION_STEPS} are allowed; \
             use fewer steps, a shorter motion, a lower simulate.replan.most or planner.iterations, or coarser physics"
        ),
    })
}

fn validate_substeps(physics: &Physics) -> Result<(), Invalid> {
    let substeps = u64::from(physics.steps_per_second) * u64::from(physics.substeps);
    let most = u64::from(MAX_SUBSTEPS_PER_SECOND);
    whole_in_range("physics.steps_per_second * physics.substeps", substeps, (1, most), "")
}

/// Returns the most body-substeps that a robot takes to settle on one setting, weighted so that each takes about the
/// same time on every engine. A box, capsule or prism counts as a body. A step counts as two additional substeps, for its
/// search for contacts. In reduced coordinates (multibody joints) each body's motion involves all others, so n bodies
/// count 1 + n/4 times.
fn settling(robot: &Robot, physics: &Physics) -> u64 {
    let bodies = robot.bodies.len() as u64;
    let shapes: usize =
        robot.bodies.iter().map(|body| body.boxes.len() + body.capsules.len() + body.prisms.len()).sum();
    let quarters = if physics.joints == JointKind::Multibody { 4 + bodies } else { 4 };
    let steps = u64::from(physics.steps(LONGEST_SETTLING));
    steps * (u64::from(physics.substeps) + 2) * (bodies + shapes as u64) * quarters / 4
}

/// Rejects a job if its preparation could exceed the limit on work.
pub(super) fn validate_preparation(job: &Checked) -> Result<(), Invalid> {
    let needed = job.preparation_budget();
    if needed <= MAX_PREPARATION {
        return Ok(());
    }
    let finish = if job.finish().is_some() { ", finish.steps_per_second, finish.substeps" } else { "" };
    let multibody = match job.physics().joints {
        JointKind::Multibody => ", use physics.joints = \"impulse\"",
        JointKind::Impulse => "",
    };
    Err(Invalid::Conflict {
        field: "physics".into(),
        reason: format!(
            "settling the robot of {} bodies could take {needed} body-substeps: at most {MAX_PREPARATION} are allowed; lower \
             physics.steps_per_second, physics.substeps{finish}{multibody}, or use fewer bodies and boxes",
            job.robot().bodies.len()
        ),
    })
}

/// Rejects a job if an evaluation could exceed the limit on physics steps.
pub(super) fn validate(
    spec: &JobSpec,
    gaits: &GaitsSpec,
    environment: &Environment,
    physics: &Physics,
) -> Result<(), Invalid> {
    validate_substeps(physics)?;
    let each = steps_per_rollout(gaits, physics);
    let rollouts = match spec.planner.max_rollouts {
        Some(most) => {
            // The first expansion takes one rollout per gait.
            let least = u64::from(gaits.count);
            whole_in_range("planner.max_rollouts", most, (least, MAX_EVALUATION_STEPS), "")?;
            most
        }
        None => most_rollouts(spec, gaits, environment, spec.planner.repeats),
    };
    match rollouts.checked_mul(each) {
        Some(steps) if steps <= MAX_EVALUATION_STEPS => Ok(()),
        _ => Err(Invalid::Conflict {
            field: "planner".into(),
            reason: format!(
                "an evaluation could take {rollouts} rollouts of {each} physics steps (substeps included): at most \
                 {MAX_EVALUATION_STEPS} steps are allowed, that is {} rollouts; lower iterations, repeats or gaits.count, or \
                 set planner.max_rollouts, beyond which an evaluation fails",
                MAX_EVALUATION_STEPS / each.max(1)
            ),
        }),
    }
}
