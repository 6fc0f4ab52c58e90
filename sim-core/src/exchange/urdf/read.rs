//! Reader from URDF to robot files.

use super::schema::ROBOT;
use crate::base::error::{Faults, Invalid};
use crate::base::limits::MAX_LINKS;
use crate::exchange::schema::{self, Passed};
use crate::exchange::source::{child, children, exactly, foreign, quarter_turns, required, tag, turn, zero};
use crate::exchange::tree::{Frame, Link, Solid, Turning, grow};
use crate::exchange::{Import, finish, names};
use crate::model::rigid::{Lump, symmetric};
use nalgebra::Vector3;
use roxmltree::Node;

/// Reads a robot from the `<robot>` element.
pub(in crate::exchange) fn read<'a>(robot: Node<'a, 'a>, unit: f64) -> Result<Import, Invalid> {
    let (mut faults, mut passed) = (Faults::default(), Passed::default());
    schema::check(robot, &ROBOT, &mut faults, &mut passed);
    let of = |wanted: &str| children(robot).filter(|e| tag(*e) == wanted).collect::<Vec<_>>();
    let (links, joints) = (of("link"), of("joint"));
    for (what, elements) in [("links", &links), ("joints", &joints)] {
        if let Some(first) = elements.get(MAX_LINKS) {
            return Err(foreign(*first, format!("there are too many {what}: at most {MAX_LINKS} are allowed")));
        }
    }
    for element in links.iter().chain(&joints) {
        faults.take(required(*element, "name"));
    }
    let order = order(robot, &links, &joints, &mut faults);
    let found: Vec<Link> = order
        .into_iter()
        .map(|(element, carried)| {
            let mut link = Link::new(element);
            if let Some((parent, joint)) = carried {
                link.parent = Some(parent);
                link.frame = faults.take(origin(joint)).unwrap_or(Frame::none());
                link.hinge = hinge(joint, &mut faults);
            }
            let parts = |wanted: &'static str| children(element).filter(move |e| tag(*e) == wanted);
            for inertial in parts("inertial") {
                let read = faults.take(lump(inertial));
                link.incomplete |= read.is_none();
                link.lumps.extend(read);
            }
            link.solids.extend(parts("collision").filter_map(|part| faults.take(solid(part)).flatten()));
            link
        })
        .collect();
    if faults.is_empty() && found.iter().all(|link| link.solids.is_empty()) {
        let reason = "no link has a <collision> with a <box> or <capsule>: shapes in <visual> do not collide";
        faults.add(foreign(robot, reason));
    }
    let names = names::adopt(robot.attribute("name"), &found, &mut faults);
    let tree = grow(&names, "URDF", &found, &mut faults);
    finish(tree, unit, faults, [passed.note(), names.note].into_iter().flatten())
}

/// Element of a link, with the index of its carrier in the same list and the joint between them.
type Ordered<'a> = (Node<'a, 'a>, Option<(usize, Node<'a, 'a>)>);

/// Returns all links breadth first from the root, with joints in the order of the file.
fn order<'a>(
    robot: Node<'a, 'a>,
    links: &[Node<'a, 'a>],
    joints: &[Node<'a, 'a>],
    faults: &mut Faults,
) -> Vec<Ordered<'a>> {
    let names: Vec<&str> = links.iter().map(|link| link.attribute("name").unwrap_or_default()).collect();
    for (i, link) in links.iter().enumerate() {
        if let Some(first) = names[..i].iter().position(|name| !name.is_empty() && *name == names[i]) {
            let line = links[first].document().text_pos_at(links[first].range().start).row;
            faults.add(foreign(
                *link,
                format!("the name \"{}\" is used twice, first in line {line}: names must be unique", names[i]),
            ));
        }
    }
    // Joints with both ends found: (parent, child, joint).
    let mut ends: Vec<(usize, usize, Node)> = Vec::new();
    for joint in joints {
        let end = |which: &str| {
            let link = child(*joint, which).and_then(|e| e.attribute("link")).unwrap_or_default();
            names.iter().position(|n| *n == link).ok_or_else(|| {
                foreign(
                    *joint,
                    format!("its {which} link is \"{link}\", which does not exist: the links are {}", names.join(", ")),
                )
            })
        };
        let (Some(parent), Some(child)) = (faults.take(end("parent")), faults.take(end("child"))) else { continue };
        if ends.iter().any(|(_, other, _)| *other == child) {
            let reason = format!("link \"{}\" is the child of two joints: only trees can be imported", names[child]);
            faults.add(foreign(*joint, reason));
            continue;
        }
        ends.push((parent, child, *joint));
    }
    let free: Vec<usize> = (0..links.len()).filter(|l| ends.iter().all(|(_, child, _)| child != l)).collect();
    if free.len() != 1 && faults.is_empty() {
        let told: Vec<&str> = free.iter().map(|f| names[*f]).collect();
        let told = if told.is_empty() { "none: the joints form a loop".to_owned() } else { told.join(", ") };
        faults
            .add(foreign(robot, format!("exactly one link must be the root, which is no joint's child; found {told}")));
    }
    // All links except those on a loop are read, so that all faults are found.
    let mut order: Vec<usize> = free.clone();
    let mut found: Vec<Ordered> = free.iter().map(|&root| (links[root], None)).collect();
    let mut at = 0;
    while at < order.len() {
        let carrier = order[at];
        for &(_, child, joint) in ends.iter().filter(|(parent, ..)| *parent == carrier) {
            found.push((links[child], Some((at, joint))));
            order.push(child);
        }
        at += 1;
    }
    if let Some(lost) = (0..links.len()).find(|l| !order.contains(l)).filter(|_| faults.is_empty()) {
        faults.add(foreign(links[lost], "it is on a loop of joints, or carried by one: only trees can be imported"));
    }
    found
}

