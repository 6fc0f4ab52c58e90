//! The interface of physics engines.

use super::{Physics, Rollout, Targets};
use crate::model::environment::Block;
use crate::model::{Robot, State};

/// A rollout to be done.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// Where it starts, at rest.
    pub start: &'a State,
    /// What the joints are told.
    pub targets: &'a Targets,
}

/// A physics engine: a batch of rollouts of one robot in, their outcomes out, in the same order.
///
/// A pure function of each request: what else is in the batch changes no bit of any outcome.
pub trait Engine: Send + Sync {
    /// Simulates. Ground is flat at z = 0 with `terrain` standing on it.
    fn run(&self, robot: &Robot, physics: &Physics, terrain: &[Block], batch: &[Request<'_>]) -> Vec<Rollout>;

    /// Rollouts that take as long together as one of them alone, on this machine. Only speed depends on it.
    fn lanes(&self) -> usize {
        1
    }
}
