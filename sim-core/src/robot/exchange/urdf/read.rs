//! URDF to robot files.

use crate::error::Invalid;
use crate::robot::RobotSpec;
use crate::robot::exchange::source::{child, children, exactly, foreign, quarter_turns, tag, turn, unknown, zero};
use crate::robot::exchange::tree::{Frame, Link, Solid, Turning, grow};
use crate::robot::rigid::{Lump, symmetric};
use nalgebra::Vector3;
use roxmltree::Node;

/// A robot from the `<robot>` element.
pub(in crate::robot::exchange) fn read(robot: Node) -> Result<RobotSpec, Invalid> {
    let mut links = Vec::new();
    let mut joints = Vec::new();
    for element in children(robot) {
        match tag(element) {
            "link" => links.push(element),
            "joint" => joints.push(element),
            "material" | "transmission" | "gazebo" => {}
            _ => return Err(unknown(element, &["link", "joint", "material", "transmission", "gazebo"])),
        }
    }
    let name_of = |element: Node| match element.attribute("name") {
        Some(name) => Ok(name.to_owned()),
        None => Err(foreign(element, "it needs a name")),
    };
    let names: Vec<String> = links.iter().map(|l| name_of(*l)).collect::<Result<_, _>>()?;
    let mut ends = Vec::new();
    for joint in &joints {
        let end = |which: &str| {
            let link = child(*joint, which).and_then(|e| e.attribute("link")).unwrap_or_default();
            names.iter().position(|n| n == link).ok_or_else(|| {
                foreign(*joint, format!("its {which} link is \"{link}\", which does not exist: {}", names.join(", ")))
            })
        };
        let (parent, child) = (end("parent")?, end("child")?);
        if ends.iter().any(|(_, other)| *other == child) {
            let reason = format!("link \"{}\" is carried twice: loops can't be imported, only trees", names[child]);
            return Err(foreign(*joint, reason));
        }
        ends.push((parent, child));
    }
    let free: Vec<usize> = (0..links.len()).filter(|l| ends.iter().all(|(_, child)| child != l)).collect();
    let [root] = free[..] else {
        let told: Vec<&str> = free.iter().map(|f| names[*f].as_str()).collect();
        let reason = format!("exactly one link is the root; no joint carries these: {}", told.join(", "));
        return Err(foreign(robot, reason));
    };

    // Breadth first, joints in the order of the file.
    let mut order = vec![root];
    let mut found = vec![link(links[root], &names[root], None)?];
    let mut at = 0;
    while at < order.len() {
        let carrier = order[at];
        for (joint, (_, child)) in joints.iter().zip(&ends).filter(|(_, (parent, _))| *parent == carrier) {
            found.push(link(links[*child], &names[*child], Some((at, *joint, name_of(*joint)?)))?);
            order.push(*child);
        }
        at += 1;
    }
    if let Some(lost) = (0..links.len()).find(|l| !order.contains(l)) {
        return Err(foreign(links[lost], "it hangs on a loop of joints: only trees can be imported"));
    }
    Ok(grow(robot.attribute("name").unwrap_or("robot"), "URDF", &found)?.robot)
}

fn link<'a>(
    element: Node<'a, 'a>,
    name: &str,
    carried: Option<(usize, Node<'a, 'a>, String)>,
) -> Result<Link<'a>, Invalid> {
    let mut link = Link {
        element,
        name: name.to_owned(),
        parent: None,
        frame: Frame::none(),
        hinge: None,
        lumps: Vec::new(),
        solids: Vec::new(),
    };
    if let Some((parent, joint, joint_name)) = carried {
        link.parent = Some(parent);
        link.frame = origin(joint)?;
        link.hinge = hinge(joint)?.map(|axis| Turning { name: joint_name, anchor: Vector3::zeros(), axis });
    }
    for part in children(element) {
        match tag(part) {
            "inertial" => link.lumps.push(lump(part)?),
            "collision" => link.solids.push(solid(part)?),
            "visual" => {}
            _ => return Err(unknown(part, &["inertial", "collision", "visual"])),
        }
    }
    Ok(link)
}

/// The axis of a hinge; none for a fixed joint.
fn hinge(joint: Node) -> Result<Option<Vector3<f64>>, Invalid> {
    match joint.attribute("type") {
        Some("fixed") => return Ok(None),
        Some("revolute") => {}
        other => {
            let reason = format!("type = \"{}\": only revolute and fixed are allowed", other.unwrap_or_default());
            return Err(foreign(joint, reason));
        }
    }
    if child(joint, "mimic").is_some() {
        return Err(foreign(joint, "it mimics another: only joints with a motor of their own are allowed"));
    }
    if let Some(dynamics) = child(joint, "dynamics") {
        for attribute in ["damping", "friction"] {
            let why = "a job's motors have damping of their own";
            zero(joint, &format!("dynamics {attribute}"), dynamics.attribute(attribute), why)?;
        }
    }
    let range = match child(joint, "limit") {
        Some(limit) => {
            let end = |which| exactly::<1>(limit, which, limit.attribute(which).unwrap_or("0")).map(|[v]| v);
            Some([end("lower")?, end("upper")?])
        }
        None => None,
    };
    quarter_turns(joint, range)?;
    let axis = match child(joint, "axis").and_then(|axis| axis.attribute("xyz")) {
        Some(text) => exactly(joint, "axis", text)?,
        None => [1.0, 0.0, 0.0],
    };
    Ok(Some(Vector3::from(axis)))
}

/// The `<origin>` of an element: xyz, and rotations about the fixed x, y and z axes.
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
        exactly::<1>(element, attribute, element.attribute(attribute).unwrap_or("0")).map(|[v]| v)
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

fn solid(collision: Node) -> Result<Solid, Invalid> {
    let allowed = ["box", "capsule"];
    let geometry = child(collision, "geometry").ok_or_else(|| foreign(collision, "it needs <geometry>"))?;
    let shape = children(geometry).next().ok_or_else(|| foreign(geometry, "it needs <box> or <capsule>"))?;
    let at = origin(collision)?;
    let number = |attribute| exactly::<1>(shape, attribute, shape.attribute(attribute).unwrap_or("0")).map(|[v]| v);
    match tag(shape) {
        "box" => {
            let size = exactly(shape, "size", shape.attribute("size").unwrap_or("0 0 0"))?;
            Ok(Solid::Box { at, half: Vector3::from(size) / 2.0 })
        }
        "capsule" => {
            let half = Vector3::new(0.0, 0.0, number("length")? / 2.0);
            Ok(Solid::Capsule { ends: [at.point(-half), at.point(half)], radius: number("radius")? })
        }
        _ => Err(unknown(shape, &allowed)),
    }
}