/// Reads the hinge of a joint; `None` for a fixed joint.
fn hinge<'a>(joint: Node<'a, 'a>, faults: &mut Faults) -> Option<Turning<'a>> {
    match joint.attribute("type") {
        Some("fixed") => return None,
        Some("revolute") => {}
        other => {
            let reason = format!("type = \"{}\": only revolute and fixed are allowed", other.unwrap_or_default());
            faults.add(foreign(joint, reason));
        }
    }
    if let Some(dynamics) = child(joint, "dynamics") {
        for attribute in ["damping", "friction"] {
            let why = "joints have no passive forces, only the motors of a job";
            faults.take(zero(dynamics, attribute, dynamics.attribute(attribute), why));
        }
    }
    if joint.attribute("type") == Some("revolute") {
        faults.take(limits(joint));
    }
    let axis = match child(joint, "axis") {
        Some(axis) => required(axis, "xyz").and_then(|text| exactly(axis, "xyz", text)),
        None => Ok([1.0, 0.0, 0.0]),
    };
    let axis = Vector3::from(faults.take(axis)?);
    let name = joint.attribute("name").map(str::to_owned);
    Some(Turning { element: joint, name, anchor: Vector3::zeros(), axis })
}

fn limits(joint: Node) -> Result<(), Invalid> {
    let Some(limit) = child(joint, "limit") else { return quarter_turns(joint, None) };
    let end = |which| exactly::<1>(limit, which, limit.attribute(which).unwrap_or("0")).map(|[v]| v);
    quarter_turns(joint, Some([end("lower")?, end("upper")?]))
}

/// Reads the `<origin>` of an element: xyz, and rotations about the fixed x, y and z axes.
fn origin(of: Node) -> Result<Frame, Invalid> {
    let Some(origin) = child(of, "origin") else { return Ok(Frame::none()) };
    let triple = |attribute| exactly::<3>(origin, attribute, origin.attribute(attribute).unwrap_or("0 0 0"));
    let [roll, pitch, yaw] = triple("rpy")?;
    let about = |axis, angle| turn(origin, axis, angle);
    let rotation = about([0.0, 0.0, 1.0], yaw)? * about([0.0, 1.0, 0.0], pitch)? * about([1.0, 0.0, 0.0], roll)?;
    Ok(Frame { rotation, origin: Vector3::from(triple("xyz")?) })
}

fn lump(inertial: Node) -> Result<Lump, Invalid> {
    let value = |of: &str, attribute: &str| {
        let element = child(inertial, of).ok_or_else(|| foreign(inertial, format!("it needs <{of}>")))?;
        exactly::<1>(element, attribute, required(element, attribute)?).map(|[v]| v)
    };
    let mut moments = [0.0; 6];
    for (moment, name) in moments.iter_mut().zip(["ixx", "iyy", "izz", "ixy", "ixz", "iyz"]) {
        *moment = value("inertia", name)?;
    }
    let at = origin(inertial)?;
    let turn = at.rotation.to_rotation_matrix().into_inner();
    let inertia = turn * symmetric(moments) * turn.transpose();
    Ok(Lump { mass: value("mass", "value")?, center: at.origin, inertia })
}

/// Reads a shape; `None` if the schema has refused it.
fn solid(collision: Node) -> Result<Option<Solid>, Invalid> {
    let geometry = child(collision, "geometry").ok_or_else(|| foreign(collision, "it needs <geometry>"))?;
    let mut shapes = children(geometry);
    let Some(shape) = shapes.next() else { return Err(foreign(geometry, "it needs <box> or <capsule>")) };
    if let Some(second) = shapes.next() {
        let reason = "a second shape in one <geometry>: write a <collision> for each";
        return Err(foreign(second, reason));
    }
    let at = origin(collision)?;
    let number = |attribute| exactly::<1>(shape, attribute, required(shape, attribute)?).map(|[v]| v);
    match tag(shape) {
        "box" => {
            let size = exactly(shape, "size", required(shape, "size")?)?;
            Ok(Some(Solid::Box { at, half: Vector3::from(size) / 2.0 }))
        }
        "capsule" => {
            let half = Vector3::new(0.0, 0.0, number("length")? / 2.0);
            Ok(Some(Solid::Capsule { ends: [at.point(-half), at.point(half)], radius: number("radius")? }))
        }
        _ => Ok(None),
    }
}
