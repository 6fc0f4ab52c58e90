//! MJCF to robot files.

use super::defaults::{Defaults, MAIN};
use crate::error::Invalid;
use crate::robot::RobotSpec;
use crate::robot::exchange::source::{
    child, children, exactly, foreign, numbers, quarter_turns, rotation, tag, turn, unknown, zero,
};
use crate::robot::exchange::tree::{Frame, Link, Turning, grow};
use crate::robot::rigid::{Lump, symmetric};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use roxmltree::{Document, Node};

/// Sections that are read, and those that say nothing about the robot.
const SECTIONS: &[&str] = &[
    "compiler",
    "default",
    "option",
    "worldbody",
    "contact",
    "actuator",
    "asset",
    "size",
    "visual",
    "statistic",
    "custom",
    "keyframe",
    "sensor",
];
/// What a body may hold.
const IN_BODY: &[&str] = &["inertial", "joint", "freejoint", "geom", "body", "site", "camera", "light"];
/// Why passive forces in joints are refused.
const PASSIVE: &str = "joints have nothing but the motors of a job";

/// What is being read, with what `<compiler>` and `<default>` say.
pub(super) struct Reader<'a> {
    pub(super) defaults: Defaults<'a>,
    degrees: bool,
    autolimits: bool,
    /// `Some(true)`: masses follow from geoms even where there is `<inertial>`; `Some(false)`: never.
    from_geoms: Option<bool>,
    links: Vec<Link<'a>>,
}

/// Whose place is read.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Place {
    Body,
    Geom,
}

/// A robot from a document whose root element is `<mujoco>`.
pub(in crate::robot::exchange) fn read<'a>(document: &'a Document<'a>) -> Result<RobotSpec, Invalid> {
    let mujoco = document.root_element();
    let mut reader =
        Reader { defaults: Defaults::default(), degrees: true, autolimits: true, from_geoms: None, links: Vec::new() };
    for section in children(mujoco) {
        match tag(section) {
            "compiler" => reader.compiler(section)?,
            "default" => reader.defaults.read(section, None)?,
            "option" => option(section)?,
            "worldbody" | "contact" | "actuator" | "asset" | "size" | "visual" | "statistic" | "custom"
            | "keyframe" | "sensor" => {}
            "equality" => refuse_content(section, "constraints beside hinges, and so closed loops, can't be imported")?,
            "tendon" => refuse_content(section, "tendons can't be imported")?,
            "include" => return Err(foreign(section, "files of several parts can't be imported: put all in one file")),
            _ => return Err(unknown(section, SECTIONS)),
        }
    }
    reader.worldbody(mujoco)?;
    reader.actuators(mujoco)?;
    let tree = grow(mujoco.attribute("model").unwrap_or("robot"), "MJCF", &reader.links)?;
    for section in children(mujoco).filter(|s| tag(*s) == "contact") {
        for entry in children(section) {
            if tag(entry) != "exclude" {
                return Err(unknown(entry, &["exclude"]));
            }
            let find = |attribute| {
                let wanted = entry.attribute(attribute);
                let found = reader.links.iter().position(|l| wanted == Some(l.name.as_str()));
                found.ok_or_else(|| foreign(entry, format!("{attribute} names no body")))
            };
            if !tree.neighbours(find("body1")?, find("body2")?) {
                let reason = "only bodies that share a joint may pass through each other: all others touch here";
                return Err(foreign(entry, reason));
            }
        }
    }
    Ok(tree.robot)
}

fn refuse_content(section: Node, why: &str) -> Result<(), Invalid> {
    children(section).next().map_or(Ok(()), |first| Err(foreign(first, why)))
}

fn option(option: Node) -> Result<(), Invalid> {
    let filter = child(option, "flag").and_then(|flag| flag.attribute("filterparent"));
    if filter == Some("disable") {
        return Err(foreign(option, "filterparent = \"disable\": bodies that share a joint never touch here"));
    }
    Ok(())
}

