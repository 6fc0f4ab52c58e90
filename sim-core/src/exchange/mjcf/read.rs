//! Reader from MJCF to robot files.

use super::compiler::{Compiler, option};
use super::defaults::{Defaults, MAIN};
use super::joint::Found;
use super::place::{SPELLINGS, place};
use super::schema::MUJOCO;
use crate::base::error::{Faults, Invalid};
use crate::base::limits::MAX_LINKS;
use crate::exchange::schema::{self, Passed};
use crate::exchange::source::{children, exactly, foreign, keyword, required, tag, zero};
use crate::exchange::tree::{Frame, Link, Tree, grow, lump_in, solid_in};
use crate::exchange::{Import, finish, names};
use crate::model::rigid::{Lump, symmetric};
use nalgebra::Matrix3;
use roxmltree::Node;

/// State of a document that is being read.
pub(super) struct Reader<'a> {
    pub(super) defaults: Defaults<'a>,
    pub(super) compiler: Compiler,
    pub(super) links: Vec<Link<'a>>,
    /// Hinges without limits of their own.
    pub(super) unlimited: Vec<Node<'a, 'a>>,
    pub(super) faults: Faults,
    /// Heights of the planes that form the ground, mu.
    ground: Vec<f64>,
}

/// Reads a robot from the `<mujoco>` element.
pub(in crate::exchange) fn read<'a>(mujoco: Node<'a, 'a>, unit: f64) -> Result<Import, Invalid> {
    let mut reader = Reader {
        defaults: Defaults::default(),
        compiler: Compiler::default(),
        links: Vec::new(),
        unlimited: Vec::new(),
        faults: Faults::default(),
        ground: Vec::new(),
    };
    let mut passed = Passed::default();
    schema::check(mujoco, &MUJOCO, &mut reader.faults, &mut passed);
    for section in children(mujoco) {
        match tag(section) {
            "compiler" => reader.compiler.read(section, &mut reader.faults),
            "default" => drop(reader.faults.take(reader.defaults.read(section, None))),
            "option" => option(section, &mut reader.faults),
            _ => {}
        }
    }
    for world in children(mujoco).filter(|s| tag(*s) == "worldbody") {
        reader.world(world, MAIN, Frame::none());
    }
    if reader.links.is_empty() {
        reader.faults.add(foreign(mujoco, "there is no body in <worldbody>: a robot is needed"));
    } else if reader.links.iter().all(|link| link.solids.is_empty()) && reader.faults.is_empty() {
        let reason =
            "no <geom> of the robot collides: one of type box or capsule with contype and conaffinity 1 is needed";
        reader.faults.add(foreign(reader.links[0].element, reason));
    }
    reader.actuators(mujoco);
    let names = names::adopt(mujoco.attribute("model"), &reader.links, &mut reader.faults);
    let tree = grow(&names, "MJCF", &reader.links, &mut reader.faults);
    reader.exclusions(mujoco, &tree);
    let ground = reader.ground.first().filter(|height| **height != 0.0);
    let ground =
        ground.map(|height| format!("the ground of the file is at z = {height}: a job sets robots on its own ground"));
    finish(tree, unit, reader.faults, [passed.note(), names.note, ground].into_iter().flatten())
}

impl<'a> Reader<'a> {
    /// Reads the content of the world: the ground and one robot.
    fn world(&mut self, around: Node<'a, 'a>, class: &'a str, frame: Frame) {
        for element in children(around) {
            if self.faults.is_full() {
                return;
            }
            match tag(element) {
                "geom" => drop(self.ground(element, class, &frame)),
                "frame" => {
                    let (class, inner) = self.inner(element, class, &frame);
                    self.world(element, class, inner);
                }
                "body" if stands_still(element) && self.only_planes(element, class) => {
                    let (class, inner) = self.inner(element, class, &frame);
                    self.world(element, class, inner);
                }
                "body" if self.links.is_empty() => self.body(element, None, class, &frame),
                "body" => {
                    self.faults.add(foreign(element, "a second robot: only one body is allowed in <worldbody>"));
                }
                _ => {}
            }
        }
    }

    /// Returns the class and the frame for the content of an element.
    fn inner(&mut self, element: Node<'a, 'a>, class: &'a str, frame: &Frame) -> (&'a str, Frame) {
        let own = self.faults.take(self.defaults.class(element, "childclass", class)).unwrap_or(class);
        let at = self.place(element, own).unwrap_or(Frame::none());
        (own, if frame.is_none() { at } else { frame.then(&at) })
    }

