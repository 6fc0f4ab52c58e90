//! Tables of a job file, each read by its component.

use super::{FinishSpec, PlanSpec, SimulateSpec};
use crate::control::GaitsSpec;
use crate::model::RobotSpec;
use crate::model::environment::Environment;
use crate::objective::FitnessSpec;
use crate::physics::PhysicsSpec;
use crate::plan::PlannerSpec;
use crate::search::OptimiserSpec;
use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::marker::PhantomData;

/// A job as written in its TOML file. It is *resolved* once it holds robot and environment in full and a value for
/// every setting.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JobSpec {
    /// Name in messages, tables and folder names. Not part of the job's identity.
    pub name: String,
    /// Free text. Not part of the job's identity.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub description: String,
    /// Seed of all random numbers, 0 to 2⁶³ − 1.
    #[serde(default = "one")]
    pub seed: u64,
    /// Name of a set of failed modules of the robot, such as "E1".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub variant: Option<String>,
    /// Name of the procedure, which defines the work on the other tables. Default: the registry's first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub procedure: Option<String>,
    /// Number, duration and controller of the gaits. Optional only for motions without gaits.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "as_itself")]
    pub gaits: Option<GaitsSpec>,
    /// Settings of tree growth.
    #[serde(default)]
    pub planner: PlannerSpec,
    /// Objective of a tree. Jobs that plan may leave it out: the default is the distance to the goal, or coverage if
    /// there is no goal.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "as_itself")]
    pub fitness: Option<FitnessSpec>,
    /// Search for candidates; in jobs that evolve.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "as_itself")]
    pub optimiser: Option<OptimiserSpec>,
    /// Given gaits and the number of trees grown with them; in jobs that plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<PlanSpec>,
    /// Given motion and its variation; in jobs that simulate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simulate: Option<SimulateSpec>,
    /// Engine and its setting.
    #[serde(default)]
    pub physics: PhysicsSpec,
    /// Choice of the winner after the search; in jobs that evolve.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "as_itself")]
    pub finish: Option<FinishSpec>,
    /// The environment: a built-in name, a path, or the table itself.
    pub environment: Reference<Environment>,
    /// The robot: a built-in name, a path, or the table itself.
    pub robot: Reference<RobotSpec>,
}

impl JobSpec {
    /// Returns the same job with gaits of this duration, s.
    pub fn lasting(mut self, duration: f64) -> Self {
        if let Some(gaits) = &mut self.gaits {
            gaits.duration = duration;
        }
        self
    }
}

/// Serialises a table without the mark of an option, so that a table that became optional keeps its digest.
fn as_itself<T: Serialize, S: Serializer>(table: &Option<T>, serializer: S) -> Result<S::Ok, S::Error> {
    match table {
        Some(table) => table.serialize(serializer),
        None => serializer.serialize_none(),
    }
}

/// A name or path, or the table itself.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Reference<T> {
    /// A built-in name, or a path to a file.
    Named(String),
    /// The table itself.
    Inline(Box<T>),
}

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Reference<T> {
    /// Written by hand, so that a mistake inside a table is reported as such.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either<T>(PhantomData<T>);

        impl<'de, T: Deserialize<'de>> Visitor<'de> for Either<T> {
            type Value = Reference<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a built-in name, a path to a file, or the table itself")
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

fn one() -> u64 {
    1
}
