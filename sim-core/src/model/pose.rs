//! Poses, joint angles and velocities of a robot.

use super::Robot;
use crate::base::math::{Pose, Rotation, Vector, about};

/// State of a robot: pose, joint angles, velocities, connections, and the state of its controller.
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
    /// Connections of the robot's modules, in the order in which they were made. Empty for a robot that keeps the
    /// connections that it is built with.
    pub connections: Vec<Connection>,
    /// State of the controller. Empty before the controller has started, and for a controller without state.
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
    /// Velocity of the pivot.
    pub pivot: Twist,
    /// Rates of the joints in the order of the robot's hinges, rad/s.
    pub rates: Vec<f32>,
}

/// Face of a module, which connects to faces of other modules.
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
    /// The two faces.
    pub faces: [Face; 2],
    /// Pose of the second face relative to the first, mu.
    pub relative: Pose,
}

/// State of a controller between two motions, in bytes that only that controller reads.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Phase(pub Vec<u8>);

impl State {
    /// Creates a configuration at rest, before its controller has started.
    pub fn new(pivot: Pose, joints: Vec<f32>) -> Self {
        Self { pivot, joints, velocities: None, connections: Vec::new(), phase: Phase::default() }
    }

    /// Returns the same configuration at rest, before its controller has started: a node's q has no velocities.
    pub fn at_rest(self) -> Self {
        Self { velocities: None, phase: Phase::default(), ..self }
    }

    /// Returns true if all numbers are finite.
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
    /// Returns the velocities after the robot and its motion are turned as a whole.
    pub(crate) fn turned(self, by: Rotation) -> Self {
        let pivot = Twist { angular: by * self.pivot.angular, linear: by * self.pivot.linear };
        Self { pivot, ..self }
    }
}

impl Robot {
    /// Returns the neutral configuration with its lowest corner on the ground z = 0 and the pivot at x = y = 0.
    pub fn neutral(&self) -> State {
        let mut state = State::new(Pose::identity(), vec![0.0; self.hinges.len()]);
        let (low, _) = self.bounds(&state);
        state.pivot.translation.z = -low.z;
        state
    }

    /// Returns the poses of all bodies (forward kinematics).
    pub fn body_poses(&self, state: &State) -> Vec<Pose> {
        let mut poses = Vec::with_capacity(self.bodies.len());
        poses.push(state.pivot);
        for (hinge, &angle) in self.hinges.iter().zip(&state.joints) {
            let carrier: Pose = poses[hinge.parent];
            poses.push(carrier * Pose::from_parts(hinge.anchor, about(hinge.axis, angle)));
        }
        poses
    }

    /// Returns the twists of all bodies at the given poses (forward kinematics of velocities); `None` at rest.
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

    /// Returns the centre of mass, (x, y, z), mu.
    pub fn mass_center(&self, state: &State) -> [f64; 3] {
        let (mut sum, mut mass) = ([0.0; 3], 0.0);
        for (body, pose) in self.bodies.iter().zip(self.body_poses(state)) {
            let (own, at) = (f64::from(body.mass), pose.transform_point(body.center_of_mass).to_array());
            mass += own;
            (0..3).for_each(|axis| sum[axis] += own * f64::from(at[axis]));
        }
        sum.map(|sum| sum / mass)
    }

    /// Returns the axis-aligned box around the whole robot: (lower, upper) corner, mu.
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
            for corner in body.prisms.iter().flat_map(|prism| prism.corners()) {
                let at = pose.transform_point(*corner);
                low = low.min(at);
                high = high.max(at);
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