    /// Returns true if an element has only planes and visual geoms.
    fn only_planes(&self, body: Node<'a, 'a>, class: &'a str) -> bool {
        let class = self.defaults.class(body, "childclass", class).unwrap_or(class);
        children(body).all(|element| match tag(element) {
            "geom" => {
                self.defaults.get(element, class, "type") == Ok(Some("plane"))
                    || self.collides(element, class) == Ok(false)
            }
            "body" | "frame" => self.only_planes(element, class),
            _ => true,
        })
    }

    /// Reads a geom of the world. Only level ground, which every job has, may collide. Returns `None` for a refused
    /// geom.
    fn ground(&mut self, geom: Node<'a, 'a>, class: &'a str, frame: &Frame) -> Option<()> {
        if !self.faults.take(self.collides(geom, class))? {
            return Some(());
        }
        let flat = self.faults.take(self.defaults.get(geom, class, "type"))? == Some("plane");
        let at = frame.then(&self.place(geom, class)?);
        let level = at.rotation.imag().xy().norm() < 1e-9;
        let same = self.ground.first().is_none_or(|height| (height - at.origin.z).abs() < 1e-9);
        if flat && level && same {
            self.ground.push(at.origin.z);
            return Some(());
        }
        let reason =
            "only one level plane is allowed in the world: obstacles and terrain belong to a job's environment";
        self.faults.add(foreign(geom, reason));
        None
    }

    fn place(&mut self, element: Node<'a, 'a>, class: &'a str) -> Option<Frame> {
        let found = place(element, class, &self.defaults, &self.compiler);
        self.faults.take(found)
    }

    /// Reads a body with all that it carries. `around` is the frame around it.
    fn body(&mut self, body: Node<'a, 'a>, parent: Option<usize>, inherited: &'a str, around: &Frame) {
        if self.links.len() > MAX_LINKS {
            return; // refused already
        }
        if self.links.len() == MAX_LINKS {
            self.faults.add(foreign(body, format!("there are too many bodies: at most {MAX_LINKS} are allowed")));
        }
        if let Some(text) = body.attribute("mocap") {
            let mocap = self.faults.take(keyword(body, "mocap", text, &["true", "false"]));
            if mocap == Some("true") {
                self.faults
                    .add(foreign(body, "mocap = \"true\": bodies that are moved from outside can't be imported"));
            }
        }
        self.faults.take(zero(body, "gravcomp", body.attribute("gravcomp"), "gravity acts on every body"));
        let (class, frame) = self.inner(body, inherited, around);
        let index = self.links.len();
        self.links.push(Link { parent, frame, ..Link::new(body) });
        let weighs = match self.compiler.from_geoms {
            None => !has_inertial(body),
            Some(from_geoms) => from_geoms,
        };
        let mut found = Content::default();
        self.content(body, index, weighs, class, &Frame::none(), &mut found);
        self.links[index].hinge = self.hinge(body, &found.joints, parent.is_none());
        if let [_, second, ..] = found.inertials[..] {
            self.faults.add(foreign(second.0, "a second <inertial> of one body: only one is allowed"));
        }
        // Lumps without mass are removed, so that a single lump keeps its bits. If no geom has mass, `<inertial>`
        // counts.
        self.links[index].lumps.retain(|lump| lump.mass != 0.0);
        if let Some((inertial, frame)) = found.inertials.first()
            && self.links[index].lumps.is_empty()
        {
            match self.inertial(*inertial) {
                Some(lump) if frame.is_none() => self.links[index].lumps.push(lump),
                Some(lump) => self.links[index].lumps.push(lump_in(&lump, frame)),
                None => self.links[index].incomplete = true,
            }
        }
    }

    /// Reads the content of a body, including that of its frames.
    fn content(
        &mut self,
        around: Node<'a, 'a>,
        index: usize,
        weighs: bool,
        class: &'a str,
        frame: &Frame,
        found: &mut Content<'a>,
    ) {
        for element in children(around) {
            if self.faults.is_full() {
                return;
            }
            match tag(element) {
                "joint" | "freejoint" => found.joints.push((element, class, *frame)),
                "inertial" => found.inertials.push((element, *frame)),
                "geom" => {
                    let read = self.part(element, index, weighs, class, frame);
                    self.links[index].incomplete |= read.is_none();
                }
                "body" => self.body(element, Some(index), class, frame),
                "frame" => {
                    let (class, inner) = self.inner(element, class, frame);
                    self.content(element, index, weighs, class, &inner, found);
                }
                _ => {}
            }
        }
    }

