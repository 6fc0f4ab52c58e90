//! Objectives, which score trees (section IV-B of Vonásek and Faigl, 2016).

mod coverage;
mod distance;
mod path_length;
mod travel;

pub use coverage::{CELL, Coverage};
pub use distance::Distance;
pub use path_length::{PathLength, UNREACHED};
pub use travel::Travel;

use crate::base::error::Invalid;
use crate::base::registry::{Registered, Registry};
use crate::base::score::Direction;
use crate::base::settings::{Configurable, Settings, Table};
use crate::model::environment::Environment;
use crate::plan::Tree;
use std::fmt::Debug;

/// All objectives.
static OBJECTIVES: Registry<dyn ObjectiveKind> = Registry::new(&[&Coverage, &Distance, &PathLength, &Travel]);

/// An objective prepared for an environment, ready to score trees.
pub trait Objective: Debug + Send + Sync {
    /// Returns the score of a tree, in the kind's unit and range. `centers` gives the centre of mass of the robot at a
    /// node.
    fn score(&self, tree: &Tree, centers: &Centers<'_>) -> f64;
}

/// Centre of mass of the robot at a node of a tree, by the node's index: (x, y, z) in the map, mu.
pub type Centers<'a> = dyn Fn(usize) -> [f64; 3] + 'a;

/// A kind of objective, chosen by `kind` in the `[fitness]` table.
pub trait ObjectiveKind: Configurable {
    /// Returns the revision of the score's computation with these settings.
    fn revision_with(&self, _settings: &Settings) -> u32 {
        self.revision()
    }

    /// Refuses settings that are unusable for every start in the environment. Cheap. Ranges were checked before.
    fn validate(&self, settings: &Settings, environment: &Environment) -> Result<(), Invalid>;

    /// Returns the direction, which decides if larger or smaller scores are better.
    fn direction(&self) -> Direction;

    /// Returns name and unit of the score.
    fn label(&self) -> (&'static str, &'static str);

    /// Returns the least and greatest score that a tree can have.
    fn range(&self) -> (f64, f64);

    /// Prepares the objective for an environment, with settings that [`Self::validate`] accepts. `start` is the height
    /// of the pivot at the start, mu.
    ///
    /// # Errors
    /// If this start leaves nothing to score.
    fn prepare(
        &self,
        settings: &Settings,
        environment: &Environment,
        start: f64,
    ) -> Result<Box<dyn Objective>, Invalid>;
}

impl Registered for dyn ObjectiveKind {
    fn registry() -> &'static Registry<Self> {
        &OBJECTIVES
    }
}

/// The `[fitness]` table: an objective and its settings.
pub type FitnessSpec = Table<dyn ObjectiveKind>;

impl FitnessSpec {
    /// Returns the revision of the fitness's computation.
    pub(crate) fn revision(&self) -> u32 {
        self.kind.0.revision_with(&self.settings)
    }

    /// Refuses settings out of range, and settings that are unusable for every start in the environment. Cheap.
    pub fn validate(&self, environment: &Environment) -> Result<(), Invalid> {
        self.settings.check("fitness")?;
        self.kind.0.validate(&self.settings, environment)
    }
}
