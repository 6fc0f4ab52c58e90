//! The start of a robot: its neutral configuration lowered to the ground until at rest.

use super::{Engine, Outcome, Physics, Request, Rollout, engine};
use crate::control::Targets;
use crate::job::{EngineKind, JointKind};
use crate::lockstep;
use crate::math::{Pose, Vector, about_z, heading};
use crate::robot::{Robot, State};
use std::fmt;

/// Slower than this, a robot is at rest, mu/s.
const REST: f32 = 0.01;
/// Length of a settling run, s, and how many there are at most.
const RUN: f64 = 2.0;
const RUNS: usize = 10;
/// Steps a second and substeps of the quiet setting on the lockstep engine.
const QUIET_LOCKSTEP: (u32, u32) = (600, 2);
/// Steps a second and substeps of the quiet setting on rapier with multibody joints, for robots with capsules.
const QUIET_MULTIBODY: (u32, u32) = (240, 4);

/// Longest time that settling on one setting simulates, s.
pub const LONGEST: f64 = RUN * RUNS as f64;

/// A robot that does not come to rest by itself.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unsettled {
    /// The simulation broke.
    #[error(
        "the robot can't stand still in its neutral configuration: {0}; finer steps (physics.steps_per_second, \
         physics.substeps) or softer motors (physics.stiffness, physics.damping) may hold it"
    )]
    Unstable(Outcome),
    /// It keeps moving.
    #[error(
        "the robot still moves at {speed:.2} mu/s after standing for {seconds} s in its neutral configuration: it must come \
         to rest by itself; give it more physics.damping, physics.stiffness or physics.friction, or a neutral \
         configuration that it can stand or lie in"
    )]
    Moving {
        /// mu/s.
        speed: f32,
        /// s.
        seconds: f64,
    },
    /// The caller gave it up.
    #[error("stopped before the robot came to rest")]
    Stopped,
}

/// A settled start.
#[derive(Clone, Debug, PartialEq)]
pub struct Settled {
    /// The start on flat ground, in the canonical frame (x = y = 0, heading 0).
    pub state: State,
    /// The setting that it was found on, if the rollouts' own kept it trembling.
    pub quiet: Option<Quiet>,
}

/// The setting that a robot was settled on because it trembles on the one of its rollouts: the impulses that hold a joint
/// together there overshoot, step by step, and MuJoCo or reduced coordinates hold the same robot still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quiet {
    /// The engine.
    pub engine: EngineKind,
    /// Its setting.
    pub physics: Physics,
    /// Speed at which the robot trembles on the setting of its rollouts, mu/s.
    pub trembling: f32,
}

impl Quiet {
    /// The quiet setting of a robot that trembles at so many mu/s on the setting of its rollouts.
    pub fn of(robot: &Robot, physics: &Physics, trembling: f32) -> Self {
        let lockstep = lockstep::supports(robot, &[]).is_ok();
        let (engine, joints, steps) = match lockstep {
            true => (EngineKind::Lockstep, JointKind::Impulse, QUIET_LOCKSTEP),
            false => (EngineKind::Rapier, JointKind::Multibody, QUIET_MULTIBODY),
        };
        let physics = Physics { steps_per_second: steps.0, substeps: steps.1, joints, ..*physics };
        Self { engine, physics, trembling }
    }
}

impl fmt::Display for Quiet {
    /// Such as "on lockstep, 600 steps a second, 2 substeps: on the job's own setting it keeps trembling at 0.08 mu/s".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let joints = if self.engine == EngineKind::Rapier { " with multibody joints" } else { "" };
        write!(
            f,
            "on {}{joints}, {} steps a second, {} substeps: on the job's own setting it keeps trembling at {:.2} mu/s",
            self.engine, self.physics.steps_per_second, self.physics.substeps, self.trembling
        )
    }
}

/// Settles a robot on the setting of its rollouts, or on a quiet one where that keeps it trembling.
///
/// # Errors
/// The simulation breaks on the setting of its rollouts, or the robot moves on both.
pub fn settle_quietly(kind: EngineKind, robot: &Robot, physics: &Physics) -> Result<Settled, Unsettled> {
    settle_quietly_until(kind, robot, physics, &|| false)
}

/// Does what [`settle_quietly`] does until `stop` says so: then it returns [`Unsettled::Stopped`].
pub fn settle_quietly_until(
    kind: EngineKind,
    robot: &Robot,
    physics: &Physics,
    stop: &dyn Fn() -> bool,
) -> Result<Settled, Unsettled> {
    match settle_until(engine(kind), robot, physics, stop) {
        Ok(state) => Ok(Settled { state, quiet: None }),
        Err(Unsettled::Moving { speed, .. }) => {
            let quiet = Quiet::of(robot, physics, speed);
            let still = |rollout: &Rollout| drift(rollout) < REST;
            let state = stand(engine(quiet.engine), robot, &quiet.physics, still, stop)?;
            Ok(Settled { state, quiet: Some(quiet) })
        }
        Err(broken) => Err(broken),
    }
}