    /// Adds a geom to its link. Returns `None` for a refused geom.
    fn part(&mut self, geom: Node<'a, 'a>, index: usize, weighs: bool, class: &'a str, frame: &Frame) -> Option<()> {
        let at = self.place(geom, class)?;
        let Some(found) = self.faults.take(self.geom(geom, class, at, weighs))? else { return Some(()) };
        let solid = if frame.is_none() { found.solid } else { solid_in(&found.solid, frame) };
        if weighs {
            let lump = self.faults.take(self.weight(geom, class, &solid))?;
            self.links[index].lumps.push(lump);
        }
        if found.collides {
            self.links[index].solids.push(solid);
        }
        Some(())
    }

    fn inertial(&mut self, inertial: Node<'a, 'a>) -> Option<Lump> {
        let Frame { rotation, origin } = self.place(inertial, MAIN)?;
        let turned = SPELLINGS.iter().any(|spelling| inertial.has_attribute(*spelling));
        let read = || -> Result<Lump, Invalid> {
            required(inertial, "pos")?;
            let [mass] = exactly(inertial, "mass", required(inertial, "mass")?)?;
            let moments = match (inertial.attribute("fullinertia"), inertial.attribute("diaginertia")) {
                (Some(_), Some(_)) => {
                    return Err(foreign(inertial, "both fullinertia and diaginertia: only one of them is allowed"));
                }
                (Some(_), None) if turned => {
                    return Err(foreign(
                        inertial,
                        "fullinertia with an orientation: rotate the matrix, or give diaginertia",
                    ));
                }
                (Some(full), None) => exactly::<6>(inertial, "fullinertia", full)?,
                (None, Some(diagonal)) => {
                    let [xx, yy, zz] = exactly(inertial, "diaginertia", diagonal)?;
                    [xx, yy, zz, 0.0, 0.0, 0.0]
                }
                (None, None) => return Err(foreign(inertial, "it needs fullinertia or diaginertia")),
            };
            let turn = rotation.to_rotation_matrix().into_inner();
            let inertia = match turn == Matrix3::identity() {
                true => symmetric(moments),
                false => turn * symmetric(moments) * turn.transpose(),
            };
            Ok(Lump { mass, center: origin, inertia })
        };
        self.faults.take(read())
    }

    /// Refuses exclusions between bodies without a common joint. Bodies with a common joint never touch; all others do.
    fn exclusions(&mut self, mujoco: Node<'a, 'a>, tree: &Tree) {
        for entry in children(mujoco).filter(|s| tag(*s) == "contact").flat_map(children) {
            if tag(entry) != "exclude" {
                continue;
            }
            let find = |attribute| {
                let wanted = required(entry, attribute)?;
                let found = self.links.iter().position(|l| l.name.as_deref() == Some(wanted));
                found.ok_or_else(|| foreign(entry, format!("{attribute} = \"{wanted}\" is not a body of the robot")))
            };
            let ends = find("body1").and_then(|first| Ok((first, find("body2")?)));
            if let Some((first, second)) = self.faults.take(ends)
                && !tree.neighbours(first, second)
            {
                let reason = "only bodies that share a joint can be excluded: all others touch each other";
                self.faults.add(foreign(entry, reason));
            }
        }
    }
}

/// Joints and inertials of a body, including those in its frames.
#[derive(Default)]
struct Content<'a> {
    joints: Vec<Found<'a>>,
    inertials: Vec<(Node<'a, 'a>, Frame)>,
}

/// Returns true if an element has an `<inertial>`, directly or in frames.
fn has_inertial(around: Node) -> bool {
    children(around).any(|element| match tag(element) {
        "inertial" => true,
        "frame" => has_inertial(element),
        _ => false,
    })
}

/// Returns true if neither a body nor any body below it has a joint.
fn stands_still(body: Node) -> bool {
    children(body).all(|element| match tag(element) {
        "joint" | "freejoint" => false,
        "body" | "frame" => stands_still(element),
        _ => true,
    })
}
