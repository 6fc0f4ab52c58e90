//! Tree of links, common to both formats: links in each other's frames become the bodies of a robot file.

use super::names::Names;
use super::source::foreign;
use crate::base::error::Faults;
use crate::base::limits::MAX_BODIES;
use crate::model::rigid::Lump;
use crate::model::{BodySpec, BoxSpec, CapsuleSpec, HingeSpec, RobotSpec};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use roxmltree::Node;

/// Pose of a frame in another frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub rotation: UnitQuaternion<f64>,
    pub origin: Vector3<f64>,
}

impl Frame {
    /// Returns the identity.
    pub fn none() -> Frame {
        Frame { rotation: UnitQuaternion::identity(), origin: Vector3::zeros() }
    }

    pub fn point(&self, p: Vector3<f64>) -> Vector3<f64> {
        self.origin + self.rotation * p
    }

    /// Returns the pose of `inner`, which is given in this frame, in the frame around this one.
    pub fn then(&self, inner: &Frame) -> Frame {
        Frame { rotation: self.rotation * inner.rotation, origin: self.point(inner.origin) }
    }

    /// Returns true if it is exactly the identity.
    pub fn is_none(&self) -> bool {
        self.rotation == UnitQuaternion::identity() && self.origin == Vector3::zeros()
    }
}

/// Part of a link that collides, in the link's frame.
#[derive(Clone, Debug)]
pub(super) enum Solid {
    Box { at: Frame, half: Vector3<f64> },
    Capsule { ends: [Vector3<f64>; 2], radius: f64 },
}

/// Hinge with anchor and axis in one frame.
#[derive(Clone, Debug)]
pub(super) struct Turning<'a> {
    pub element: Node<'a, 'a>,
    /// Name in the file.
    pub name: Option<String>,
    pub anchor: Vector3<f64>,
    pub axis: Vector3<f64>,
}

/// A link (a body of MJCF). It comes after the link that carries it.
#[derive(Debug)]
pub(super) struct Link<'a> {
    pub element: Node<'a, 'a>,
    /// Name in the file.
    pub name: Option<String>,
    /// Index of the parent link; only the first link has none.
    pub parent: Option<usize>,
    /// Pose in the parent's frame.
    pub frame: Frame,
    /// Hinge that carries it. Without a hinge it is part of its parent.
    pub hinge: Option<Turning<'a>>,
    /// Masses in its own frame.
    pub lumps: Vec<Lump>,
    pub solids: Vec<Solid>,
    /// True if a part of it was refused. A missing mass is then not reported.
    pub incomplete: bool,
}

impl<'a> Link<'a> {
    /// Creates an empty link at the root's place.
    pub fn new(element: Node<'a, 'a>) -> Self {
        Self {
            element,
            name: element.attribute("name").map(str::to_owned),
            parent: None,
            frame: Frame::none(),
            hinge: None,
            lumps: Vec::new(),
            solids: Vec::new(),
            incomplete: false,
        }
    }
}

/// Body under construction.
struct Growing<'a> {
    element: Node<'a, 'a>,
    name: String,
    /// Index of the carrying body, name of the hinge, and the hinge in the carrying body's frame.
    hinge: Option<(usize, String, Turning<'a>)>,
    lumps: Vec<Lump>,
    solids: Vec<Solid>,
    incomplete: bool,
}

/// Robot, and for each link the index of its body.
pub(super) struct Tree<'a> {
    pub robot: RobotSpec,
    /// Element of each body.
    pub elements: Vec<Node<'a, 'a>>,
    body_of: Vec<usize>,
    parent_of: Vec<Option<usize>>,
}

impl Tree<'_> {
    /// Returns true if two links share a hinge or are rigidly joined, so that they never touch.
    pub fn neighbours(&self, a: usize, b: usize) -> bool {
        let (a, b) = (self.body_of[a], self.body_of[b]);
        a == b || self.parent_of[a] == Some(b) || self.parent_of[b] == Some(a)
    }
}