impl<'a> Reader<'a> {
    fn compiler(&mut self, compiler: Node) -> Result<(), Invalid> {
        for (name, refused) in [("coordinate", "global"), ("balanceinertia", "true")] {
            if compiler.attribute(name) == Some(refused) {
                return Err(foreign(compiler, format!("{name} = \"{refused}\" can't be imported: leave it out")));
            }
        }
        for name in ["boundmass", "boundinertia", "inertiagrouprange"] {
            if compiler.attribute(name).is_some_and(|value| value.split_whitespace().any(|v| v != "0")) {
                return Err(foreign(
                    compiler,
                    format!("{name} can't be imported: write masses and inertias as they are"),
                ));
            }
        }
        if compiler.attribute("settotalmass").is_some_and(|mass| !mass.trim().starts_with('-')) {
            return Err(foreign(compiler, "settotalmass can't be imported: write masses as they are"));
        }
        if let Some(order) = compiler.attribute("eulerseq").filter(|order| *order != "xyz") {
            return Err(foreign(
                compiler,
                format!("eulerseq = \"{order}\": only xyz is allowed, or quat in place of euler"),
            ));
        }
        if let Some(angle) = compiler.attribute("angle") {
            self.degrees = angle != "radian";
        }
        if let Some(auto) = compiler.attribute("autolimits") {
            self.autolimits = auto == "true";
        }
        match compiler.attribute("inertiafromgeom") {
            Some("true") => self.from_geoms = Some(true),
            Some("false") => self.from_geoms = Some(false),
            _ => {}
        }
        Ok(())
    }

    fn worldbody(&mut self, mujoco: Node<'a, 'a>) -> Result<(), Invalid> {
        for world in children(mujoco).filter(|s| tag(*s) == "worldbody") {
            for element in children(world) {
                match tag(element) {
                    "body" if self.links.is_empty() => self.body(element, None, MAIN)?,
                    "body" => return Err(foreign(element, "a second robot: only one body may stand in <worldbody>")),
                    "geom" => self.ground(element)?,
                    "light" | "camera" | "site" => {}
                    _ => return Err(unknown(element, &["body", "geom", "light", "camera", "site"])),
                }
            }
        }
        if self.links.is_empty() {
            return Err(foreign(mujoco, "it has no body in <worldbody>"));
        }
        Ok(())
    }

    /// The one thing that may stand in the world: flat ground at z = 0, which is always there.
    fn ground(&self, geom: Node<'a, 'a>) -> Result<(), Invalid> {
        let flat = self.defaults.get(geom, MAIN, "type")? == Some("plane");
        let at = self.place(geom, MAIN, Place::Geom)?;
        let level = at.rotation.imag().xy().norm() < 1e-9 && at.origin.z.abs() < 1e-9;
        if (flat && level) || !self.collides(geom, MAIN)? {
            return Ok(());
        }
        let reason =
            "only a plane at z = 0 is allowed in the world: obstacles and terrain belong to a job's environment";
        Err(foreign(geom, reason))
    }

