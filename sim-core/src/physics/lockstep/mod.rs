//! The lockstep engine: many rollouts of one robot at once, one in each SIMD lane.
//!
//! It uses reduced coordinates (a floating base and hinges), implicit motors, and contacts linearised so that they
//! become inertia of the bodies that they touch. So the cost of a step hardly depends on what happens in it, and lanes
//! never wait for each other. Ground is flat or has stairs; a robot is any tree of hinges that the project can compile,
//! with boxes as shapes.
//!
//! Modules: `model` (robot and constants), `kinematics`, `inertia`, `contact` (flat ground), `terrain`, `uneven` and
//! `general` (stairs), `touch` (contact between bodies), `factor` (mass matrix), `step`, `batch` (rollouts into lanes,
//! outcomes out of them).
//!
//! Lanes are f32. IEEE 754 rounds every operation correctly, and lanes do not affect each other. So results have the
//! same bits at any width, on any instruction set and in any batch.

// Indices are those of the equations.
#![expect(clippy::needless_range_loop)]

mod batch;
mod contact;
mod factor;
mod general;
mod inertia;
mod kinematics;
mod lanes;
mod model;
mod step;
mod terrain;
mod touch;
mod uneven;

pub use crate::base::simd::Level;
use crate::base::simd::at_level;
use crate::model::Robot;
use crate::model::environment::Block;
use crate::physics::{Course, Engine, Motion, Physics, Request, Rollout, Unsupported};
use fearless_simd::{Simd, SimdBase};

/// Revision of this engine, raised by hand when a change alters results. Measured fidelity is valid for one revision.
pub const REVISION: u32 = 1;

/// The lockstep engine, at the widest instruction set that this CPU has. Its `substeps` are the number of
/// linearisations of contacts and motors in a step.
pub struct LockstepEngine;

/// Checks that the engine can simulate this robot on this terrain.
///
/// # Errors
/// If the engine does not support the terrain or a shape of the robot.
pub fn supports(robot: &Robot, terrain: &[Block]) -> Result<(), Unsupported> {
    if !terrain::known(terrain) {
        return Err(Unsupported::Terrain);
    }
    if robot.bodies.iter().any(|body| !body.capsules.is_empty()) {
        return Err(Unsupported::Capsules);
    }
    if robot.bodies.iter().any(|body| !body.prisms.is_empty()) {
        return Err(Unsupported::Prisms);
    }
    Ok(())
}

impl Engine for LockstepEngine {
    fn supports(&self, robot: &Robot, terrain: &[Block], motion: &Motion) -> Result<(), Unsupported> {
        supports(robot, terrain)?;
        motion.events().iter().try_for_each(|event| Unsupported::of_event(robot, &event.change))
    }

    fn run(&self, robot: &Robot, physics: &Physics, terrain: &[Block], batch: &[Request<'_>]) -> Vec<Rollout> {
        if let Err(reason) = supports(robot, terrain) {
            return batch.iter().map(|request| Rollout::refused(robot, request.start, reason)).collect();
        }
        run_at(Level::new(), robot, physics, terrain, batch)
    }

    /// Simulates one rollout on flat ground; checks `stop` before every step.
    fn run_until(
        &self,
        robot: &Robot,
        physics: &Physics,
        request: &Request<'_>,
        stop: &dyn Fn() -> bool,
    ) -> Option<Rollout> {
        if let Err(reason) = supports(robot, &[]) {
            return Some(Rollout::refused(robot, request.start, reason));
        }
        run_until_at(Level::new(), robot, physics, &[], &[*request], stop)?.pop()
    }

    fn lanes(&self) -> usize {
        width(Level::new())
    }
}

/// Simulates a batch on a given instruction set.
pub fn run_at(
    level: Level,
    robot: &Robot,
    physics: &Physics,
    terrain: &[Block],
    batch: &[Request<'_>],
) -> Vec<Rollout> {
    run_until_at(level, robot, physics, terrain, batch, &|| false).expect("a batch without a stop runs to its end")
}

fn run_until_at(
    level: Level,
    robot: &Robot,
    physics: &Physics,
    terrain: &[Block],
    batch: &[Request<'_>],
    stop: &dyn Fn() -> bool,
) -> Option<Vec<Rollout>> {
    let model = model::Model::new(robot, physics);
    let course = |request: &Request<'_>| Course::new(robot, physics, request.start, request.motion);
    let batch: Vec<(Request<'_>, Course)> = batch.iter().map(|request| (*request, course(request))).collect();
    let layers = terrain::layers(terrain);
    if layers.is_empty() {
        at_level!(level, simd => batch::run(simd, &model, physics, contact::Corners::new(&model), &batch, stop))
    } else {
        at_level!(level, simd => batch::run(simd, &model, physics, uneven::Uneven::new(&layers), &batch, stop))
    }
}

/// Returns the number of lanes of an instruction set.
fn width(level: Level) -> usize {
    fn of<S: Simd>(_: S) -> usize {
        <S::f32s as SimdBase<S>>::LEN
    }
    at_level!(level, simd => of(simd))
}

#[cfg(test)]
mod closed_form;
#[cfg(test)]
mod on_blocks;
#[cfg(test)]
mod tests;
