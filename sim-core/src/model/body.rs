//! Compilation of robots: rigidly joined parts become one body, module joints become hinges in a tree from the pivot.
//!
//! In the neutral configuration all body frames have the robot's orientation. The origin of the pivot's body is the
//! centre of the pivot part. The origin of any other body is the anchor of the hinge that carries it. So the pose of a
//! carried body is `parent · translate(anchor) · rotate(axis, angle)`, and the pose of body 0 is the robot's pose.

use super::assemble::Placed;
use super::kind::{HingeKind, ModuleKind, PartShape};
use super::prism::{self, CollisionPrism};
use super::{Face, ModuleSpec, RobotSpec};
use crate::base::error::Invalid;
use crate::base::math::{Pose, Rotation, Vector};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use rapier3d::parry::query;
use rapier3d::parry::shape::Cuboid;

/// Greatest gap between rigidly docked cubes that collide as one box, mu: the docking plates fill the gap.
const MERGE_GAP: f64 = 0.03;

/// Greatest allowed overlap of parts of different modules in the neutral configuration, mu.
pub(super) const OVERLAP_TOLERANCE: f64 = 1e-3;

/// Compiled robot.
#[derive(Clone, Debug)]
pub struct Robot {
    /// Name of the robot.
    pub name: String,
    /// Rigid bodies. Body 0 holds the pivot; a carried body comes after its carrier.
    pub bodies: Vec<Body>,
    /// Hinges. Hinge i carries body i + 1. Their order is the order of joints in genotypes and states.
    pub hinges: Vec<Hinge>,
    /// All parts as boxes in the neutral configuration, for pictures.
    pub parts: Vec<PartBox>,
    /// Modules in the order of the robot file; empty for a robot of bodies.
    pub modules: Vec<Module>,
    /// Docked faces of modules; empty for a robot of bodies.
    pub docks: Vec<[Face; 2]>,
}

/// Module of a compiled robot.
#[derive(Clone, Debug)]
pub struct Module {
    /// Name.
    pub name: String,
    /// Kind.
    pub kind: &'static ModuleKind,
    /// Joint of each hinge of the kind, by index; `None` for a stuck hinge.
    pub joints: Vec<Option<usize>>,
}

/// Rigid body: parts that never move relative to each other.
#[derive(Clone, Debug)]
pub struct Body {
    /// Name, unique in the robot: that of the hinge that carries the body; "pivot" for the pivot's body.
    pub name: String,
    /// Collision boxes, in the body's frame.
    pub boxes: Vec<CollisionBox>,
    /// Collision capsules, in the body's frame. An engine without capsules must refuse a robot that has any.
    pub capsules: Vec<CollisionCapsule>,
    /// Convex prisms, in the body's frame. An engine without prisms must refuse a robot that has any.
    pub prisms: Vec<CollisionPrism>,
    /// Mass, kg.
    pub mass: f32,
    /// Centre of mass in the body's frame, mu.
    pub center_of_mass: Vector,
    /// Inertia about the centre of mass in the body's axes, row by row, kg·mu².
    pub inertia: [[f32; 3]; 3],
}

/// Collision box in a body's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CollisionBox {
    /// Pose of its centre.
    pub pose: Pose,
    /// Half of its side lengths, mu.
    pub half: Vector,
}

/// Collision capsule in a body's frame: all points within a radius of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CollisionCapsule {
    /// Ends of the line, mu.
    pub ends: [Vector; 2],
    /// Radius, mu.
    pub radius: f32,
}

/// Joint between two bodies.
#[derive(Clone, Debug)]
pub struct Hinge {
    /// Name of the module, or `module.hinge` if the module has several hinges; the hinge's own name in a robot of
    /// bodies.
    pub name: String,
    /// Index of the carrying body.
    pub parent: usize,
    /// A point of the axis in the parent's frame. It is the carried body's origin.
    pub anchor: Vector,
    /// Unit axis, the same in both bodies' frames at angle 0.
    pub axis: Vector,
    /// Least and greatest angle, rad; 0 lies between them.
    pub limits: [f32; 2],
    /// Greatest rate of its target, rad/s. `None`: no limit beside the controller's.
    pub speed: Option<f32>,
    /// Greatest torque of its motor, kg·mu²/s². `None`: the job's `max_torque`.
    pub torque: Option<f32>,
}

impl Hinge {
    /// Returns the greatest torque of its motor, or the job's `max_torque` if the hinge has none of its own, kg·mu²/s².
    pub fn torque_or(&self, max_torque: f32) -> f32 {
        self.torque.unwrap_or(max_torque)
    }
}

