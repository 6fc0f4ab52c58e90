//! Distance between two configurations.

use crate::base::math::{about_z, heading, wrap};
use crate::model::{Place, State};

/// Metric of the planner, mu: ϱ(p, q) = √(Δx² + Δy² + (w_z·Δz)² + (w·Δyaw)² + (w_roll·Δroll)² + (w_pitch·Δpitch)² +
/// w_joints²·ΣΔangle²). The paper gives no metric. Each weight converts its coordinate to mu; a weight of 0 leaves the
/// coordinate out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Metric {
    /// w, weight of the heading, mu/rad.
    pub yaw_weight: f64,
    /// w_z, weight of the height, a pure number.
    pub z: f64,
    /// w_roll, weight of the tilt about the heading, mu/rad.
    pub roll: f64,
    /// w_pitch, weight of the tilt about the axis to the left of the heading, mu/rad.
    pub pitch: f64,
    /// w_joints, weight of each joint angle, mu/rad.
    pub joints: f64,
}

/// Tilt and joint angles of a configuration, rad; its other part is its place.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Posture {
    /// Roll and pitch: x and y of the rotation vector that remains if the heading is removed from the pivot's rotation.
    pub tilt: [f64; 2],
    /// Joint angles.
    pub joints: Vec<f64>,
}

impl Posture {
    /// Returns the posture of a configuration.
    pub fn of(state: &State) -> Self {
        let rotation = state.pivot.rotation;
        // Without the rotation about z, a rotation about a horizontal axis remains.
        let tilt = about_z(-heading(rotation)) * rotation;
        let (x, y, w) = (f64::from(tilt.x), f64::from(tilt.y), f64::from(tilt.w));
        let sine = (x * x + y * y).sqrt();
        let turn = if sine > 0.0 { wrap(2.0 * libm::atan2(sine, w)) / sine } else { 0.0 };
        Self { tilt: [x * turn, y * turn], joints: state.joints.iter().map(|angle| f64::from(*angle)).collect() }
    }
}

impl Metric {
    /// Returns ϱ² of two places without the share of their postures, mu². It is symmetric, and 0 for equal places.
    /// Squares have the order of distances.
    pub fn squared(&self, p: &Place, q: &Place) -> f64 {
        let (dx, dy) = (p.x - q.x, p.y - q.y);
        let dz = if self.z == 0.0 { 0.0 } else { self.z * (p.z - q.z) };
        let turn = self.yaw_weight * wrap(p.yaw - q.yaw);
        dx * dx + dy * dy + dz * dz + turn * turn
    }

    /// Returns the share of two postures in ϱ², mu².
    pub fn squared_of_postures(&self, p: &Posture, q: &Posture) -> f64 {
        let [roll, pitch] = [0, 1].map(|i| p.tilt[i] - q.tilt[i]);
        let (roll, pitch) = (self.roll * roll, self.pitch * pitch);
        let turned = |(a, b): (&f64, &f64)| self.joints * (a - b) * (self.joints * (a - b));
        roll * roll + pitch * pitch + p.joints.iter().zip(&q.joints).map(turned).sum::<f64>()
    }

    /// Returns true if the metric weighs tilt or joint angles.
    pub fn weighs_postures(&self) -> bool {
        self.roll != 0.0 || self.pitch != 0.0 || self.joints != 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::{Pose, Vector, about};

    #[test]
    fn posture_has_tilt_without_heading_and_joint_angles() {
        for yaw in [-2.0, 0.0, 0.7, 3.0] {
            for (axis, tilt) in [(Vector::X, [0.4, 0.0]), (Vector::Y, [0.0, 0.4])] {
                let rotation = about_z(yaw) * about(axis, 0.4);
                let posture = Posture::of(&State::new(Pose::from_parts(Vector::ZERO, rotation), vec![0.5, -1.0]));
                assert!((0..2).all(|i| (posture.tilt[i] - tilt[i]).abs() < 1e-6), "{posture:?}");
                assert_eq!(posture.joints, [0.5, -1.0]);
            }
        }
    }

    #[test]
    fn each_weight_converts_its_coordinate_to_mu() {
        let metric = Metric { yaw_weight: 0.5, z: 2.0, roll: 3.0, pitch: 4.0, joints: 5.0 };
        let place = Place { x: 3.0, y: 4.0, z: 1.0, yaw: 2.0 };
        assert_eq!(metric.squared(&Place::ORIGIN, &place), 9.0 + 16.0 + 4.0 + 1.0);
        let posture = Posture { tilt: [1.0, 0.5], joints: vec![0.2, 0.4] };
        let rest = Posture { tilt: [0.0; 2], joints: vec![0.0; 2] };
        assert!((metric.squared_of_postures(&posture, &rest) - (9.0 + 4.0 + 1.0 + 4.0)).abs() < 1e-12);
        assert!(!Metric { yaw_weight: 0.5, z: 1.0, ..Metric::default() }.weighs_postures());
    }
}
