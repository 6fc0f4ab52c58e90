//! Settling, which finds the start of a robot: its neutral configuration, lowered to the ground until at rest.

use super::{Engine, Motion, Outcome, Physics, Request, Rollout};
use crate::base::math::{Pose, Vector, about_z, heading};
use crate::model::{Robot, State};

/// Speed below which a robot is at rest, mu/s.
const REST: f32 = 0.01;
/// Duration of a settling run, s, and the greatest number of runs.
const RUN: f64 = 2.0;
const RUNS: usize = 10;

/// Longest simulated time of settling on one setting, s.
pub const LONGEST_SETTLING: f64 = RUN * RUNS as f64;

/// Error: a robot does not come to rest by itself.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unsettled {
    /// The simulation is unstable.
    #[error(
        "the robot can't stand still in its neutral configuration: {0}; finer steps (physics.steps_per_second, \
         physics.substeps) or softer motors (physics.stiffness, physics.damping) may help"
    )]
    Unstable(Outcome),
    /// The robot keeps moving.
    #[error(
        "the robot still moves at {speed:.2} mu/s after standing for {seconds} s in its neutral configuration: \
         it must come to rest by itself; give it more physics.damping, physics.stiffness or physics.friction, or a neutral \
         configuration that it can stand or lie in"
    )]
    Moving {
        /// Speed at the end, mu/s.
        speed: f32,
        /// Simulated time, s.
        seconds: f64,
    },
    /// The caller stopped the settling.
    #[error("stopped before the robot came to rest")]
    Stopped,
}

/// Settles a robot on one setting. Returns its start on flat ground, in the canonical frame (x = y = 0, heading 0).
pub fn settle(engine: &dyn Engine, robot: &Robot, physics: &Physics) -> Result<State, Unsettled> {
    settle_until(engine, robot, physics, &|| false)
}

/// Settles a robot as [`settle`] does. Returns [`Unsettled::Stopped`] once `stop` returns true.
pub fn settle_until(
    engine: &dyn Engine,
    robot: &Robot,
    physics: &Physics,
    stop: &dyn Fn() -> bool,
) -> Result<State, Unsettled> {
    stand(engine, robot, physics, |_| true, stop)
}

/// Settles a robot as [`settle_until`] does, but does not accept slowly turning joints as rest.
pub(crate) fn settle_still(
    engine: &dyn Engine,
    robot: &Robot,
    physics: &Physics,
    stop: &dyn Fn() -> bool,
) -> Result<State, Unsettled> {
    stand(engine, robot, physics, |rollout| drift(rollout) < REST, stop)
}

/// Lets the robot stand until it is slow at the end of a run and the run satisfies `still`.
fn stand(
    engine: &dyn Engine,
    robot: &Robot,
    physics: &Physics,
    still: impl Fn(&Rollout) -> bool,
    stop: &dyn Fn() -> bool,
) -> Result<State, Unsettled> {
    let motion = Motion::standing(robot.hinges.len(), RUN);
    let mut state = robot.neutral();
    // A little above the ground, because all corners at exactly distance 0 are not a generic start.
    state.pivot.translation.z += 0.001;
    let mut speed = 0.0;
    for _ in 0..RUNS {
        let request = Request { start: &state, motion: &motion };
        let rollout = engine.run_until(robot, physics, &request, stop).ok_or(Unsettled::Stopped)?;
        if rollout.outcome != Outcome::Completed {
            return Err(Unsettled::Unstable(rollout.outcome));
        }
        speed = rollout.end_speed;
        let rests = speed < REST && still(&rollout);
        speed = speed.max(if speed < REST { drift(&rollout) } else { speed });
        state = canonical(rollout.end.at_rest());
        if rests {
            return Ok(state);
        }
    }
    Err(Unsettled::Moving { speed, seconds: LONGEST_SETTLING })
}

/// Returns the mean speed over the second half of a run: of the pivot, mu/s, or of a joint, rad/s, if that is greater.
/// The end speed of the lockstep engine is that of the bodies' origins, which a slowly turning joint does not move.
fn drift(rollout: &Rollout) -> f32 {
    let last = rollout.trace.len() - 1;
    let (from, to) = (rollout.trace.state(last / 2), rollout.trace.state(last));
    let seconds = rollout.trace.time(last) - rollout.trace.time(last / 2);
    let moved = (to.pivot.translation - from.pivot.translation).length();
    let turned = from.joints.iter().zip(&to.joints).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    moved.max(turned) / seconds
}

/// Returns the same state at x = y = 0 with heading 0.
pub(crate) fn canonical(state: State) -> State {
    let pivot = state.pivot;
    let turn = about_z(-heading(pivot.rotation));
    let rotation = (turn * pivot.rotation).normalize();
    let translation = Vector::new(0.0, 0.0, pivot.translation.z);
    let velocities = state.velocities.map(|velocities| velocities.turned(turn));
    State { pivot: Pose::from_parts(translation, rotation), velocities, ..state }
}