/// The settled start on flat ground, in the canonical frame (x = y = 0, heading 0), on one setting.
pub fn settle(engine: &dyn Engine, robot: &Robot, physics: &Physics) -> Result<State, Unsettled> {
    settle_until(engine, robot, physics, &|| false)
}

/// Does what [`settle`] does until `stop` says so: then it returns [`Unsettled::Stopped`].
pub fn settle_until(
    engine: &dyn Engine,
    robot: &Robot,
    physics: &Physics,
    stop: &dyn Fn() -> bool,
) -> Result<State, Unsettled> {
    stand(engine, robot, physics, |_| true, stop)
}

/// Lets the robot stand until it is slow at the end of a run, and the run satisfies `still`.
fn stand(
    engine: &dyn Engine,
    robot: &Robot,
    physics: &Physics,
    still: impl Fn(&Rollout) -> bool,
    stop: &dyn Fn() -> bool,
) -> Result<State, Unsettled> {
    let targets = Targets::zero(robot.hinges.len(), RUN);
    let mut state = robot.neutral();
    // A little above the ground: exact ties of all corners at distance 0 are no generic start.
    state.pivot.translation.z += 0.001;
    let mut speed = 0.0;
    for _ in 0..RUNS {
        let request = Request { start: &state, targets: &targets };
        let rollout = engine.run_until(robot, physics, &request, stop).ok_or(Unsettled::Stopped)?;
        if rollout.outcome != Outcome::Completed {
            return Err(Unsettled::Unstable(rollout.outcome));
        }
        speed = rollout.end_speed;
        let rests = speed < REST && still(&rollout);
        speed = speed.max(if speed < REST { drift(&rollout) } else { speed });
        state = canonical(rollout.end);
        if rests {
            return Ok(state);
        }
    }
    Err(Unsettled::Moving { speed, seconds: LONGEST })
}

/// Mean speed over the second half of a run: of the pivot, mu/s, or of a joint, rad/s. The end speed of the lockstep engine
/// is that of the bodies' origins, which a joint that turns slowly does not move.
fn drift(rollout: &Rollout) -> f32 {
    let last = rollout.trace.len() - 1;
    let (from, to) = (rollout.trace.state(last / 2), rollout.trace.state(last));
    let seconds = rollout.trace.time(last) - rollout.trace.time(last / 2);
    let moved = (to.pivot.translation - from.pivot.translation).length();
    let turned = from.joints.iter().zip(&to.joints).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    moved.max(turned) / seconds
}

/// The same configuration at x = y = 0 with heading 0.
pub(crate) fn canonical(state: State) -> State {
    let State { pivot, joints } = state;
    let rotation = (about_z(-heading(pivot.rotation)) * pivot.rotation).normalize();
    let translation = Vector::new(0.0, 0.0, pivot.translation.z);
    State { pivot: Pose::from_parts(translation, rotation), joints }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::Scale;
    use crate::robot::exchange;

    /// A block with an arm at its upper edge that damping alone holds: it sinks for half a minute.
    #[test]
    fn joint_that_turns_slowly_is_no_rest_on_the_quiet_setting() {
        let xml = r#"<mujoco model="arm"><worldbody><body name="root" pos="0 0 2"><freejoint/>
            <geom type="box" size="0.5 0.5 1" mass="9"/>
            <body name="a" pos="0.5 0 0.9"><joint name="j" axis="0 1 0" range="-90 90"/>
            <geom type="box" size="1 0.1 0.1" pos="1.1 0 0" mass="1"/></body></body></worldbody></mujoco>"#;
        let robot = Robot::compile(&exchange::read(xml).unwrap().robot).unwrap();
        for damping in [150.0, 200.0, 300.0] {
            let physics = Physics { stiffness: 0.0, damping, ..Physics::of_scale(Scale::Paper) };
            let quiet = Quiet::of(&robot, &physics, 0.0);
            let found = stand(engine(quiet.engine), &robot, &quiet.physics, |rollout| drift(rollout) < REST, &|| false);
            assert!(matches!(found, Err(Unsettled::Moving { .. })), "{damping}: {found:?}");
        }
        let physics = Physics::of_scale(Scale::Paper);
        let quiet = Quiet::of(&robot, &physics, 0.0);
        stand(engine(quiet.engine), &robot, &quiet.physics, |rollout| drift(rollout) < REST, &|| false).unwrap();
    }
}
