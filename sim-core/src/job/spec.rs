//! The job file.

use super::FinishSpec;
use crate::environment::Environment;
use crate::error::only_settings_of;
use crate::optimise::OptimiserSpec;
use crate::robot::RobotSpec;
use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

/// A job as its TOML file says it; *resolved* once robot and environment stand in it in full and every setting is
/// written out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JobSpec {
    /// Name in messages, tables and folder names. Not part of the job's identity.
    pub name: String,
    /// Free text. Not part of the job's identity.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// The one number that all randomness follows from, 0 to 2⁶³ − 1.
    #[serde(default = "one")]
    pub seed: u64,
    /// A named set of failed modules of the robot, such as "E1".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub variant: Option<String>,
    /// What the gaits are.
    pub gaits: GaitsSpec,
    /// How a candidate's tree is grown.
    #[serde(default)]
    pub planner: PlannerSpec,
    /// What the tree is worth.
    pub fitness: FitnessSpec,
    /// How candidates are searched for.
    pub optimiser: OptimiserSpec,
    /// Where they move.
    #[serde(default)]
    pub physics: PhysicsSpec,
    /// What is done once the search is over.
    #[serde(default)]
    pub finish: FinishSpec,
    /// The environment: a name that ships, a path, or the table itself.
    pub environment: Reference<Environment>,
    /// The robot: a name that ships, a path, or the table itself.
    pub robot: Reference<RobotSpec>,
}

/// Something named, or something written out.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Reference<T> {
    /// A name that ships, or a path to a TOML file.
    Named(String),
    /// The thing itself.
    Inline(Box<T>),
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Reference<T> {
    /// By hand, so that a mistake inside a table is told as itself.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either<T>(PhantomData<T>);

        impl<'de, T: Deserialize<'de>> Visitor<'de> for Either<T> {
            type Value = Reference<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a name that ships, a path to a file, or the table itself")
            }

            fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<Self::Value, E> {
                Ok(Reference::Named(name.to_owned()))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
                T::deserialize(MapAccessDeserializer::new(map)).map(|table| Reference::Inline(Box::new(table)))
            }
        }

        deserializer.deserialize_any(Either(PhantomData))
    }
}

/// The `[gaits]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GaitsSpec {
    /// k, the number of gaits of a candidate.
    pub count: u32,
    /// τ, how long each is applied, s.
    #[serde(default = "paper_duration")]
    pub duration: f64,
    /// What generates the joint targets.
    #[serde(default)]
    pub controller: ControllerKind,
    /// Bounds of parameters that differ from the controller's own, by the parameter's name: `mu = [0.3, 1.3]`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub bounds: BTreeMap<String, (f64, f64)>,
}

/// The controllers there are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ControllerKind {
    /// A Hopf oscillator a joint, Eq. 2: six parameters a joint.
    #[default]
    Hopf,
    /// A sine a joint (section III): four parameters a joint.
    Sine,
}

/// The `[planner]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlannerSpec {
    /// Which of the two planners.
    pub algorithm: Algorithm,
    /// K_max, iterations.
    pub iterations: u32,
    /// w of the metric √(Δx² + Δy² (+ Δz²) + (w·Δyaw)²), mu/rad.
    pub yaw_weight: f64,
    /// How far joint angles (rad), tilt (rad) and height (mu) may differ for a transition to be reused. 0: every
    /// expansion is simulated.
    pub reuse_tolerance: f64,
    /// V, how many configurations of a local state transitions are simulated from. 1: always its first one.
    pub variants: u32,
    /// Trees a candidate; its fitness is their mean.
    pub repeats: u32,
    /// Rollouts that an evaluation may simulate for all of its trees; one that needs more has failed. Not given: as many
    /// as it can ever need.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_rollouts: Option<u64>,
}

impl Default for PlannerSpec {
    fn default() -> Self {
        Self {
            algorithm: Algorithm::FloodFill,
            iterations: 150,
            yaw_weight: 0.5,
            reuse_tolerance: 0.05,
            variants: 1,
            repeats: 1,
            max_rollouts: None,
        }
    }
}

/// How RRT-MP extends its tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Algorithm {
    /// Algorithm 1: every gait's new configuration is added unless it lies nearer to another node than to its parent.
    FloodFill,
    /// The original RRT-MP: of the new configurations, the one nearest to the random one is added.
    Original,
}