    fn body(&mut self, body: Node<'a, 'a>, parent: Option<usize>, inherited: &'a str) -> Result<(), Invalid> {
        let class = body.attribute("childclass").unwrap_or(inherited);
        if body.attribute("mocap") == Some("true") {
            return Err(foreign(body, "mocap = \"true\": bodies that others move can't be imported"));
        }
        zero(body, "gravcomp", body.attribute("gravcomp"), "gravity pulls everything")?;
        let index = self.links.len();
        let name = body.attribute("name").map_or_else(|| format!("body{index}"), str::to_owned);
        let hinge = self.joint(body, class, parent.is_none(), &name)?;
        self.links.push(Link {
            element: body,
            parent,
            frame: self.place(body, class, Place::Body)?,
            hinge,
            lumps: Vec::new(),
            solids: Vec::new(),
            name,
        });
        let own = child(body, "inertial").filter(|_| self.from_geoms != Some(true));
        let weighs = own.is_none() && self.from_geoms != Some(false);
        for element in children(body) {
            match tag(element) {
                "geom" => {
                    if let Some(geom) = self.geom(element, class, weighs)? {
                        if weighs {
                            let lump = self.weight(element, class, &geom.solid)?;
                            self.links[index].lumps.push(lump);
                        }
                        if geom.collides {
                            self.links[index].solids.push(geom.solid);
                        }
                    }
                }
                "body" => self.body(element, Some(index), class)?,
                known if IN_BODY.contains(&known) => {}
                _ => return Err(unknown(element, IN_BODY)),
            }
        }
        if let Some(inertial) = own {
            let lump = self.inertial(inertial)?;
            self.links[index].lumps.push(lump);
        }
        // Massless geoms add nothing: without them one lump keeps its bits.
        self.links[index].lumps.retain(|lump| lump.mass != 0.0);
        Ok(())
    }

    /// The hinge of a body. The root has a free joint instead, a body without any is part of its
    /// parent.
    fn joint(&self, body: Node<'a, 'a>, class: &str, root: bool, name: &str) -> Result<Option<Turning>, Invalid> {
        let joints: Vec<_> = children(body).filter(|c| ["joint", "freejoint"].contains(&tag(*c))).collect();
        let kind = |joint| match tag(joint) {
            "freejoint" => Ok("free"),
            _ => self.defaults.get(joint, class, "type").map(|kind| kind.unwrap_or("hinge")),
        };
        let joint = match joints[..] {
            [] if root => return Err(foreign(body, "the root needs <freejoint/>: robots here are fixed to nothing")),
            [] => return Ok(None),
            [joint] => joint,
            [_, second, ..] => {
                return Err(foreign(
                    second,
                    "a second joint of one body: only one hinge is allowed; put a body between",
                ));
            }
        };
        match (kind(joint)?, root) {
            ("free", true) => return Ok(None),
            ("hinge", false) => {}
            (other, true) => return Err(foreign(joint, format!("type = \"{other}\": the root needs a free joint"))),
            (other, false) => {
                return Err(foreign(joint, format!("type = \"{other}\": only hinge is allowed below the root")));
            }
        }
        let get = |attribute| self.defaults.get(joint, class, attribute);
        for attribute in ["stiffness", "damping", "armature", "frictionloss"] {
            zero(joint, attribute, get(attribute)?, PASSIVE)?;
        }
        zero(joint, "ref", get("ref")?, "all joints stand at 0 in the neutral configuration")?;
        let limited = match get("limited")? {
            Some("true") => true,
            Some("false") => false,
            _ => self.autolimits && get("range")?.is_some(),
        };
        let range = get("range")?.filter(|_| limited).map(|text| exactly::<2>(joint, "range", text)).transpose()?;
        quarter_turns(joint, range.map(|range| range.map(|angle| self.radians(angle))))?;
        let triple = |attribute, default| exactly::<3>(joint, attribute, get(attribute)?.unwrap_or(default));
        Ok(Some(Turning {
            name: joint.attribute("name").unwrap_or(name).to_owned(),
            anchor: Vector3::from(triple("pos", "0 0 0")?),
            axis: Vector3::from(triple("axis", "0 0 1")?),
        }))
    }

    fn inertial(&self, inertial: Node<'a, 'a>) -> Result<Lump, Invalid> {
        let Frame { rotation, origin } = self.place(inertial, MAIN, Place::Body)?;
        let get = |attribute: &str| inertial.attribute(attribute);
        let [mass] = exactly(inertial, "mass", get("mass").unwrap_or_default())?;
        let moments = match (get("fullinertia"), get("diaginertia")) {
            (Some(full), _) => exactly::<6>(inertial, "fullinertia", full)?,
            (None, Some(diagonal)) => {
                let [xx, yy, zz] = exactly(inertial, "diaginertia", diagonal)?;
                [xx, yy, zz, 0.0, 0.0, 0.0]
            }
            (None, None) => return Err(foreign(inertial, "it needs fullinertia or diaginertia")),
        };
        let turn = rotation.to_rotation_matrix().into_inner();
        let inertia =
            if turn == Matrix3::identity() { symmetric(moments) } else { turn * symmetric(moments) * turn.transpose() };
        Ok(Lump { mass, center: origin, inertia })
    }