/// Part in the neutral configuration, relative to the pivot.
#[derive(Clone, Debug)]
pub struct PartBox {
    /// Name of its module; of its body in a robot of bodies.
    pub module: String,
    /// True if the joints of the module are stuck.
    pub failed: bool,
    /// Centre, mu.
    pub center: [f64; 3],
    /// Unit quaternion x, y, z, w.
    pub rotation: [f64; 4],
    /// Half of its side lengths, mu.
    pub half: [f64; 3],
    /// Shape within the box.
    pub shape: PartShape,
    /// Index of its body.
    pub body: usize,
}

impl PartBox {
    /// Returns the corners (x, y) of the outline of a D-shaped part, which extends along z, counter-clockwise and
    /// relative to the centre, mu; `None` for other shapes.
    pub fn outline(&self) -> Option<Vec<[f64; 2]>> {
        prism::d_outline(self.shape, self.half[0])
    }
}

struct Part {
    module: usize,
    part: usize,
    shape: PartShape,
    rotation: Matrix3<f64>,
    center: Vector3<f64>,
    half: Vector3<f64>,
    mass: f64,
}

struct Joint {
    name: String,
    kind: &'static HingeKind,
    ends: [usize; 2],
    anchor: Vector3<f64>,
    axis: Vector3<f64>,
}

impl Robot {
    /// Compiles and validates a robot file.
    pub fn compile(spec: &RobotSpec) -> Result<Robot, Invalid> {
        if !spec.bodies.is_empty() {
            return super::rigid::compile(spec);
        }
        let placed = spec.assemble()?;
        let parts = parts_of(&placed);
        refuse_overlaps(spec, &parts)?;
        let index = |module: usize, part: usize| {
            parts.iter().position(|p| (p.module, p.part) == (module, part)).expect("every part must be in the list")
        };
        let (pivot_module, pivot_part) = spec.pivot_part()?;
        let pivot = index(pivot_module, pivot_part);

        let mut group: Vec<usize> = (0..parts.len()).collect();
        let mut join = |a: usize, b: usize| {
            let (from, to) = (group[a].max(group[b]), group[a].min(group[b]));
            group.iter_mut().filter(|g| **g == from).for_each(|g| *g = to);
        };
        let mut joints = Vec::new();
        for (module, p) in placed.iter().enumerate() {
            if let Some((own, (carrier, carrier_part))) = p.dock {
                join(index(module, own), index(carrier, carrier_part));
            }
            let own = &spec.modules[module].name;
            for hinge in p.kind.hinges {
                let ends = [index(module, hinge.from), index(module, hinge.to)];
                if spec.failed.contains(own) {
                    join(ends[0], ends[1]); // stuck at zero
                    continue;
                }
                let name = joint_name(p.kind, own, hinge);
                if joints.iter().any(|joint: &Joint| joint.name == name) {
                    return Err(Invalid::Duplicate {
                        field: format!("name of a joint of robot.module[{module}]"),
                        value: name,
                    });
                }
                let (anchor, axis) = (p.frame.point(hinge.anchor), p.frame.direction(hinge.axis));
                joints.push(Joint { name, kind: hinge, ends, anchor, axis });
            }
        }
        if joints.is_empty() {
            let reason = "a robot needs at least one joint that moves".to_owned();
            return Err(Invalid::Conflict { field: "robot.module".into(), reason });
        }
        let robot = build(spec, &parts, &group, &joints, pivot);
        let joint = |p: &Placed, module: &str, hinge: &HingeKind| {
            let name = joint_name(p.kind, module, hinge);
            robot.hinges.iter().position(|h| h.name == name)
        };
        let modules = placed.iter().zip(&spec.modules).map(|(p, ModuleSpec { name, .. })| {
            let stuck = spec.failed.contains(name);
            let joints = p.kind.hinges.iter().map(|hinge| joint(p, name, hinge).filter(|_| !stuck)).collect();
            Module { name: name.clone(), kind: p.kind, joints }
        });
        let modules = modules.collect();
        let docks = placed.iter().filter_map(|p| p.faces).collect();
        Ok(Robot { modules, docks, ..robot })
    }

    /// Returns the total mass, kg.
    pub fn mass(&self) -> f64 {
        self.bodies.iter().map(|b| f64::from(b.mass)).sum()
    }

    /// Returns the names of the joints, in their order in genotypes and states.
    pub fn joint_names(&self) -> Vec<String> {
        self.hinges.iter().map(|h| h.name.clone()).collect()
    }
}

