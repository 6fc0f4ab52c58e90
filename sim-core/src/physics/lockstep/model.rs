//! Model of a robot in the engine: a tree of hinges, every body about its own origin.

use crate::base::math::{Rotation, Vector};
use crate::model::Robot;
use crate::physics::Physics;

/// Constants of a robot and its physics, the same in all lanes.
pub(super) struct Model {
    /// Body 0 is the base; hinge i carries body i + 1.
    pub bodies: Vec<Link>,
    pub hinges: Vec<Joint>,
    /// Pairs of boxes that may touch each other: all but those of bodies that share a joint.
    pub pairs: Vec<(usize, usize)>,
    pub boxes: Vec<Part>,
    /// Mass of the whole robot, kg.
    pub mass: f32,
    /// Gravity, mu/s².
    pub gravity: Vector,
    pub friction: f32,
    pub stiffness: f32,
    pub damping: f32,
    /// Length of a step, s.
    pub dt: f32,
    /// Number of linearisations of contacts and motors in a step.
    pub iterations: u32,
    pub contact: Contact,
}

/// Compliance of contacts: a spring and a damper for each corner. They follow from the robot's weight, so robots of any
/// mass under any gravity sink in equally.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contact {
    /// Stiffness k, kg/s².
    pub stiffness: f32,
    /// Damper r, kg/s; see `contact`.
    pub resistance: f32,
    /// Speed v_s at which friction reaches 1/√2 of its full force, mu/s.
    pub slip: f32,
    /// Stiffness between two bodies of the robot, kg/s²; explicit, so the step bounds it.
    pub own_stiffness: f32,
    /// Damper between two bodies of the robot, kg/s.
    pub own_damping: f32,
}

impl Contact {
    /// Depth to which the whole weight presses a single corner, mu.
    const SINK: f32 = 0.004;
    /// Damper of a corner, as a share of √(k m).
    const DAMPING: f32 = 0.5;
    /// v_s as a share of √(g · SINK), a speed of 0.2 mu/s under 9.81 mu/s².
    const SLIP: f32 = 0.01;
    /// Spring and damper between bodies, as shares of those of the ground.
    const OWN: (f32, f32) = (0.2, 0.1);
    /// Least gravity that contacts are computed for, also of weightless robots, mu/s².
    const LEAST_GRAVITY: f32 = 0.1;

    fn new(mass: f32, gravity: f32, dt: f32) -> Self {
        let gravity = gravity.max(Self::LEAST_GRAVITY);
        let stiffness = mass * gravity / Self::SINK;
        let damping = Self::DAMPING * (stiffness * mass).sqrt();
        Self {
            stiffness,
            resistance: damping.max(stiffness * dt),
            slip: Self::SLIP * (gravity * Self::SINK).sqrt(),
            own_stiffness: Self::OWN.0 * stiffness,
            own_damping: Self::OWN.1 * damping,
        }
    }
}

pub(super) struct Link {
    pub mass: f32,
    pub center: Vector,
    /// Inertia about the centre of mass: xx, yy, zz, xy, xz, yz.
    pub inertia: [f32; 6],
    /// True if the last three numbers of the inertia are zero.
    pub diagonal: bool,
}

pub(super) struct Joint {
    pub parent: usize,
    /// Hinge that carries the parent; `None` if the parent is the base.
    pub carrier: Option<usize>,
    pub anchor: Vector,
    pub axis: Vector,
    /// Least and greatest angle, rad.
    pub limits: [f32; 2],
    /// Greatest torque of the motor, kg·mu²/s².
    pub max_torque: f32,
}

/// Box of a body.
pub(super) struct Part {
    pub body: usize,
    pub center: Vector,
    /// Axes of the box in the body's frame; `None` if they are the body's own.
    pub axes: Option<[Vector; 3]>,
    pub half: Vector,
    /// Radius of the sphere around the box, mu.
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
            .map(|h| Joint {
                parent: h.parent,
                carrier: h.parent.checked_sub(1),
                anchor: h.anchor,
                axis: h.axis,
                limits: h.limits,
                max_torque: h.torque_or(physics.max_torque),
            })
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
        let (mass, dt) = (bodies.iter().map(|b| b.mass).sum::<f32>(), 1.0 / physics.steps_per_second as f32);
        Self {
            bodies,
            hinges,
            pairs,
            boxes,
            mass,
            gravity: Vector::new(0.0, 0.0, -physics.gravity),
            friction: physics.friction,
            stiffness: physics.stiffness,
            damping: physics.damping,
            dt,
            iterations: physics.substeps,
            contact: Contact::new(mass, physics.gravity, dt),
        }
    }

    /// Returns the weight of the whole robot, kg·mu/s², under [`Contact::LEAST_GRAVITY`] at least.
    pub fn weight(&self) -> f32 {
        self.mass * self.gravity.length().max(Contact::LEAST_GRAVITY)
    }
}

fn axes(r: Rotation) -> [Vector; 3] {
    [r * Vector::X, r * Vector::Y, r * Vector::Z]
}
