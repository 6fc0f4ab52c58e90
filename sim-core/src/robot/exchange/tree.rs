//! What both formats have in common: links in each other's frames, to the bodies of a robot file.

use super::source::foreign;
use crate::error::Invalid;
use crate::limits::MAX_BODIES;
use crate::robot::rigid::Lump;
use crate::robot::{BodySpec, BoxSpec, CapsuleSpec, HingeSpec, RobotSpec};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use roxmltree::Node;

/// Where a frame lies in another.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub rotation: UnitQuaternion<f64>,
    pub origin: Vector3<f64>,
}

impl Frame {
    /// In the same place.
    pub fn none() -> Frame {
        Frame { rotation: UnitQuaternion::identity(), origin: Vector3::zeros() }
    }

    pub fn point(&self, p: Vector3<f64>) -> Vector3<f64> {
        self.origin + self.rotation * p
    }
}

/// A part of a link that collides, in the link's frame.
#[derive(Clone, Debug)]
pub(super) enum Solid {
    Box { at: Frame, half: Vector3<f64> },
    Capsule { ends: [Vector3<f64>; 2], radius: f64 },
}

/// A hinge in some frame.
#[derive(Clone, Debug)]
pub(super) struct Turning {
    pub name: String,
    pub anchor: Vector3<f64>,
    pub axis: Vector3<f64>,
}

/// A link, a body of MJCF: what carries it comes before it in the list.
#[derive(Debug)]
pub(super) struct Link<'a> {
    pub element: Node<'a, 'a>,
    pub name: String,
    /// What carries it; only the first has none.
    pub parent: Option<usize>,
    /// In its parent's frame.
    pub frame: Frame,
    /// Without one it is part of its parent.
    pub hinge: Option<Turning>,
    /// In its own frame.
    pub lumps: Vec<Lump>,
    pub solids: Vec<Solid>,
}

/// A body that grows.
struct Growing<'a> {
    element: Node<'a, 'a>,
    name: String,
    /// With what carries it, in that one's frame.
    hinge: Option<(usize, Turning)>,
    lumps: Vec<Lump>,
    solids: Vec<Solid>,
}

/// The robot, and for each link the index of its body.
pub(super) struct Tree {
    pub robot: RobotSpec,
    body_of: Vec<usize>,
    parent_of: Vec<Option<usize>>,
}

impl Tree {
    /// Whether two links share a hinge or are rigidly joined, so that they never touch here.
    pub fn neighbours(&self, a: usize, b: usize) -> bool {
        let (a, b) = (self.body_of[a], self.body_of[b]);
        a == b || self.parent_of[a] == Some(b) || self.parent_of[b] == Some(a)
    }
}

/// Joins links that never move against each other, and turns all frames to the axes of the neutral configuration.
pub(super) fn grow(name: &str, format: &str, links: &[Link]) -> Result<Tree, Invalid> {
    let mut bodies: Vec<Growing> = Vec::new();
    // For each link its body, and where it lies in that body's frame.
    let mut placed: Vec<(usize, Frame)> = Vec::new();
    for link in links {
        let carrier = link.parent.map(|p| placed[p]);
        let seen = match carrier {
            Some((_, outer)) => {
                Frame { rotation: outer.rotation * link.frame.rotation, origin: outer.point(link.frame.origin) }
            }
            // The robot's origin is its root's, its axes are those of the file.
            None => Frame { origin: Vector3::zeros(), ..link.frame },
        };
        let (body, frame) = match (&link.hinge, carrier) {
            (None, Some((body, _))) => (body, seen),
            (Some(Turning { name, anchor, axis }), Some((parent, _))) => {
                let (anchor_there, axis) = (seen.point(*anchor), seen.rotation * axis);
                let hinge = Turning { name: name.clone(), anchor: anchor_there, axis };
                bodies.push(Growing::new(link, Some((parent, hinge))));
                (bodies.len() - 1, Frame { origin: -(seen.rotation * anchor), ..seen })
            }
            (_, None) => {
                bodies.push(Growing::new(link, None));
                (bodies.len() - 1, seen)
            }
        };
        if bodies.len() > MAX_BODIES {
            return Err(foreign(
                link.element,
                format!("there are more than {MAX_BODIES} bodies: that many are allowed"),
            ));
        }
        if link.lumps.iter().any(|lump| lump.mass < 0.0) {
            return Err(foreign(link.element, "a negative mass: masses from 0 on are allowed"));
        }
        bodies[body].lumps.extend(link.lumps.iter().map(|lump| lump_in(lump, &frame)));
        bodies[body].solids.extend(link.solids.iter().map(|solid| solid_in(solid, &frame)));
        placed.push((body, frame));
    }
    let names: Vec<String> = bodies.iter().map(|b| b.name.clone()).collect();
    let parent_of = bodies.iter().map(|b| Some(b.hinge.as_ref()?.0)).collect();
    let robot = RobotSpec {
        name: name.to_owned(),
        description: format!("Imported from {format}. Gravity, friction and motors are those of the job."),
        pivot: names.first().cloned().unwrap_or_default(),
        failed: Vec::new(),
        variants: Default::default(),
        modules: Vec::new(),
        bodies: bodies.into_iter().map(|body| body.finish(&names)).collect::<Result<_, _>>()?,
    };
    Ok(Tree { robot, body_of: placed.iter().map(|p| p.0).collect(), parent_of })
}

fn lump_in(lump: &Lump, frame: &Frame) -> Lump {
    let inertia = if frame.rotation == UnitQuaternion::identity() {
        lump.inertia // to the bit
    } else {
        let turn: Matrix3<f64> = frame.rotation.to_rotation_matrix().into_inner();
        turn * lump.inertia * turn.transpose()
    };
    Lump { mass: lump.mass, center: frame.point(lump.center), inertia }
}

fn solid_in(solid: &Solid, frame: &Frame) -> Solid {
    match solid {
        Solid::Box { at, half } => {
            let at = Frame { rotation: frame.rotation * at.rotation, origin: frame.point(at.origin) };
            Solid::Box { at, half: *half }
        }
        Solid::Capsule { ends, radius } => Solid::Capsule { ends: ends.map(|end| frame.point(end)), radius: *radius },
    }
}

impl<'a> Growing<'a> {
    fn new(link: &Link<'a>, hinge: Option<(usize, Turning)>) -> Self {
        Self { element: link.element, name: link.name.clone(), hinge, lumps: Vec::new(), solids: Vec::new() }
    }

    fn finish(self, names: &[String]) -> Result<BodySpec, Invalid> {
        let Some(Lump { mass, center, inertia: i }) = Lump::joined(&self.lumps) else {
            return Err(foreign(self.element, "it has no mass: every body that moves needs some"));
        };
        let hinge = self.hinge.map(|(parent, Turning { name, anchor, axis })| HingeSpec {
            name,
            parent: names[parent].clone(),
            anchor: anchor.into(),
            axis: axis.into(),
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
        Ok(BodySpec { name: self.name, mass, center_of_mass: center.into(), inertia, hinge, boxes, capsules })
    }
}
