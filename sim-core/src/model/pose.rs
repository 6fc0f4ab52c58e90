//! Where a robot is and how its joints stand.

use super::Robot;
use crate::base::math::{Pose, Vector, about};

/// A configuration at rest: pose of the pivot and joint angles (rad). A node's q has no velocities.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Pose of the pivot, mu.
    pub pivot: Pose,
    /// Joint angles in the order of the robot's hinges, rad.
    pub joints: Vec<f32>,
}

impl State {
    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.pivot.is_finite() && self.joints.iter().all(|a| a.is_finite())
    }
}

impl Robot {
    /// The neutral configuration with its lowest corner on the ground z = 0, the pivot at x = y = 0.
    pub fn neutral(&self) -> State {
        let mut state = State { pivot: Pose::identity(), joints: vec![0.0; self.hinges.len()] };
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