impl Part {
    /// Returns the centre of mass in the neutral configuration, mu, and the inertia about it in the part's axes, kg·mu².
    fn center_and_inertia(&self) -> (Vector3<f64>, Matrix3<f64>) {
        let d = |ahead: f64| {
            let (offset, inertia) = prism::d_mass(self.half.x, self.half.z, self.mass, ahead);
            (self.center + self.rotation * offset, inertia)
        };
        match self.shape {
            PartShape::RoundAhead => d(1.0),
            PartShape::RoundBehind => d(-1.0),
            PartShape::Box | PartShape::None => {
                let side = self.half * 2.0;
                let square = side.component_mul(&side);
                let moments = Vector3::new(square.y + square.z, square.x + square.z, square.x + square.y);
                (self.center, Matrix3::from_diagonal(&moments) * (self.mass / 12.0))
            }
        }
    }
}

/// Returns the name of a module's joint: the module's own if it has one hinge.
fn joint_name(kind: &ModuleKind, module: &str, hinge: &HingeKind) -> String {
    match kind.hinges {
        [_] => module.to_owned(),
        _ => format!("{module}.{}", hinge.name),
    }
}

fn parts_of(placed: &[Placed]) -> Vec<Part> {
    let mut parts = Vec::new();
    for (module, p) in placed.iter().enumerate() {
        for (part, kind) in p.kind.parts.iter().enumerate() {
            parts.push(Part {
                module,
                part,
                shape: kind.shape,
                rotation: p.frame.rotation,
                center: p.frame.point(kind.center),
                half: Vector3::from(kind.half),
                mass: kind.mass,
            });
        }
    }
    parts
}

fn refuse_overlaps(spec: &RobotSpec, parts: &[Part]) -> Result<(), Invalid> {
    let shape = |p: &Part| (Pose::from_parts(vector(p.center), quaternion(p.rotation)), Cuboid::new(vector(p.half)));
    let solid: Vec<&Part> = parts.iter().filter(|part| part.shape != PartShape::None).collect();
    for (i, a) in solid.iter().enumerate() {
        for b in solid[..i].iter().filter(|b| b.module != a.module) {
            if (a.center - b.center).norm() > a.half.norm() + b.half.norm() {
                continue;
            }
            let ((pose_a, box_a), (pose_b, box_b)) = (shape(a), shape(b));
            let contact = query::contact(&pose_a, &box_a, &pose_b, &box_b, 0.0);
            let depth = contact.ok().flatten().map_or(0.0, |c| -f64::from(c.dist));
            if depth > OVERLAP_TOLERANCE {
                let named = |p: &Part| spec.modules[p.module].name.clone();
                return Err(Invalid::Overlap { first: named(b), second: named(a), depth });
            }
        }
    }
    Ok(())
}

fn build(spec: &RobotSpec, parts: &[Part], group: &[usize], joints: &[Joint], pivot: usize) -> Robot {
    let origin = parts[pivot].center;
    // Breadth first from the pivot, with joints in the order of their modules.
    let mut order = vec![group[pivot]];
    let mut origins = vec![origin];
    let mut hinges: Vec<Hinge> = Vec::new();
    let mut at = 0;
    while at < order.len() {
        for joint in joints {
            let [a, b] = joint.ends.map(|end| group[end]);
            let other = if a == order[at] {
                b
            } else if b == order[at] {
                a
            } else {
                continue;
            };
            if order.contains(&other) {
                continue;
            }
            // From the other end, the same motion is a turn in the opposite direction.
            let axis = if a == order[at] { joint.axis } else { -joint.axis };
            hinges.push(Hinge {
                name: joint.name.clone(),
                parent: at,
                anchor: vector(joint.anchor - origins[at]),
                axis: vector(axis),
                limits: joint.kind.limits,
                speed: joint.kind.speed,
                torque: joint.kind.torque,
            });
            order.push(other);
            origins.push(joint.anchor);
        }
        at += 1;
    }
    let names = std::iter::once(pivot_name(&hinges)).chain(hinges.iter().map(|h| h.name.clone()));
    let bodies = order
        .iter()
        .zip(&origins)
        .zip(names)
        .map(|((&g, origin), name)| {
            let own: Vec<&Part> = parts.iter().zip(group).filter(|(_, pg)| **pg == g).map(|(p, _)| p).collect();
            body(name, &own, origin)
        })
        .collect();
    let parts = parts.iter().zip(group).map(|(p, g)| {
        let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(p.rotation));
        PartBox {
            module: spec.modules[p.module].name.clone(),
            failed: spec.failed.contains(&spec.modules[p.module].name),
            center: (p.center - origin).into(),
            rotation: [q.i, q.j, q.k, q.w],
            half: p.half.into(),
            shape: p.shape,
            body: order.iter().position(|o| o == g).expect("every group must be reached from the pivot"),
        }
    });
    Robot { name: spec.name.clone(), bodies, hinges, parts: parts.collect(), modules: Vec::new(), docks: Vec::new() }
}

