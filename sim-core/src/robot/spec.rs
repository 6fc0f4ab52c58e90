//! The robot file.

use crate::error::Invalid;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A robot as its TOML file says it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotSpec {
    /// Name in messages, tables and file names.
    pub name: String,
    /// What it is, and what was assumed where its source is silent.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// The part whose pose is the robot's pose: a module's name, or `module/part`.
    pub pivot: String,
    /// Modules whose joint is stuck at zero.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<String>,
    /// Named sets of failed modules, such as E1 and E2 of the paper.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub variants: BTreeMap<String, Vec<String>>,
    /// The modules.
    #[serde(rename = "module")]
    pub modules: Vec<ModuleSpec>,
}

/// A module: its kind and where it sits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModuleSpec {
    /// Name, unique in the robot.
    pub name: String,
    /// Kind of module: `cosmo`, `block`.
    pub kind: String,
    /// What it is attached to; exactly one module, the root, has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub attach: Option<Attachment>,
    /// Pose of the root in the neutral configuration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose: Option<PoseSpec>,
}

/// "Attached to port P of module M with rotation r."
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Attachment {
    /// The module that carries this one.
    pub to: String,
    /// That module's port.
    pub port: String,
    /// This module's own port; the kind's first unless given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub own: Option<String>,
    /// Turn about the port's axis, degrees: 0, 90, 180 or 270.
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
