//! Execution of motions one after the other, from any place of a robot on the map.

use super::Scene;
use crate::base::math::heading;
use crate::model::environment::Environment;
use crate::model::{Place, Robot, State};
use crate::physics::{Engine, Motion, Physics, Request, Rollout, canonical};
use crate::plan::standing_at;

/// Robot, engine and environment in which motions are executed.
#[derive(Clone, Copy)]
pub struct Stage<'a> {
    /// The robot.
    pub robot: &'a Robot,
    /// Engine that simulates the motions.
    pub engine: &'static dyn Engine,
    /// Setting of the engine.
    pub physics: &'a Physics,
    /// Environment with map and terrain.
    pub environment: &'a Environment,
}

/// A robot at a place of the map.
#[derive(Clone, Debug, PartialEq)]
pub struct Standing {
    /// Configuration of the robot, in any frame of the same height: only joints, tilt and velocities count.
    pub state: State,
    /// Place of the robot's pivot on the map.
    pub place: Place,
}

/// Rollout of an executed motion, and its frame on the map.
#[derive(Clone, Debug, PartialEq)]
pub struct Executed {
    /// Rollout of the motion.
    pub rollout: Rollout,
    /// Place of the rollout's frame on the map.
    pub frame: Place,
}

impl<'a> Stage<'a> {
    /// Returns the stage of a scene.
    pub fn of(scene: &'a dyn Scene) -> Self {
        Self {
            robot: scene.robot(),
            engine: scene.engine(),
            physics: scene.physics(),
            environment: scene.environment(),
        }
    }

    /// Executes a motion. On flat ground it is simulated in the canonical frame and laid out on the map; with terrain
    /// it is simulated in the map itself.
    pub fn execute(&self, from: &Standing, motion: &Motion) -> Executed {
        let (start, terrain, frame) = if self.environment.is_flat() {
            (canonical(from.state.clone()), [].as_slice(), from.place)
        } else {
            (standing_at(&from.state, &from.place), self.environment.terrain.as_slice(), Place::ORIGIN)
        };
        let request = Request { start: &start, motion };
        let rollout = self.engine.run(self.robot, self.physics, terrain, &[request]).swap_remove(0);
        Executed { rollout, frame }
    }
}

impl Standing {
    /// Returns a scene's robot at its start.
    pub fn at_start(scene: &dyn Scene) -> Self {
        Self { state: scene.start().clone(), place: scene.root() }
    }
}

impl Executed {
    /// Returns the end of the motion, at rest.
    pub fn end(&self) -> Standing {
        let State { pivot, .. } = &self.rollout.end;
        let (p, yaw) = (pivot.translation, heading(pivot.rotation));
        let place = self.frame.then(&Place { x: p.x.into(), y: p.y.into(), z: p.z.into(), yaw });
        Standing { state: self.rollout.end.clone().at_rest(), place }
    }

    /// Returns the configuration at a sample, in the map.
    pub fn state(&self, sample: usize) -> State {
        let state = self.rollout.trace.state(sample);
        State::new(self.frame.frame() * state.pivot, state.joints)
    }

    /// Returns the pivot at a sample, (x, y) in the map, mu.
    pub fn point(&self, sample: usize) -> [f64; 2] {
        let p = self.rollout.trace.pivot(sample).translation;
        let (x, y) = self.frame.point(p.x.into(), p.y.into());
        [x, y]
    }

    /// Returns the pivot's path, (x, y) in the map, with about one point every `step` s and both ends.
    pub fn way(&self, step: f32) -> Vec<[f64; 2]> {
        way(&self.rollout, &self.frame, step)
    }
}

/// Returns the pivot's path on a rollout that is laid out in a frame: (x, y) in the map, with about one point every
/// `step` s and both ends.
pub fn way(rollout: &Rollout, frame: &Place, step: f32) -> Vec<[f64; 2]> {
    let last = rollout.trace.len() - 1;
    let mut due = 0.0;
    let mut points = Vec::new();
    for i in 0..=last {
        if rollout.trace.time(i) >= due || i == last {
            let p = rollout.trace.pivot(i).translation;
            let (x, y) = frame.point(p.x.into(), p.y.into());
            points.push([x, y]);
            due += step;
        }
    }
    points
}
