//! The start of a robot: its neutral configuration lowered to the ground until at rest.

use super::{Engine, Motion, Outcome, Physics, Request, Rollout};
use crate::base::math::{Pose, Vector, about_z, heading};
use crate::model::{Robot, State};

/// Slower than this, a robot is at rest, mu/s.
const REST: f32 = 0.01;
/// Length of a settling run, s, and how many there are at most.
const RUN: f64 = 2.0;
const RUNS: usize = 10;

/// Longest time that settling on one setting simulates, s.
pub const LONGEST_SETTLING: f64 = RUN * RUNS as f64;

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
        /// Simulated time, s.
        seconds: f64,
    },
    /// The caller gave it up.
    #[error("stopped before the robot came to rest")]
    Stopped,
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

/// Does what [`settle_until`] does, where joints that turn slowly are no rest.
pub(crate) fn settle_still(
    engine: &dyn Engine,
    robot: &Robot,
    physics: &Physics,
    stop: &dyn Fn() -> bool,
) -> Result<State, Unsettled> {
    stand(engine, robot, physics, |rollout| drift(rollout) < REST, stop)
}

/// Lets the robot stand until it is slow at the end of a run, and the run satisfies `still`.
fn stand(
    engine: &dyn Engine,
    robot: &Robot,
    physics: &Physics,
    still: impl Fn(&Rollout) -> bool,
    stop: &dyn Fn() -> bool,
) -> Result<State, Unsettled> {
    let motion = Motion::standing(robot.hinges.len(), RUN);
    let mut state = robot.neutral();
    // A little above the ground: exact ties of all corners at distance 0 are no generic start.
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

/// The same state at x = y = 0 with heading 0.
pub(crate) fn canonical(state: State) -> State {
    let pivot = state.pivot;
    let turn = about_z(-heading(pivot.rotation));
    let rotation = (turn * pivot.rotation).normalize();
    let translation = Vector::new(0.0, 0.0, pivot.translation.z);
    let velocities = state.velocities.map(|velocities| velocities.turned(turn));
    State { pivot: Pose::from_parts(translation, rotation), velocities, ..state }
}
