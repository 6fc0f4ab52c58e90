//! The robot file: modules docked to each other, or rigid bodies and hinges written out.

use crate::base::error::Invalid;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A robot as in its TOML file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotSpec {
    /// Name in messages, tables and file names.
    pub name: String,
    /// Description, with the assumptions made where the source is silent.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// The part with the robot's pose: a module's name, or `module/part`; of bodies the one without a hinge.
    pub pivot: String,
    /// Modules with all joints stuck at zero; of bodies the stuck hinges.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<String>,
    /// Named sets of failed modules, such as E1 and E2 of the paper.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub variants: BTreeMap<String, Vec<String>>,
    /// The modules.
    #[serde(rename = "module", default, skip_serializing_if = "Vec::is_empty")]
    pub modules: Vec<ModuleSpec>,
    /// Instead of modules: the bodies.
    #[serde(rename = "body", default, skip_serializing_if = "Vec::is_empty")]
    pub bodies: Vec<BodySpec>,
}

/// A rigid body in the neutral configuration, where the frames of all bodies have the robot's axes. The origin of a
/// body's frame is the anchor of its hinge; that of the pivot's is the robot's own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodySpec {
    /// Name, unique among the bodies.
    pub name: String,
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass, mu.
    #[serde(default)]
    pub center_of_mass: [f64; 3],
    /// Inertia about the centre of mass, kg·mu²: xx, yy, zz, xy, xz, yz.
    pub inertia: [f64; 6],
    /// The hinge that carries it; the pivot's body has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hinge: Option<HingeSpec>,
    /// Boxes that collide.
    #[serde(rename = "box", default, skip_serializing_if = "Vec::is_empty")]
    pub boxes: Vec<BoxSpec>,
    /// Capsules that collide.
    #[serde(rename = "capsule", default, skip_serializing_if = "Vec::is_empty")]
    pub capsules: Vec<CapsuleSpec>,
}

/// A hinge between a body and the one that carries it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HingeSpec {
    /// Name, unique among the hinges: its joint's in genotypes and tables.
    pub name: String,
    /// Name of the body that carries.
    pub parent: String,
    /// A point of the axis in the carrying body's frame, mu.
    pub anchor: [f64; 3],
    /// The axis; the carried body turns about it counter-clockwise.
    pub axis: [f64; 3],
    /// Least and greatest angle, rad; −90° and 90° unless given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<[f64; 2]>,
    /// Greatest rate of its target, rad/s; as fast as the controller says unless given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<f64>,
    /// Greatest torque of its motor, kg·mu²/s²; that of the job unless given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub torque: Option<f64>,
}

/// A box of a body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoxSpec {
    /// Its centre, mu.
    #[serde(default)]
    pub center: [f64; 3],
    /// Its turn against the body's frame: a unit quaternion x, y, z, w.
    #[serde(default = "no_turn", skip_serializing_if = "is_no_turn")]
    pub rotation: [f64; 4],
    /// Half of its sides, mu.
    pub half: [f64; 3],
}

/// A capsule of a body: all within a radius of a line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CapsuleSpec {
    /// One end of the line, mu.
    pub from: [f64; 3],
    /// The other end, mu.
    pub to: [f64; 3],
    /// Radius, mu.
    pub radius: f64,
}

fn no_turn() -> [f64; 4] {
    [0.0, 0.0, 0.0, 1.0]
}

fn is_no_turn(rotation: &[f64; 4]) -> bool {
    *rotation == no_turn()
}

/// A module: its kind and where it sits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModuleSpec {
    /// Name, unique in the robot.
    pub name: String,
    /// Kind of module, by its name in the registry: `cosmo`, `block`.
    pub kind: String,
    /// The place where it is attached; exactly one module, the root, has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attach: Option<Attachment>,
    /// Pose of the root in the neutral configuration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose: Option<PoseSpec>,
}

/// "Attached to face F of module M with rotation r."
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Attachment {
    /// The module that carries this one.
    pub to: String,
    /// That module's face.
    #[serde(rename = "port")]
    pub face: String,
    /// This module's own face; the kind's first unless given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub own: Option<String>,
    /// Turn about the face's axis, degrees: 0, 90, 180 or 270.
    #[serde(default)]
    pub turn: i32,
}

/// A pose in the neutral configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseSpec {
    /// x, y, z of the module's centre, mu.
    #[serde(default)]
    pub position: [f64; 3],
    /// Rotation about the module's own x, then y, then z axis, degrees.
    #[serde(default)]
    pub rotation: [f64; 3],
}

impl RobotSpec {
    /// The robot with a named set of its modules failed; named after it.
    pub fn variant(&self, variant: &str) -> Result<RobotSpec, Invalid> {
        let failed = self.variants.get(variant).ok_or_else(|| Invalid::Unknown {
            field: "variant".into(),
            value: variant.to_owned(),
            known: self.variants.keys().cloned().collect(),
        })?;
        let mut robot = self.clone();
        robot.name = format!("{}-{variant}", self.name);
        robot.failed.extend(failed.iter().filter(|f| !self.failed.contains(f)).cloned());
        Ok(robot)
    }
}
