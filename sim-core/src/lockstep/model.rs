//! A robot as the engine sees it: a tree of hinges, every body about its own origin.

use crate::math::{Rotation, Vector};
use crate::robot::{JOINT_LIMIT, Robot};
use crate::rollout::Physics;

/// Constants of a robot and its physics, the same in all lanes.
pub(super) struct Model {
    /// Body 0 is the base; hinge i carries body i + 1.
    pub bodies: Vec<Link>,
    pub hinges: Vec<Joint>,
    /// Boxes of bodies that may touch each other: all but of bodies that share a joint.
    pub pairs: Vec<(usize, usize)>,
    pub boxes: Vec<Part>,
    pub gravity: f32,
    pub friction: f32,
    pub stiffness: f32,
    pub damping: f32,
    pub max_torque: f32,
    pub limit: f32,
    /// Step, s.
    pub dt: f32,
    /// Times that contacts and motors are linearised anew within a step.
    pub iterations: u32,
    pub contact: Contact,
}

/// How contacts give way. Forces are a spring and a damper a corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contact {
    /// kg/s².
    pub stiffness: f32,
    /// kg/s.
    pub damping: f32,
    /// Speed at which friction reaches 1/√2 of its full force, mu/s.
    pub slip: f32,
    /// Between two bodies of the robot, kg/s²; explicit, so bounded by the step.
    pub own_stiffness: f32,
    /// kg/s.
    pub own_damping: f32,
}

pub(super) struct Link {
    pub mass: f32,
    pub center: Vector,
    /// About the centre of mass: xx, yy, zz, xy, xz, yz.
    pub inertia: [f32; 6],
    /// Whether the last three are zero.
    pub diagonal: bool,
}

pub(super) struct Joint {
    pub parent: usize,
    /// The hinge that carries the parent.
    pub carrier: Option<usize>,
    pub anchor: Vector,
    pub axis: Vector,
}

/// A box of a body.
pub(super) struct Part {
    pub body: usize,
    pub center: Vector,
    /// Its axes in the body's frame; `None` if they are the body's own.
    pub axes: Option<[Vector; 3]>,
    pub half: Vector,
    /// Of the sphere around it.
    pub radius: f32,
}

impl Model {
    pub fn new(robot: &Robot, physics: &Physics) -> Self {
        let bodies: Vec<Link> = robot
            .bodies
            .iter()
            .map(|b| {
                let i = b.inertia;
                let inertia = [i[0][0], i[1][1], i[2][2], i[0][1], i[0][2], i[1][2]];
                let diagonal = inertia[3..].iter().all(|v| v.abs() <= 1e-6 * inertia[0]);
                Link { mass: b.mass, center: b.center_of_mass, inertia, diagonal }
            })
            .collect();
        let hinges: Vec<Joint> = robot
            .hinges
            .iter()
            .map(|h| Joint { parent: h.parent, carrier: h.parent.checked_sub(1), anchor: h.anchor, axis: h.axis })
            .collect();
        let mut boxes = Vec::new();
        for (body, b) in robot.bodies.iter().enumerate() {
            for part in &b.boxes {
                let r = part.pose.rotation;
                let own = r.x == 0.0 && r.y == 0.0 && r.z == 0.0;
                boxes.push(Part {
                    body,
                    center: part.pose.translation,
                    axes: (!own).then(|| axes(r)),
                    half: part.half,
                    radius: part.half.length(),
                });
            }
        }
        let joined = |a: usize, b: usize| {
            let carried = |x: usize, y: usize| x > 0 && hinges[x - 1].parent == y;
            a == b || carried(a, b) || carried(b, a)
        };
        let mut pairs = Vec::new();
        for i in 0..boxes.len() {
            for j in i + 1..boxes.len() {
                if !joined(boxes[i].body, boxes[j].body) {
                    pairs.push((i, j));
                }
            }
        }
        Self {
            bodies,
            hinges,
            pairs,
            boxes,
            gravity: physics.gravity,
            friction: physics.friction,
            stiffness: physics.stiffness,
            damping: physics.damping,
            max_torque: physics.max_torque,
            limit: JOINT_LIMIT,
            dt: 1.0 / physics.steps_per_second as f32,
            iterations: physics.substeps,
            contact: Contact { stiffness: 2e4, damping: 200.0, slip: 2e-3, own_stiffness: 4e3, own_damping: 20.0 },
        }
    }
}

fn axes(r: Rotation) -> [Vector; 3] {
    [r * Vector::X, r * Vector::Y, r * Vector::Z]
}
