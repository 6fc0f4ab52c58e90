//! Digest of all properties of a robot that its motion depends on.

use super::{Body, Hinge, QUARTER_TURNS, Robot};
use crate::base::digest::Digest;
use crate::base::math::{Pose, Vector};
use serde::Serialize;

#[derive(Serialize)]
struct BodyBits {
    mass: f32,
    center_of_mass: [f32; 3],
    inertia: [[f32; 3]; 3],
    boxes: Vec<([f32; 3], [f32; 4], [f32; 3])>,
    capsules: Vec<([[f32; 3]; 2], f32)>,
}

impl Robot {
    /// Returns the digest of bodies, shapes and joints, by the bits of their numbers. Names are not part of it.
    pub fn mechanics(&self) -> Digest {
        let bodies: Vec<BodyBits> = self.bodies.iter().map(body).collect();
        let hinge = |h: &Hinge| (h.parent as u64, h.anchor.to_array(), h.axis.to_array());
        let hinges: Vec<_> = self.hinges.iter().map(hinge).collect();
        let own = |h: &Hinge| (h.limits, h.speed, h.torque);
        let owns: Vec<_> = self.hinges.iter().map(own).collect();
        let corners = |b: &Body| b.prisms.iter().map(|p| p.corners().iter().map(|c| c.to_array()).collect()).collect();
        let prisms: Vec<Vec<Vec<[f32; 3]>>> = self.bodies.iter().map(corners).collect();
        if prisms.iter().any(|of_body| !of_body.is_empty()) {
            return Digest::of("evogait mechanics 1", &(bodies, hinges, owns, prisms));
        }
        if owns.iter().all(|own| *own == (QUARTER_TURNS, None, None)) {
            return Digest::of("evogait mechanics 1", &(bodies, hinges));
        }
        Digest::of("evogait mechanics 1", &(bodies, hinges, owns))
    }
}

fn body(body: &Body) -> BodyBits {
    let pose = |p: &Pose| (p.translation.to_array(), p.rotation.to_array());
    BodyBits {
        mass: body.mass,
        center_of_mass: body.center_of_mass.to_array(),
        inertia: body.inertia,
        boxes: body.boxes.iter().map(|b| (pose(&b.pose).0, pose(&b.pose).1, b.half.to_array())).collect(),
        capsules: body.capsules.iter().map(|c| (c.ends.map(|end: Vector| end.to_array()), c.radius)).collect(),
    }
}