/// Joins links that never move relative to each other, and rotates all frames to the axes of the neutral configuration.
/// Adds bodies that are not allowed to the faults.
pub(super) fn grow<'a>(names: &Names, format: &str, links: &[Link<'a>], faults: &mut Faults) -> Tree<'a> {
    let mut bodies: Vec<Growing> = Vec::new();
    // For each link its body, and its pose in that body's frame.
    let mut placed: Vec<(usize, Frame)> = Vec::new();
    for (i, link) in links.iter().enumerate() {
        let carrier = link.parent.map(|p| placed[p]);
        let seen = match carrier {
            Some((_, outer)) => outer.then(&link.frame),
            // The origin of the robot is that of its root; its axes are those of the file.
            None => Frame { origin: Vector3::zeros(), ..link.frame },
        };
        let growing = |hinge| Growing {
            element: link.element,
            name: names.bodies[i].clone(),
            hinge,
            lumps: Vec::new(),
            solids: Vec::new(),
            incomplete: false,
        };
        let (body, frame) = match (&link.hinge, carrier) {
            (None, Some((body, _))) => (body, seen),
            (Some(turning), Some((parent, _))) => {
                let Turning { anchor, axis, .. } = turning;
                let hinge = Turning { anchor: seen.point(*anchor), axis: seen.rotation * axis, ..turning.clone() };
                let name = names.hinges[i].clone().unwrap_or_default();
                bodies.push(growing(Some((parent, name, hinge))));
                (bodies.len() - 1, Frame { origin: -(seen.rotation * anchor), ..seen })
            }
            (_, None) => {
                bodies.push(growing(None));
                (bodies.len() - 1, seen)
            }
        };
        if bodies.len() == MAX_BODIES + 1 {
            let reason = format!("there are too many bodies: at most {MAX_BODIES} are allowed");
            faults.add(foreign(link.element, reason));
        }
        let negative = link.lumps.iter().any(|lump| lump.mass < 0.0);
        if negative {
            faults.add(foreign(link.element, "a negative mass: it must be 0 or greater"));
        }
        bodies[body].incomplete |= link.incomplete || negative;
        bodies[body].lumps.extend(link.lumps.iter().map(|lump| lump_in(lump, &frame)));
        bodies[body].solids.extend(link.solids.iter().map(|solid| solid_in(solid, &frame)));
        placed.push((body, frame));
    }
    let of_bodies: Vec<String> = bodies.iter().map(|b| b.name.clone()).collect();
    let parent_of = bodies.iter().map(|b| Some(b.hinge.as_ref()?.0)).collect();
    let elements = bodies.iter().map(|b| b.element).collect();
    let robot = RobotSpec {
        name: names.robot.clone(),
        description: format!("Imported from {format}. Gravity, friction and motors are those of the job."),
        pivot: of_bodies.first().cloned().unwrap_or_default(),
        failed: Vec::new(),
        variants: Default::default(),
        modules: Vec::new(),
        bodies: bodies.into_iter().filter_map(|body| body.finish(&of_bodies, faults)).collect(),
    };
    Tree { robot, elements, body_of: placed.iter().map(|p| p.0).collect(), parent_of }
}

/// Returns a lump, which is given in a frame, in the frame around it.
pub(super) fn lump_in(lump: &Lump, frame: &Frame) -> Lump {
    let inertia = if frame.rotation == UnitQuaternion::identity() {
        lump.inertia // keeps its bits
    } else {
        let turn: Matrix3<f64> = frame.rotation.to_rotation_matrix().into_inner();
        turn * lump.inertia * turn.transpose()
    };
    Lump { mass: lump.mass, center: frame.point(lump.center), inertia }
}

/// Returns a solid, which is given in a frame, in the frame around it.
pub(super) fn solid_in(solid: &Solid, frame: &Frame) -> Solid {
    match solid {
        Solid::Box { at, half } => Solid::Box { at: frame.then(at), half: *half },
        Solid::Capsule { ends, radius } => Solid::Capsule { ends: ends.map(|end| frame.point(end)), radius: *radius },
    }
}

impl Growing<'_> {
    fn finish(self, names: &[String], faults: &mut Faults) -> Option<BodySpec> {
        let Some(Lump { mass, center, inertia: i }) = Lump::joined(&self.lumps) else {
            if !self.incomplete {
                faults.add(foreign(self.element, "it has no mass: every moving body needs a mass above 0"));
            }
            return None;
        };
        let hinge = self.hinge.map(|(parent, name, Turning { anchor, axis, .. })| HingeSpec {
            name,
            parent: names[parent].clone(),
            anchor: anchor.into(),
            axis: axis.into(),
            limits: None,
            speed: None,
            torque: None,
        });
        let (mut boxes, mut capsules) = (Vec::new(), Vec::new());
        for solid in self.solids {
            match solid {
                Solid::Box { at, half } => boxes.push(BoxSpec {
                    center: at.origin.into(),
                    rotation: at.rotation.coords.into(),
                    half: half.into(),
                }),
                Solid::Capsule { ends: [from, to], radius } => {
                    capsules.push(CapsuleSpec { from: from.into(), to: to.into(), radius });
                }
            }
        }
        let inertia = [i[(0, 0)], i[(1, 1)], i[(2, 2)], i[(0, 1)], i[(0, 2)], i[(1, 2)]];
        Some(BodySpec { name: self.name, mass, center_of_mass: center.into(), inertia, hinge, boxes, capsules })
    }
}
