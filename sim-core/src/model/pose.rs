//! Poses of a robot and angles of its joints.

use super::Robot;
use crate::base::math::{Pose, Rotation, Vector, about};

/// State of a robot: where it is, how its joints stand, how it moves, and what its controller remembers.
///
/// A rollout that continues from a state starts a fresh world from exactly these numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Pose of the pivot, mu.
    pub pivot: Pose,
    /// Joint angles in the order of the robot's hinges, rad.
    pub joints: Vec<f32>,
    /// Velocities; `None` at rest.
    pub velocities: Option<Velocities>,
    /// Connections of the robot's modules, in the order in which they were made; empty for a robot that keeps those it is
    /// built with.
    pub connections: Vec<Connection>,
    /// State of the controller; empty before it has begun, and where it remembers nothing.
    pub phase: Phase,
}

/// Velocity of a rigid body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Twist {
    /// Angular velocity in world axes, rad/s.
    pub angular: Vector,
    /// Velocity of the body's origin in world axes, mu/s.
    pub linear: Vector,
}

/// Velocities of a robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Velocities {
    /// Of the pivot.
    pub pivot: Twist,
    /// Of the joints in the order of the robot's hinges, rad/s.
    pub rates: Vec<f32>,
}

/// A face of a module, where it connects to others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Face {
    /// Index of the module.
    pub module: usize,
    /// Index of the face in the module's kind.
    pub face: usize,
}

/// Two connected faces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Connection {
    /// The faces.
    pub faces: [Face; 2],
    /// Pose of the second face seen from the first, mu.
    pub relative: Pose,
}

/// State of a controller between two motions, in bytes that only that controller reads.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Phase(pub Vec<u8>);

impl State {
    /// A configuration at rest, before its controller has begun.
    pub fn new(pivot: Pose, joints: Vec<f32>) -> Self {
        Self { pivot, joints, velocities: None, connections: Vec::new(), phase: Phase::default() }
    }

    /// The same configuration at rest, before its controller has begun: a node's q has no velocities.
    pub fn at_rest(self) -> Self {
        Self { velocities: None, phase: Phase::default(), ..self }
    }

    /// Returns true if every number is finite.
    pub fn is_finite(&self) -> bool {
        let moves = |v: &Velocities| {
            v.pivot.angular.is_finite() && v.pivot.linear.is_finite() && v.rates.iter().all(|rate| rate.is_finite())
        };
        self.pivot.is_finite()
            && self.joints.iter().all(|a| a.is_finite())
            && self.velocities.as_ref().is_none_or(moves)
            && self.connections.iter().all(|connection| connection.relative.is_finite())
    }
}

impl Velocities {
    /// The velocities of the robot when it and its motion are turned as a whole.
    pub(crate) fn turned(self, by: Rotation) -> Self {
        let pivot = Twist { angular: by * self.pivot.angular, linear: by * self.pivot.linear };
        Self { pivot, ..self }
    }
}

impl Robot {
    /// The neutral configuration with its lowest corner on the ground z = 0, the pivot at x = y = 0.
    pub fn neutral(&self) -> State {
        let mut state = State::new(Pose::identity(), vec![0.0; self.hinges.len()]);
        let (low, _) = self.bounds(&state);
        state.pivot.translation.z = -low.z;
        state
    }

    /// Forward kinematics: the poses of all bodies.
    pub fn body_poses(&self, state: &State) -> Vec<Pose> {
        let mut poses = Vec::with_capacity(self.bodies.len());
        poses.push(state.pivot);
        for (hinge, &angle) in self.hinges.iter().zip(&state.joints) {
            let carrier: Pose = poses[hinge.parent];
            poses.push(carrier * Pose::from_parts(hinge.anchor, about(hinge.axis, angle)));
        }
        poses
    }

    /// Forward kinematics of velocities: the twists of all bodies at the given poses; `None` at rest.
    pub fn body_twists(&self, state: &State, poses: &[Pose]) -> Option<Vec<Twist>> {
        let velocities = state.velocities.as_ref()?;
        let mut twists: Vec<Twist> = Vec::with_capacity(self.bodies.len());
        twists.push(velocities.pivot);
        for (i, (hinge, &rate)) in self.hinges.iter().zip(&velocities.rates).enumerate() {
            let (carrier, twist) = (poses[hinge.parent], twists[hinge.parent]);
            let arm = poses[i + 1].translation - carrier.translation;
            let angular = twist.angular + carrier.rotation * hinge.axis * rate;
            twists.push(Twist { angular, linear: twist.linear + twist.angular.cross(arm) });
        }
        Some(twists)
    }

    /// The axis-aligned box around the whole robot: (lower, upper) corner, mu.
    pub fn bounds(&self, state: &State) -> (Vector, Vector) {
        let poses = self.body_poses(state);
        let (mut low, mut high) = (Vector::splat(f32::INFINITY), Vector::splat(f32::NEG_INFINITY));
        for (body, pose) in self.bodies.iter().zip(&poses) {
            for part in &body.boxes {
                let placed = *pose * part.pose;
                let mut reach = Vector::ZERO;
                for (axis, half) in [(Vector::X, part.half.x), (Vector::Y, part.half.y), (Vector::Z, part.half.z)] {
                    reach += (placed.rotation * axis).abs() * half;
                }
                low = low.min(placed.translation - reach);
                high = high.max(placed.translation + reach);
            }
            for capsule in &body.capsules {
                for end in capsule.ends.map(|end| pose.transform_point(end)) {
                    low = low.min(end - Vector::splat(capsule.radius));
                    high = high.max(end + Vector::splat(capsule.radius));
                }
            }
        }
        (low, high)
    }
}
