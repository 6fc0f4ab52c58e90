//! The start of a robot: its neutral configuration lowered to the ground until at rest.

use super::{Engine, Outcome, Physics, Request};
use crate::control::Targets;
use crate::math::{Pose, Vector, about_z, heading};
use crate::robot::{Robot, State};

/// Slower than this, a robot is at rest, mu/s.
const REST: f32 = 0.01;
/// A settling run, s, and how many there are at most.
const RUN: f64 = 2.0;
const RUNS: usize = 10;

/// A robot that does not come to rest by itself.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unsettled {
    /// The simulation broke.
    #[error("the robot can't stand still in its neutral configuration: {0}")]
    Unstable(Outcome),
    /// It keeps moving.
    #[error("the robot still moves at {speed} mu/s after standing for {seconds} s in its neutral configuration")]
    Moving {
        /// mu/s.
        speed: f32,
        /// s.
        seconds: f64,
    },
}

/// The settled start on flat ground, in the canonical frame (x = y = 0, heading 0).
pub fn settle(engine: &dyn Engine, robot: &Robot, physics: &Physics) -> Result<State, Unsettled> {
    let targets = Targets::zero(robot.hinges.len(), RUN);
    let mut state = robot.neutral();
    // A little above the ground: exact ties of all corners at distance 0 are no generic start.
    state.pivot.translation.z += 0.001;
    let mut speed = 0.0;
    for _ in 0..RUNS {
        let request = Request { start: &state, targets: &targets };
        let rollout = engine.run(robot, physics, &[], &[request]).swap_remove(0);
        if rollout.outcome != Outcome::Completed {
            return Err(Unsettled::Unstable(rollout.outcome));
        }
        state = canonical(rollout.end);
        speed = rollout.end_speed;
        if speed < REST {
            return Ok(state);
        }
    }
    Err(Unsettled::Moving { speed, seconds: RUN * RUNS as f64 })
}

/// The same configuration at x = y = 0 with heading 0.
pub(crate) fn canonical(state: State) -> State {
    let State { pivot, joints } = state;
    let rotation = (about_z(-heading(pivot.rotation)) * pivot.rotation).normalize();
    let translation = Vector::new(0.0, 0.0, pivot.translation.z);
    State { pivot: Pose::from_parts(translation, rotation), joints }
}
