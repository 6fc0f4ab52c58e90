//! The interface of physics engines.

use super::{Change, Motion, Physics, Rollout};
use crate::model::environment::Block;
use crate::model::{Robot, State};

/// Start and motion of a rollout to simulate.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// State at the start.
    pub start: &'a State,
    /// The motion to execute.
    pub motion: &'a Motion,
}

/// Reason why an engine can't simulate something.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unsupported {
    /// Terrain that lockstep can't simulate.
    #[error(
        "as terrain the lockstep engine supports stairs only: blocks on the ground, with sides along x and y, \
         all between the same two lines, which are at least 10 mu apart"
    )]
    Terrain,
    /// Capsules, which lockstep can't simulate.
    #[error("the lockstep engine simulates boxes only, and the robot has capsules")]
    Capsules,
    /// Prisms, which lockstep can't simulate.
    #[error("the lockstep engine simulates boxes only, and the robot has D-shaped parts")]
    Prisms,
    /// Event that no engine executes, by the name of its kind.
    #[error("no engine executes the event \"{0}\": a robot keeps its modules and their connections during a rollout")]
    Event(&'static str),
    /// Event of a joint that the robot does not have.
    #[error("the event is of joint {joint}, and the robot has {joints} joints, counted from 0")]
    Joint {
        /// Index of the joint.
        joint: usize,
        /// Number of joints of the robot.
        joints: usize,
    },
    /// Start with connections other than those of the robot.
    #[error("no engine starts from a state with connections other than those of the robot")]
    Connections,
}

impl Unsupported {
    /// Refuses an event that no engine executes, and an event of a joint that the robot does not have.
    pub(crate) fn of_event(robot: &Robot, change: &Change) -> Result<(), Self> {
        let joints = robot.hinges.len();
        match *change {
            Change::Fail { joint } if joint < joints => Ok(()),
            Change::Fail { joint } => Err(Self::Joint { joint, joints }),
            Change::Connect { .. } | Change::Disconnect { .. } | Change::Place { .. } | Change::Replace { .. } => {
                Err(Self::Event(change.name()))
            }
        }
    }
}

/// Physics engine, which simulates a batch of rollouts of one robot and returns their outcomes in the same order.
///
/// An outcome is a pure function of its request: the other requests of the batch change no bit of it. A rollout builds
/// a fresh world from exactly the numbers of its start, so continuing from the end of another rollout gives the same
/// bits everywhere.
///
/// [`supports`](Engine::supports) checks beforehand that all of a motion can be simulated. The check is optional: in
/// [`run`](Engine::run), a part that the engine can't simulate ends the rollout as
/// [`Outcome::Refused`](super::Outcome::Refused). An unsupported robot, terrain or state ends it at its start, an
/// unsupported event at the event's step. No part is left out silently.
pub trait Engine: Send + Sync {
    /// Checks that the engine can simulate all of a motion of a robot on a terrain.
    ///
    /// # Errors
    /// The first part that the engine can't simulate.
    fn supports(&self, robot: &Robot, terrain: &[Block], motion: &Motion) -> Result<(), Unsupported>;

    /// Simulates a batch. The ground is flat at z = 0, and `terrain` stands on it.
    fn run(&self, robot: &Robot, physics: &Physics, terrain: &[Block], batch: &[Request<'_>]) -> Vec<Rollout>;

    /// Simulates one rollout on flat ground. If `stop` ends it early, the result is `None`. Otherwise the bits are
    /// those of [`Engine::run`].
    fn run_until(
        &self,
        robot: &Robot,
        physics: &Physics,
        request: &Request<'_>,
        stop: &dyn Fn() -> bool,
    ) -> Option<Rollout> {
        if stop() { None } else { Some(self.run(robot, physics, &[], &[*request]).swap_remove(0)) }
    }

    /// Returns the number of rollouts that together take as long as one of them alone, on this machine. It affects only
    /// speed.
    fn lanes(&self) -> usize {
        1
    }
}
