//! Compilation of robots that are written out body by body: the second form of the robot file, which imports use.

use super::body::{OVERLAP_TOLERANCE, vector};
use super::kind::{PartShape, QUARTER_TURNS};
use super::{Body, BodySpec, CollisionBox, CollisionCapsule, Hinge, PartBox, Robot, RobotSpec};
use crate::base::error::{Invalid, in_range, name, whole_in_range};
use crate::base::limits;
use crate::base::math::{Pose, Rotation};
use nalgebra::{Matrix3, Vector3};
use rapier3d::parry::query;
use rapier3d::parry::shape::{Capsule, Cuboid, Shape};

/// Range of coordinates relative to a body's origin, mu.
const REACH: (f64, f64) = (-1000.0, 1000.0);
/// Range of half side lengths, radii and capsule lengths, mu.
const SIZE: (f64, f64) = (1e-3, 1000.0);
/// Greatest limit of a joint to either side, rad. Within half a turn, the poses of the bodies determine the angle.
const FARTHEST: f64 = 3.0;
/// Range of a hinge's speed, rad/s.
const SPEED: (f64, f64) = (1e-3, 1e4);
/// Range of a hinge's torque, kg·mu²/s², the same as for `physics.max_torque`.
const TORQUE: (f64, f64) = (0.0, 1e7);
/// Range of a mass, kg.
const MASS: (f64, f64) = (1e-6, 1e6);

/// Mass (kg), its centre (mu), and the inertia about that centre (kg·mu²), all in the same axes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lump {
    pub mass: f64,
    pub center: Vector3<f64>,
    pub inertia: Matrix3<f64>,
}

impl Lump {
    /// Joins lumps that never move relative to each other; `None` if they have no mass.
    pub fn joined(lumps: &[Lump]) -> Option<Lump> {
        if let [one] = lumps {
            return (one.mass > 0.0).then_some(*one); // keeps its bits
        }
        let mass: f64 = lumps.iter().map(|l| l.mass).sum();
        let center = lumps.iter().map(|l| l.center * l.mass).sum::<Vector3<f64>>() / mass;
        let inertia = |l: &Lump| {
            let arm = l.center - center;
            l.inertia + (Matrix3::identity() * arm.norm_squared() - arm * arm.transpose()) * l.mass
        };
        (mass > 0.0).then(|| Lump { mass, center, inertia: lumps.iter().map(inertia).sum() })
    }

    /// Returns the lump relative to a frame with its origin at `-by`.
    pub fn shifted(self, by: Vector3<f64>) -> Lump {
        Lump { center: self.center + by, ..self }
    }
}

