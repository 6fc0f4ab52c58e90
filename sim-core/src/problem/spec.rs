//! The tables of a job file, each as its component reads it.

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

/// A job as in its TOML file; *resolved* once robot and environment stand in it in full and every setting is written
/// out.
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
    /// Name of the procedure: what is done with the problem that the rest describes. The registry's first unless given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub procedure: Option<String>,
    /// The gaits. Only motions without gaits can do without.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "as_itself")]
    pub gaits: Option<GaitsSpec>,
    /// Settings of the planner that grows a candidate's trees.
    #[serde(default)]
    pub planner: PlannerSpec,
    /// Score of a tree. Jobs that plan may omit it: the default is the distance to the goal, or coverage without a
    /// goal.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "as_itself")]
    pub fitness: Option<FitnessSpec>,
    /// Search for candidates; in jobs that evolve.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "as_itself")]
    pub optimiser: Option<OptimiserSpec>,
    /// Given gaits, and trees with them; in jobs that plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plan: Option<PlanSpec>,
    /// A given motion, and what varies; in jobs that simulate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub simulate: Option<SimulateSpec>,
    /// Physics of the motions.
    #[serde(default)]
    pub physics: PhysicsSpec,
    /// Finish after the search; in jobs that evolve.
    #[serde(default, skip_serializing_if = "Option::is_none", serialize_with = "as_itself")]
    pub finish: Option<FinishSpec>,
    /// The environment: a name that ships, a path, or the table itself.
    pub environment: Reference<Environment>,
    /// The robot: a name that ships, a path, or the table itself.
    pub robot: Reference<RobotSpec>,
}

impl JobSpec {
    /// The same job with gaits that take so long, s.
    pub fn lasting(mut self, duration: f64) -> Self {
        if let Some(gaits) = &mut self.gaits {
            gaits.duration = duration;
        }
        self
    }
}

/// Writes what is there without the mark of an option: a table that became optional keeps its digest.
fn as_itself<T: Serialize, S: Serializer>(table: &Option<T>, serializer: S) -> Result<S::Ok, S::Error> {
    match table {
        Some(table) => table.serialize(serializer),
        None => serializer.serialize_none(),
    }
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
    /// Written by hand, so that the error of a mistake inside a table stays as it is.
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

fn one() -> u64 {
    1
}