    /// `pos` and the orientation in one of its five spellings.
    pub(super) fn place(&self, element: Node<'a, 'a>, class: &str, whose: Place) -> Result<Frame, Invalid> {
        // Only geoms have defaults.
        let get = |attribute: &str| match whose {
            Place::Geom => self.defaults.get(element, class, attribute),
            Place::Body => Ok(element.attribute(attribute)),
        };
        let origin = Vector3::from(exactly::<3>(element, "pos", get("pos")?.unwrap_or("0 0 0"))?);
        let rotation = if let Some(text) = get("quat")? {
            rotation(element, exactly(element, "quat", text)?)?
        } else if let Some(text) = get("euler")? {
            let [x, y, z] = exactly::<3>(element, "euler", text)?.map(|angle| self.radians(angle));
            let about = |axis, angle| turn(element, axis, angle);
            about([1.0, 0.0, 0.0], x)? * about([0.0, 1.0, 0.0], y)? * about([0.0, 0.0, 1.0], z)?
        } else if let Some(text) = get("axisangle")? {
            let [x, y, z, angle] = exactly(element, "axisangle", text)?;
            turn(element, [x, y, z], self.radians(angle))?
        } else if let Some(text) = get("xyaxes")? {
            let given = numbers(element, "xyaxes", text)?;
            let ([x0, x1, x2], [y0, y1, y2]) = match given[..] {
                [a, b, c, d, e, f] => ([a, b, c], [d, e, f]),
                _ => return Err(foreign(element, "xyaxes: 6 numbers are needed")),
            };
            let x = Vector3::new(x0, x1, x2).normalize();
            let y = Vector3::new(y0, y1, y2);
            let y = (y - x * x.dot(&y)).normalize();
            if !(x.sum() + y.sum()).is_finite() {
                return Err(foreign(element, "xyaxes: two directions that are not the same are needed"));
            }
            let matrix = Matrix3::from_columns(&[x, y, x.cross(&y)]);
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix))
        } else if let Some(text) = get("zaxis")? {
            let z = Vector3::from(exactly::<3>(element, "zaxis", text)?).normalize();
            // The shortest turn from (0, 0, 1): 1 + cos, and the cross product.
            match z.z > -1.0 + 1e-12 {
                true => rotation(element, [1.0 + z.z, -z.y, z.x, 0.0])?,
                false => rotation(element, [0.0, 1.0, 0.0, 0.0])?,
            }
        } else {
            UnitQuaternion::identity()
        };
        Ok(Frame { rotation, origin })
    }

    fn radians(&self, angle: f64) -> f64 {
        if self.degrees { angle.to_radians() } else { angle }
    }

    /// Where there are motors, each hinge must have one; what kind does not matter, since a job has motors of its own.
    fn actuators(&self, mujoco: Node<'a, 'a>) -> Result<(), Invalid> {
        let all = children(mujoco).filter(|s| tag(*s) == "actuator").flat_map(children);
        let driven: Vec<&str> = all.filter_map(|actuator| actuator.attribute("joint")).collect();
        let passive = |link: &&Link| link.hinge.as_ref().is_some_and(|hinge| !driven.contains(&hinge.name.as_str()));
        match self.links.iter().find(passive).filter(|_| !driven.is_empty()) {
            Some(link) => {
                let reason = "its joint has no actuator while others have: only joints with a motor are allowed";
                Err(foreign(link.element, reason))
            }
            None => Ok(()),
        }
    }
}
