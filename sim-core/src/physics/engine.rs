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
