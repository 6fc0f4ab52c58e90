//! The interface of physics engines.

use super::{Change, Motion, Physics, Rollout};
use crate::model::environment::Block;
use crate::model::{Robot, State};

/// A rollout to be done.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// State at the start.
    pub start: &'a State,
    /// The motion to execute.
    pub motion: &'a Motion,
}

/// Why an engine can't simulate something.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unsupported {
    /// Terrain that lockstep does not know.
    #[error(
        "of terrain the lockstep engine knows stairs only: blocks on the ground, with sides along x and y, all between the \
         same two lines, which are at least 10 mu apart"
    )]
    Terrain,
    /// Shapes that lockstep does not know.
    #[error("the lockstep engine simulates boxes only, and the robot has capsules")]
    Capsules,
    /// A kind of event, by its name, that no engine executes.
    #[error("no engine executes the event \"{0}\": a robot keeps its modules and their connections during a rollout")]
    Event(&'static str),
    /// An event of a joint that the robot does not have.
    #[error("the event is of joint {joint}, and the robot has {joints} joints, counted from 0")]
    Joint {
        /// Number of the joint.
        joint: usize,
        /// Joints of the robot.
        joints: usize,
    },
    /// A start with connections of its own.
    #[error("no engine starts from a state with connections other than those of the robot")]
    Connections,
}

impl Unsupported {
    /// Refuses what neither engine can change of a robot.
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

/// A physics engine: a batch of rollouts of one robot in, their outcomes out, in the same order.
///
/// A pure function of each request: what else is in the batch changes no bit of any outcome. A rollout builds a fresh world
/// from exactly the numbers of its start, so continuing from the end of another has the same bits wherever it is done.
///
/// [`supports`](Engine::supports) says beforehand whether all of a motion can be simulated. [`run`](Engine::run) needs no such
/// question: what the engine can't do ends the rollout as [`Outcome::Refused`](super::Outcome::Refused), at its start for a
/// robot, terrain or state, and at the event's step for an event. Nothing is left out in silence.
pub trait Engine: Send + Sync {
    /// Checks that the engine can simulate all of a motion of a robot on a terrain.
    ///
    /// # Errors
    /// The first thing that it can't simulate.
    fn supports(&self, robot: &Robot, terrain: &[Block], motion: &Motion) -> Result<(), Unsupported>;

    /// Simulates. Ground is flat at z = 0 with `terrain` standing on it.
    fn run(&self, robot: &Robot, physics: &Physics, terrain: &[Block], batch: &[Request<'_>]) -> Vec<Rollout>;

    /// Simulates one rollout on flat ground, which may be given up on the way: `None` once `stop` says so. Else the bits are
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

    /// Rollouts that take as long together as one of them alone, on this machine. Only speed depends on it.
    fn lanes(&self) -> usize {
        1
    }
}