/// Returns a name for the pivot's body that no hinge has.
fn pivot_name(hinges: &[Hinge]) -> String {
    let mut name = "pivot".to_owned();
    while hinges.iter().any(|h| h.name == name) {
        name.push('0');
    }
    name
}

fn body(name: String, parts: &[&Part], origin: &Vector3<f64>) -> Body {
    let mass: f64 = parts.iter().map(|p| p.mass).sum();
    let lumps: Vec<_> = parts.iter().map(|p| (p, p.center_and_inertia())).collect();
    let center = lumps.iter().map(|(p, (at, _))| (at - origin) * p.mass).sum::<Vector3<f64>>() / mass;
    let mut inertia = Matrix3::zeros();
    for (p, (at, own)) in lumps {
        let arm = at - origin - center;
        inertia += p.rotation * own * p.rotation.transpose();
        inertia += (Matrix3::identity() * arm.norm_squared() - arm * arm.transpose()) * p.mass;
    }
    let boxes = merged(parts)
        .into_iter()
        .map(|(rotation, center, half)| CollisionBox {
            pose: Pose::from_parts(vector(center - origin), quaternion(rotation)),
            half: vector(half),
        })
        .collect();
    let prisms = parts.iter().filter_map(|p| {
        let outline = prism::d_outline(p.shape, p.half.x)?;
        let pose = Pose::from_parts(vector(p.center - origin), quaternion(p.rotation));
        Some(CollisionPrism::new(&outline, p.half.z, &pose))
    });
    let row = |i: usize| [inertia[(i, 0)] as f32, inertia[(i, 1)] as f32, inertia[(i, 2)] as f32];
    Body {
        name,
        boxes,
        capsules: Vec::new(),
        prisms: prisms.collect(),
        mass: mass as f32,
        center_of_mass: vector(center),
        inertia: [row(0), row(1), row(2)],
    }
}

type Cell = (Matrix3<f64>, Vector3<f64>, Vector3<f64>);

/// Merges boxes that continue each other along one axis, as often as possible.
fn merged(parts: &[&Part]) -> Vec<Cell> {
    // A box that is turned by quarter turns can be written in another box's axes. Docked modules need this.
    let solid = parts.iter().filter(|p| p.shape == PartShape::Box);
    let mut boxes: Vec<Cell> = solid.map(|p| (p.rotation, p.center, p.half)).collect();
    let mut i = 0;
    while i < boxes.len() {
        match (0..boxes.len()).find_map(|j| (j != i).then(|| union(&boxes[i], &boxes[j]).map(|u| (j, u))).flatten()) {
            Some((j, union)) => {
                boxes[i] = union;
                boxes.remove(j);
                i = 0;
            }
            None => i += 1,
        }
    }
    boxes
}

/// Returns the box that two boxes form together, if they have the same cross-section and follow each other.
fn union(a: &Cell, b: &Cell) -> Option<Cell> {
    let relative = a.0.transpose() * b.0;
    if relative.iter().any(|v| v.abs() > 1e-9 && (v.abs() - 1.0).abs() > 1e-9) {
        return None; // not a quarter turn
    }
    let half_b = relative.abs() * b.2;
    let offset = a.0.transpose() * (b.1 - a.1);
    let axis = offset.iamax();
    let aligned = (0..3).all(|i| i == axis || (offset[i].abs() < 1e-9 && (a.2[i] - half_b[i]).abs() < 1e-9));
    let gap = offset[axis].abs() - a.2[axis] - half_b[axis];
    if !aligned || !(-1e-9..=MERGE_GAP).contains(&gap) {
        return None;
    }
    let low = (-a.2[axis]).min(offset[axis] - half_b[axis]);
    let high = a.2[axis].max(offset[axis] + half_b[axis]);
    let mut half = a.2;
    half[axis] = (high - low) / 2.0;
    let mut shift = Vector3::zeros();
    shift[axis] = (high + low) / 2.0;
    Some((a.0, a.1 + a.0 * shift, half))
}

pub(super) fn vector(v: Vector3<f64>) -> Vector {
    Vector::new(v.x as f32, v.y as f32, v.z as f32)
}

fn quaternion(m: Matrix3<f64>) -> Rotation {
    let q = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(m));
    Rotation::from_xyzw(q.i as f32, q.j as f32, q.k as f32, q.w as f32)
}
