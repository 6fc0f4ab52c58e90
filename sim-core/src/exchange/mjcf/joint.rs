//! Joints: the hinge of a body, and the free joint of the root.

use super::read::Reader;
use crate::base::error::Invalid;
use crate::exchange::source::{exactly, foreign, keyword, quarter_turns, tag, zero};
use crate::exchange::tree::{Frame, Turning};
use nalgebra::Vector3;
use roxmltree::Node;

/// Reason to refuse passive forces in joints.
const PASSIVE: &str = "joints have no passive forces, only the motors of a job";

/// Joint with its class and the frame around it.
pub(super) type Found<'a> = (Node<'a, 'a>, &'a str, Frame);

impl<'a> Reader<'a> {
    /// Reads the hinge among the joints of a body. The root has a free joint instead. A body without a joint is part of
    /// its parent.
    pub(super) fn hinge(&mut self, body: Node<'a, 'a>, joints: &[Found<'a>], root: bool) -> Option<Turning<'a>> {
        let &(joint, class, frame) = match joints {
            [] if root => {
                self.faults.add(foreign(body, "the root needs <freejoint/>: a robot must be free to move"));
                return None;
            }
            [] => return None,
            [joint] => joint,
            [_, (second, ..), ..] => {
                let reason = "a second joint of one body: only one hinge is allowed; put a body between them";
                self.faults.add(foreign(*second, reason));
                return None;
            }
        };
        let kind = match tag(joint) {
            "freejoint" => "free",
            _ => self.faults.take(self.defaults.get(joint, class, "type"))?.unwrap_or("hinge"),
        };
        match (kind, root) {
            ("free", true) | ("hinge", false) => {}
            (other, _) => {
                let allowed = if root { "the root needs a free joint" } else { "only hinge is allowed below the root" };
                self.faults.add(foreign(joint, format!("type = \"{other}\": {allowed}")));
                return None;
            }
        }
        if tag(joint) == "joint" {
            self.passive(joint, class);
        }
        if root {
            return None;
        }
        let limits = self.limits(joint, class);
        if let Some(limits) = self.faults.take(limits) {
            match limits {
                // Its servo may have limits.
                None => self.unlimited.push(joint),
                limits => drop(self.faults.take(quarter_turns(joint, limits))),
            }
        }
        let triple = |attribute: &str, default| {
            exactly::<3>(joint, attribute, self.defaults.get(joint, class, attribute)?.unwrap_or(default))
        };
        let (anchor, axis) = (triple("pos", "0 0 0"), triple("axis", "0 0 1"));
        let (anchor, axis) = (self.faults.take(anchor)?, self.faults.take(axis)?);
        let (mut anchor, mut axis) = (Vector3::from(anchor), Vector3::from(axis));
        if !frame.is_none() {
            (anchor, axis) = (frame.point(anchor), frame.rotation * axis);
        }
        Some(Turning { element: joint, name: joint.attribute("name").map(str::to_owned), anchor, axis })
    }

    /// Refuses springs, dampers, rotors and friction.
    fn passive(&mut self, joint: Node<'a, 'a>, class: &'a str) {
        for attribute in ["stiffness", "damping", "armature", "frictionloss", "springdamper"] {
            let given = self.defaults.get(joint, class, attribute);
            let none = given.and_then(|given| zero(joint, attribute, given, PASSIVE));
            self.faults.take(none);
        }
        let reference = self.defaults.get(joint, class, "ref");
        let why = "all joints are at 0 in the neutral configuration";
        let none = reference.and_then(|given| zero(joint, "ref", given, why));
        self.faults.take(none);
    }

    /// Returns the joint's range, rad, if it has limits.
    fn limits(&self, joint: Node<'a, 'a>, class: &'a str) -> Result<Option<[f64; 2]>, Invalid> {
        let range = self.defaults.get(joint, class, "range")?;
        let range = range.map(|text| exactly::<2>(joint, "range", text)).transpose()?;
        let limited = match self.defaults.get(joint, class, "limited")? {
            Some(text) => keyword(joint, "limited", text, &["true", "false", "auto"])?,
            None => "auto",
        };
        let limited = match limited {
            "auto" => self.compiler.autolimits && range.is_some(),
            other => other == "true",
        };
        Ok(range.filter(|_| limited).map(|range| range.map(|angle| self.compiler.radians(angle))))
    }
}