/// The `[fitness]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", try_from = "FitnessTable")]
pub enum FitnessSpec {
    /// Share of the map's cells that hold a node, percent. Maximised.
    Coverage {
        /// Side of a cell, mu.
        cell: f64,
        /// 2 counts squares of the map, 3 cubes of the space above it up to `height`.
        dimensions: u32,
        /// Height of the counted space in three dimensions, mu.
        #[serde(skip_serializing_if = "Option::is_none")]
        height: Option<f64>,
    },
    /// Least planar distance of a node's pivot to the goal, mu. Minimised.
    Distance,
}

impl FitnessSpec {
    /// Revision of how a fitness is computed, where it is not the first one: it enters the job's identity. Coverage in three
    /// dimensions, 2: the cell that is not counted is that of the settled pivot, not the one on the ground below it.
    pub(super) fn revision(&self) -> Option<u32> {
        matches!(self, Self::Coverage { dimensions: 3, .. }).then_some(2)
    }
}

/// The `[fitness]` table as it is read: the settings of all kinds side by side, so that a value of the wrong type is told
/// with its line.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FitnessTable {
    kind: FitnessKind,
    cell: Option<f64>,
    dimensions: Option<u32>,
    height: Option<f64>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum FitnessKind {
    Coverage,
    Distance,
}

impl TryFrom<FitnessTable> for FitnessSpec {
    type Error = String;

    fn try_from(table: FitnessTable) -> Result<Self, String> {
        const COVERAGE: &str = "coverage";
        let kind = match table.kind {
            FitnessKind::Coverage => COVERAGE,
            FitnessKind::Distance => "distance",
        };
        only_settings_of(
            kind,
            &[
                ("cell", table.cell.is_some(), &[COVERAGE]),
                ("dimensions", table.dimensions.is_some(), &[COVERAGE]),
                ("height", table.height.is_some(), &[COVERAGE]),
            ],
        )?;
        Ok(match table.kind {
            FitnessKind::Coverage => Self::Coverage {
                cell: table.cell.unwrap_or(2.0),
                dimensions: table.dimensions.unwrap_or(2),
                height: table.height,
            },
            FitnessKind::Distance => Self::Distance,
        })
    }
}

/// How big the robot is, which gravity in map units tells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scale {
    /// Modules of 1 m under 9.81 m/s², as in the paper's simulator.
    #[default]
    Paper,
    /// Modules of 0.105 m: 93.4 mu/s².
    Real,
}

/// The `[physics]` table. What is not given follows from the scale.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PhysicsSpec {
    /// The engine, or `auto`; in a resolved job the one that this became.
    pub engine: EngineChoice,
    /// How big the robot is.
    pub scale: Scale,
    /// How joints are held together, on rapier; the lockstep engine has reduced coordinates only.
    pub joints: JointKind,
    /// mu/s².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gravity: Option<f64>,
    /// Coulomb friction of everything.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Proportional gain of the joints' motors, kg·mu²/s² a rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stiffness: Option<f64>,
    /// Derivative gain of the joints' motors, kg·mu²/s a rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub damping: Option<f64>,
    /// Greatest torque of a motor, kg·mu²/s².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_torque: Option<f64>,
    /// Physics steps in a second of simulated time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps_per_second: Option<u32>,
    /// Solver iterations (substeps) of a step; on the lockstep engine, the times that a step linearises contacts and
    /// motors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub substeps: Option<u32>,
}

/// The engine that a job asks for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EngineChoice {
    /// Lockstep where its fidelity is known, else rapier.
    #[default]
    Auto,
    /// rapier.
    Rapier,
    /// Lockstep.
    Lockstep,
}

/// The physics engines there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EngineKind {
    /// rapier3d: any terrain.
    Rapier,
    /// Many rollouts side by side: flat ground, stairs, boxes.
    Lockstep,
}

impl EngineKind {
    /// As job files call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rapier => "rapier",
            Self::Lockstep => "lockstep",
        }
    }
}

impl fmt::Display for EngineKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl From<EngineKind> for EngineChoice {
    fn from(kind: EngineKind) -> Self {
        match kind {
            EngineKind::Rapier => Self::Rapier,
            EngineKind::Lockstep => Self::Lockstep,
        }
    }
}

/// How an engine holds the two bodies of a joint together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum JointKind {
    /// Every body moves by itself, and impulses pull the two of a joint together: cheap, and a little soft.
    #[default]
    Impulse,
    /// The robot moves in its joint angles (reduced coordinates), so that its joints can't come apart: a step costs several
    /// times as much.
    Multibody,
}

fn one() -> u64 {
    1
}
fn paper_duration() -> f64 {
    30.0
}
