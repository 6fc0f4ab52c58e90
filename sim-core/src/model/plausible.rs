//! Warnings about inertias and sizes of robots that can be simulated but are probably not intended.

use super::{Body, Robot, RobotSpec};
use crate::base::math::{Pose, Vector};

/// Ratio above which an inertia is doubted: the radius of gyration over the distance that the shapes reach from the
/// centre of mass.
const FAR: f32 = 2.0;
/// Usual lengths of bodies, mu. Bodies of modules are about 1 mu long; other lengths may be in another unit.
const USUAL: (f32, f32) = (0.2, 10.0);

impl Robot {
    /// Returns a warning for each inertia that no body with such shapes can have.
    pub fn doubts(&self) -> Vec<String> {
        self.bodies.iter().filter_map(doubt).collect()
    }

    /// Returns the length, in the robot's own unit, that would make its body of median length 1 mu long, with two
    /// significant digits. `None` if that body has a usual length.
    pub fn unit_in_doubt(&self) -> Option<f64> {
        let mut lengths: Vec<f32> = self.bodies.iter().filter_map(length).collect();
        lengths.sort_by(f32::total_cmp);
        let middle = *lengths.get(lengths.len() / 2)?;
        let text = format!("{middle:.1e}");
        (!(USUAL.0..=USUAL.1).contains(&middle)).then(|| text.parse().ok()).flatten()
    }
}

fn doubt(body: &Body) -> Option<String> {
    let reach = body.corners().map(|corner| (corner - body.center_of_mass).length()).fold(0.0, f32::max);
    let largest = (0..3).map(|axis| body.inertia[axis][axis]).fold(0.0, f32::max);
    let arm = (largest / body.mass).sqrt();
    (reach > 0.0 && arm > FAR * reach).then(|| {
        format!(
            "body \"{}\": with an inertia of {largest} kg·mu² its {} kg would be {arm:.2} mu from its centre of mass, but \
             its shapes reach only {reach:.2} mu",
            body.name, body.mass
        )
    })
}

/// Returns the longest side of the box around a body's shapes, mu; `None` without shapes.
fn length(body: &Body) -> Option<f32> {
    let (low, high) = body
        .corners()
        .fold((Vector::splat(f32::INFINITY), Vector::splat(f32::NEG_INFINITY)), |(l, h), c| (l.min(c), h.max(c)));
    let size = high - low;
    let longest = size.x.max(size.y).max(size.z);
    longest.is_finite().then_some(longest)
}

impl Body {
    /// Returns the corners of the boxes around its shapes, in its frame.
    fn corners(&self) -> impl Iterator<Item = Vector> + '_ {
        let boxes = self.boxes.iter().map(|b| (b.pose, b.half));
        let capsules = self
            .capsules
            .iter()
            .flat_map(|c| c.ends.map(|end| (Pose::from_parts(end, Default::default()), Vector::splat(c.radius))));
        let prisms = self.prisms.iter().flat_map(|prism| prism.corners().iter().copied());
        let corners = boxes.chain(capsules).flat_map(|(pose, half)| {
            (0..8u8).map(move |i| {
                let side = |bit: u8| if i & bit == 0 { -1.0 } else { 1.0 };
                pose.transform_point(Vector::new(half.x * side(1), half.y * side(2), half.z * side(4)))
            })
        });
        corners.chain(prisms)
    }
}

impl RobotSpec {
    /// Returns the robot with lengths in units of `unit`: a body that is `unit` long becomes 1 mu long. Masses stay.
    /// Modules keep the size of their kind.
    pub fn in_units_of(&self, unit: f64) -> RobotSpec {
        let mut robot = self.clone();
        let length = |value: &mut f64| *value /= unit;
        for body in &mut robot.bodies {
            body.center_of_mass.iter_mut().for_each(length);
            body.inertia.iter_mut().for_each(|moment| *moment /= unit * unit);
            if let Some(hinge) = &mut body.hinge {
                hinge.anchor.iter_mut().for_each(length);
                hinge.torque.iter_mut().for_each(|torque| *torque /= unit * unit);
            }
            body.boxes.iter_mut().for_each(|part| part.center.iter_mut().chain(&mut part.half).for_each(length));
            for part in &mut body.capsules {
                part.from.iter_mut().chain(&mut part.to).for_each(length);
                length(&mut part.radius);
            }
        }
        robot
    }
}
