//! Robot file: modules docked to each other, or rigid bodies and hinges written out.

use crate::base::error::Invalid;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Robot as in its TOML file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotSpec {
    /// Name in messages, tables and file names.
    pub name: String,
    /// Description, with the assumptions made where the source gives no value.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// Part with the robot's pose: a module's name, or `module/part`; in a robot of bodies, the body without a hinge.
    pub pivot: String,
    /// Modules with all joints stuck at zero; in a robot of bodies, the stuck hinges.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<String>,
    /// Named sets of failed modules, such as E1 and E2 of the paper.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub variants: BTreeMap<String, Vec<String>>,
    /// Modules of the robot.
    #[serde(rename = "module", default, skip_serializing_if = "Vec::is_empty")]
    pub modules: Vec<ModuleSpec>,
    /// Bodies of the robot, instead of modules.
    #[serde(rename = "body", default, skip_serializing_if = "Vec::is_empty")]
    pub bodies: Vec<BodySpec>,
}

/// Rigid body in the neutral configuration, where the frames of all bodies have the robot's axes. The origin of a
/// body's frame is the anchor of its hinge. The origin of the pivot's body is the robot's own.
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
    /// Hinge that carries the body; the pivot's body has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hinge: Option<HingeSpec>,
    /// Collision boxes.
    #[serde(rename = "box", default, skip_serializing_if = "Vec::is_empty")]
    pub boxes: Vec<BoxSpec>,
    /// Collision capsules.
    #[serde(rename = "capsule", default, skip_serializing_if = "Vec::is_empty")]
    pub capsules: Vec<CapsuleSpec>,
}

/// Hinge between a body and its carrier.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HingeSpec {
    /// Name, unique among the hinges. It is the joint's name in genotypes and tables.
    pub name: String,
    /// Name of the carrying body.
    pub parent: String,
    /// A point of the axis in the carrying body's frame, mu.
    pub anchor: [f64; 3],
    /// Axis. The carried body turns about it counter-clockwise.
    pub axis: [f64; 3],
    /// Least and greatest angle, rad. Default: −90° and 90°.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<[f64; 2]>,
    /// Greatest rate of its target, rad/s. Default: no limit beside the controller's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed: Option<f64>,
    /// Greatest torque of its motor, kg·mu²/s². Default: the job's `max_torque`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub torque: Option<f64>,
}

/// Collision box of a body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoxSpec {
    /// Centre of the box, mu.
    #[serde(default)]
    pub center: [f64; 3],
    /// Rotation relative to the body's frame: a unit quaternion x, y, z, w.
    #[serde(default = "no_turn", skip_serializing_if = "is_no_turn")]
    pub rotation: [f64; 4],
    /// Half of its side lengths, mu.
    pub half: [f64; 3],
}

/// Collision capsule of a body: all points within a radius of a line.
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

/// Module: its kind and its place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModuleSpec {
    /// Name, unique in the robot.
    pub name: String,
    /// Kind of module, by its name in the registry: `cosmo`, `block`.
    pub kind: String,
    /// Attachment to another module. Exactly one module, the root, has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attach: Option<Attachment>,
    /// Pose of the root in the neutral configuration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose: Option<PoseSpec>,
}

/// Attachment of a module to a face of another module, with a turn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Attachment {
    /// Name of the carrying module.
    pub to: String,
    /// Face of the carrying module.
    #[serde(rename = "port")]
    pub face: String,
    /// Face of this module. Default: the first face of its kind.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub own: Option<String>,
    /// Turn about the face's axis, degrees: 0, 90, 180 or 270.
    #[serde(default)]
    pub turn: i32,
}

/// Pose in the neutral configuration.
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
    /// Returns the robot with a named set of its modules failed. The set's name is appended to the robot's name.
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