/// Returns the symmetric matrix of xx, yy, zz, xy, xz, yz.
pub(crate) fn symmetric([xx, yy, zz, xy, xz, yz]: [f64; 6]) -> Matrix3<f64> {
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

pub(super) fn compile(spec: &RobotSpec) -> Result<Robot, Invalid> {
    check(spec)?;
    let parents = parents(spec)?;
    let root = root(spec)?;
    let stuck = |i: usize| spec.bodies[i].hinge.as_ref().is_some_and(|h| spec.failed.contains(&h.name));

    // Breadth first from the pivot, bodies in the order of the file, as with modules. A member of a compiled body is a
    // body of the file and the place of its origin in the compiled body's frame.
    let mut groups = vec![vec![(root, Vector3::zeros())]];
    let mut origins = vec![Vector3::zeros()];
    let mut hinges: Vec<Hinge> = Vec::new();
    let mut at = 0;
    while at < groups.len() {
        let carried_by = |members: &[(usize, Vector3<f64>)], want_stuck: bool| {
            let hinge = |i: usize| spec.bodies[i].hinge.as_ref();
            let found = (0..spec.bodies.len()).filter(|&i| stuck(i) == want_stuck).filter_map(|i| {
                let (_, offset) = members.iter().find(|m| parents[i] == Some(m.0))?;
                Some((i, offset + Vector3::from(hinge(i)?.anchor)))
            });
            found.collect::<Vec<_>>()
        };
        let mut newest = groups[at].clone();
        while !newest.is_empty() {
            newest = carried_by(&newest, true);
            groups[at].extend(&newest);
        }
        for (i, anchor) in carried_by(&groups[at], false) {
            let Some(hinge) = &spec.bodies[i].hinge else { continue };
            let axis = vector(unit(hinge.axis));
            hinges.push(Hinge {
                name: hinge.name.clone(),
                parent: at,
                anchor: vector(anchor),
                axis,
                limits: hinge.limits.map_or(QUARTER_TURNS, |limits| limits.map(|angle| angle as f32)),
                speed: hinge.speed.map(|speed| speed as f32),
                torque: hinge.torque.map(|torque| torque as f32),
            });
            groups.push(vec![(i, Vector3::zeros())]);
            origins.push(origins[at] + anchor);
        }
        at += 1;
    }
    if let Some(i) = (0..spec.bodies.len()).find(|i| groups.iter().flatten().all(|member| member.0 != *i)) {
        let reason = format!(
            "the parents of body \"{}\" do not lead to the pivot: hinges must form a tree",
            spec.bodies[i].name
        );
        return Err(Invalid::Conflict { field: format!("robot.body[{i}].hinge.parent"), reason });
    }
    if hinges.is_empty() {
        let reason = "a robot needs at least one joint that moves".to_owned();
        return Err(Invalid::Conflict { field: "robot.body".into(), reason });
    }
    let bodies = groups.iter().map(|members| body(spec, members)).collect();
    let parts = groups.iter().zip(&origins).enumerate().flat_map(|(body, (members, origin))| {
        members
            .iter()
            .flat_map(move |&(i, offset)| drawn(&spec.bodies[i], body, origin + offset, stuck(i)).collect::<Vec<_>>())
    });
    let robot = Robot {
        name: spec.name.clone(),
        bodies,
        parts: parts.collect(),
        hinges,
        modules: Vec::new(),
        docks: Vec::new(),
    };
    refuse_overlaps(&robot)?;
    Ok(robot)
}

fn check(spec: &RobotSpec) -> Result<(), Invalid> {
    whole_in_range("number of robot.body", spec.bodies.len() as u64, (1, limits::MAX_BODIES as u64), "")?;
    let mut faults = Vec::new();
    let mut take = |checked: Result<(), Invalid>| faults.extend(checked.err());
    take(name("robot.name", &spec.name));
    let length = spec.description.len() as u64;
    take(whole_in_range("robot.description length", length, (0, limits::MAX_DESCRIPTION_LENGTH as u64), "bytes"));
    if !spec.modules.is_empty() {
        let reason = "a robot consists of modules or of bodies, not of both: remove one kind".to_owned();
        take(Err(Invalid::Conflict { field: "robot.body".into(), reason }));
    }
    let shapes: usize = spec.bodies.iter().map(|b| b.boxes.len() + b.capsules.len()).sum();
    take(whole_in_range("number of robot.body.box and .capsule", shapes as u64, (1, limits::MAX_SHAPES as u64), ""));
    let hinges: Vec<&str> = spec.bodies.iter().filter_map(|b| Some(b.hinge.as_ref()?.name.as_str())).collect();
    for (i, body) in spec.bodies.iter().enumerate() {
        let field = |rest: &str| format!("robot.body[{i}].{rest}");
        take(name(field("name"), &body.name));
        if spec.bodies[..i].iter().any(|b| b.name == body.name) {
            take(Err(Invalid::Duplicate { field: field("name"), value: body.name.clone() }));
        }
        if let Some(hinge) = &body.hinge {
            take(name(field("hinge.name"), &hinge.name));
            if spec.bodies[..i].iter().any(|b| b.hinge.as_ref().is_some_and(|h| h.name == hinge.name)) {
                take(Err(Invalid::Duplicate { field: field("hinge.name"), value: hinge.name.clone() }));
            }
        }
        numbers(body, &field, &mut take);
    }
    let variants = spec.variants.iter().map(|(v, failed)| (format!("robot.variants.{v}"), failed));
    for (field, failed) in variants.chain([("robot.failed".to_owned(), &spec.failed)]) {
        if let Some(unknown) = failed.iter().find(|f| !hinges.contains(&f.as_str())) {
            let known = hinges.iter().map(|h| (*h).to_owned()).collect();
            take(Err(Invalid::Unknown { field, value: unknown.clone(), known }));
        }
    }
    spec.variants.keys().for_each(|variant| take(name("robot.variants", variant)));
    Invalid::all(faults)
}

/// Checks all numbers of a body. `field` returns the path of a number.
fn numbers(body: &BodySpec, field: &impl Fn(&str) -> String, take: &mut impl FnMut(Result<(), Invalid>)) {
    let point = |take: &mut dyn FnMut(Result<(), Invalid>), what: &str, point: &[f64; 3], range: (f64, f64)| {
        (0..3).for_each(|axis| take(in_range(field(&format!("{what}[{axis}]")), point[axis], range, "mu")));
    };
    let conflict = |what: &str, reason: &str| Invalid::Conflict { field: field(what), reason: reason.to_owned() };
    take(in_range(field("mass"), body.mass, MASS, "kg"));
    point(take, "center_of_mass", &body.center_of_mass, REACH);
    let moment =
        |(i, moment): (usize, &f64)| in_range(field(&format!("inertia[{i}]")), *moment, (-1e12, 1e12), "kg·mu²");
    let wrong: Vec<Invalid> = body.inertia.iter().enumerate().filter_map(|m| moment(m).err()).collect();
    // Second moments of the mass, ∫ r rᵀ dm. Their diagonal can't be negative in any axes.
    let inertia = symmetric(body.inertia);
    let trace = inertia.trace();
    let spread = Matrix3::identity() * (trace * (0.5 + 1e-6)) - inertia;
    if wrong.is_empty() && (!positive(inertia - Matrix3::identity() * (trace * 1e-9)) || !positive(spread)) {
        let reason = "invalid inertia: it must be positive definite, and no principal moment may exceed the sum of the \
                      two others";
        take(Err(conflict("inertia", reason)));
    }
    wrong.into_iter().for_each(|fault| take(Err(fault)));
    if let Some(hinge) = &body.hinge {
        point(take, "hinge.anchor", &hinge.anchor, REACH);
        point(take, "hinge.axis", &hinge.axis, REACH);
        if Vector3::from(hinge.axis).norm() < 1e-6 {
            take(Err(conflict("hinge.axis", "the axis has no direction: its length must not be 0")));
        }
        if let Some([low, high]) = hinge.limits {
            take(in_range(field("hinge.limits[0]"), low, (-FARTHEST, 0.0), "rad"));
            take(in_range(field("hinge.limits[1]"), high, (0.0, FARTHEST), "rad"));
            if low == high {
                let reason = "a joint that moves needs two different limits: list the hinge in `failed` if it is stuck";
                take(Err(conflict("hinge.limits", reason)));
            }
        }
        if let Some(speed) = hinge.speed {
            take(in_range(field("hinge.speed"), speed, SPEED, "rad/s"));
        }
        if let Some(torque) = hinge.torque {
            take(in_range(field("hinge.torque"), torque, TORQUE, "kg·mu²/s²"));
        }
    }
    for (i, part) in body.boxes.iter().enumerate() {
        point(take, &format!("box[{i}].center"), &part.center, REACH);
        point(take, &format!("box[{i}].half"), &part.half, SIZE);
        let length = part.rotation.iter().map(|v| v * v).sum::<f64>().sqrt();
        take(in_range(field(&format!("box[{i}].rotation length")), length, (0.999, 1.001), ""));
    }
    for (i, part) in body.capsules.iter().enumerate() {
        point(take, &format!("capsule[{i}].from"), &part.from, REACH);
        point(take, &format!("capsule[{i}].to"), &part.to, REACH);
        take(in_range(field(&format!("capsule[{i}].radius")), part.radius, SIZE, "mu"));
        let length = (Vector3::from(part.to) - Vector3::from(part.from)).norm();
        take(in_range(field(&format!("capsule[{i}] length")), length, SIZE, "mu"));
    }
}

/// Returns true if a symmetric matrix is positive definite, by Sylvester's criterion.
fn positive(m: Matrix3<f64>) -> bool {
    m[(0, 0)] > 0.0 && m.fixed_view::<2, 2>(0, 0).determinant() > 0.0 && m.determinant() > 0.0
}

/// Returns for each body the index of the body that carries it.
fn parents(spec: &RobotSpec) -> Result<Vec<Option<usize>>, Invalid> {
    let parent = |(i, body): (usize, &BodySpec)| {
        let Some(hinge) = &body.hinge else { return Ok(None) };
        let found = spec.bodies.iter().position(|b| b.name == hinge.parent);
        found.map(Some).ok_or_else(|| Invalid::Unknown {
            field: format!("robot.body[{i}].hinge.parent"),
            value: hinge.parent.clone(),
            known: spec.bodies.iter().map(|b| b.name.clone()).collect(),
        })
    };
    spec.bodies.iter().enumerate().map(parent).collect()
}

/// Returns the pivot's body, which must be the only one without a hinge.
fn root(spec: &RobotSpec) -> Result<usize, Invalid> {
    let free: Vec<usize> = (0..spec.bodies.len()).filter(|&i| spec.bodies[i].hinge.is_none()).collect();
    let names = || free.iter().map(|&i| spec.bodies[i].name.clone()).collect::<Vec<_>>();
    match free[..] {
        [root] if spec.bodies[root].name == spec.pivot => Ok(root),
        [_] => Err(Invalid::Unknown { field: "robot.pivot".into(), value: spec.pivot.clone(), known: names() }),
        _ => {
            let reason = format!(
                "exactly one body, the pivot's, must have no hinge; here {} have none ({})",
                free.len(),
                names().join(", ")
            );
            Err(Invalid::Conflict { field: "robot.body".into(), reason })
        }
    }
}

/// Normalises an axis. An axis of unit length to f32 precision keeps its bits.
fn unit(axis: [f64; 3]) -> Vector3<f64> {
    let axis = Vector3::from(axis);
    let length = axis.norm();
    if (length - 1.0).abs() < 1e-6 { axis } else { axis / length }
}

fn body(spec: &RobotSpec, members: &[(usize, Vector3<f64>)]) -> Body {
    let lump = |&(i, offset): &(usize, Vector3<f64>)| {
        let body = &spec.bodies[i];
        let (center, inertia) = (Vector3::from(body.center_of_mass), symmetric(body.inertia));
        Lump { mass: body.mass, center, inertia }.shifted(offset)
    };
    let lump = Lump::joined(&members.iter().map(lump).collect::<Vec<_>>())
        .expect("the mass of every body must be checked before");
    let row = |i: usize| [0, 1, 2].map(|j| lump.inertia[(i, j)] as f32);
    let at = |offset: Vector3<f64>, point: [f64; 3]| vector(offset + Vector3::from(point));
    let (mut boxes, mut capsules) = (Vec::new(), Vec::new());
    for &(i, offset) in members {
        boxes.extend(spec.bodies[i].boxes.iter().map(|part| CollisionBox {
            pose: Pose::from_parts(at(offset, part.center), Rotation::from_array(part.rotation.map(|v| v as f32))),
            half: vector(Vector3::from(part.half)),
        }));
        capsules.extend(spec.bodies[i].capsules.iter().map(|part| CollisionCapsule {
            ends: [at(offset, part.from), at(offset, part.to)],
            radius: part.radius as f32,
        }));
    }
    Body {
        name: spec.bodies[members[0].0].name.clone(),
        boxes,
        capsules,
        prisms: Vec::new(),
        mass: lump.mass as f32,
        center_of_mass: vector(lump.center),
        inertia: [row(0), row(1), row(2)],
    }
}

/// Returns the shapes of a body for pictures. A capsule is drawn as the box around it.
fn drawn(spec: &BodySpec, body: usize, origin: Vector3<f64>, failed: bool) -> impl Iterator<Item = PartBox> {
    let part = move |center: Vector3<f64>, rotation, half| PartBox {
        shape: PartShape::Box,
        module: spec.name.clone(),
        failed,
        center: (origin + center).into(),
        rotation,
        half,
        body,
    };
    let capsule = |c: &super::CapsuleSpec| {
        let (from, to) = (Vector3::from(c.from), Vector3::from(c.to));
        let along = (to - from).normalize();
        // Quaternion of the turn from z to `along`: (1 + z · along, z × along), normalised. z and −z look the same.
        let along = if along.z < 0.0 { -along } else { along };
        let length = (2.0 + 2.0 * along.z).sqrt();
        let rotation = [-along.y / length, along.x / length, 0.0, (1.0 + along.z) / length];
        ((from + to) / 2.0, rotation, [c.radius, c.radius, (to - from).norm() / 2.0 + c.radius])
    };
    let boxes = spec.boxes.iter().map(|b| (Vector3::from(b.center), b.rotation, b.half));
    boxes.chain(spec.capsules.iter().map(capsule)).map(move |(center, rotation, half)| part(center, rotation, half))
}

/// Refuses overlapping bodies that share no hinge: the engine would push them apart violently.
fn refuse_overlaps(robot: &Robot) -> Result<(), Invalid> {
    let still = robot.body_poses(&super::State::new(Pose::identity(), vec![0.0; robot.hinges.len()]));
    let solids = |i: usize| -> Vec<(Pose, Box<dyn Shape>)> {
        let boxes = robot.bodies[i].boxes.iter().map(|b| (still[i] * b.pose, Box::new(Cuboid::new(b.half)) as _));
        let capsules = robot.bodies[i].capsules.iter().map(|c| {
            let [a, b] = c.ends;
            (still[i], Box::new(Capsule::new(a, b, c.radius)) as _)
        });
        boxes.chain(capsules).collect()
    };
    let all: Vec<_> = (0..robot.bodies.len()).map(solids).collect();
    for i in 0..all.len() {
        for j in 0..i {
            if robot.hinges[i - 1].parent == j {
                continue;
            }
            for ((pose_i, solid_i), (pose_j, solid_j)) in all[i].iter().flat_map(|a| all[j].iter().map(move |b| (a, b)))
            {
                let contact = query::contact(pose_i, &**solid_i, pose_j, &**solid_j, 0.0);
                let depth = contact.ok().flatten().map_or(0.0, |c| -f64::from(c.dist));
                if depth > OVERLAP_TOLERANCE {
                    let reason = format!(
                        "bodies \"{}\" and \"{}\" share no hinge and overlap in the neutral configuration (by \
                         {depth:.3} mu): make their shapes smaller",
                        robot.bodies[j].name, robot.bodies[i].name
                    );
                    return Err(Invalid::Conflict { field: "robot.body".into(), reason });
                }
            }
        }
    }
    Ok(())
}
