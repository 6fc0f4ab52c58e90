//! Objectives: what a tree is worth (section IV-B of Vonásek and Faigl, 2016).

mod coverage;

pub use coverage::Grid;

use crate::base::error::{Invalid, only_settings_of};
use crate::base::score::Direction;
use crate::model::Place;
use crate::model::environment::Environment;
use crate::plan::Tree;
use serde::{Deserialize, Serialize};

/// A fitness, ready to score trees.
#[derive(Clone, Debug)]
pub enum Fitness {
    /// Percentage of the grid's cells that hold a node; maximised.
    Coverage(Grid),
    /// Least planar distance of a node to a goal, mu; minimised.
    Distance {
        /// mu.
        x: f64,
        /// mu.
        y: f64,
    },
}

impl Fitness {
    /// Refuses settings that no start makes usable. Cheap.
    pub fn validate(spec: &FitnessSpec, environment: &Environment) -> Result<(), Invalid> {
        match *spec {
            FitnessSpec::Coverage { cell, dimensions, height } => {
                Grid::counts(environment, cell, dimensions, height).map(|_| ())
            }
            FitnessSpec::Distance => goal_of(environment).map(|_| ()),
        }
    }

    /// The fitness of a job in its environment. `start`: height of the pivot at the start, mu.
    pub fn new(spec: &FitnessSpec, environment: &Environment, start: f64) -> Result<Self, Invalid> {
        match *spec {
            FitnessSpec::Coverage { cell, dimensions, height } => {
                Grid::new(environment, cell, dimensions, height, start).map(Self::Coverage)
            }
            FitnessSpec::Distance => goal_of(environment).map(|(x, y)| Self::Distance { x, y }),
        }
    }

    /// Whether larger or smaller is better.
    pub fn direction(spec: &FitnessSpec) -> Direction {
        match spec {
            FitnessSpec::Coverage { .. } => Direction::Maximise,
            FitnessSpec::Distance => Direction::Minimise,
        }
    }

    /// Name and unit.
    pub fn label(spec: &FitnessSpec) -> (&'static str, &'static str) {
        match spec {
            FitnessSpec::Coverage { .. } => ("coverage", "%"),
            FitnessSpec::Distance => ("distance to goal", "mu"),
        }
    }

    /// Least and greatest score that a tree can have.
    pub fn range(spec: &FitnessSpec) -> (f64, f64) {
        match spec {
            FitnessSpec::Coverage { .. } => (0.0, 100.0),
            FitnessSpec::Distance => (0.0, f64::MAX),
        }
    }

    /// The score of a tree.
    pub fn score(&self, tree: &Tree) -> f64 {
        match self {
            Self::Coverage(grid) => grid.coverage(tree),
            Self::Distance { x, y } => {
                let goal = Place { x: *x, y: *y, ..Place::ORIGIN };
                let nearest = tree.least(|p| p.planar_distance(&goal));
                tree.nodes[nearest].place.planar_distance(&goal)
            }
        }
    }
}

/// The goal that a distance is measured to.
fn goal_of(environment: &Environment) -> Result<(f64, f64), Invalid> {
    match &environment.goal {
        Some(goal) => Ok((goal.x, goal.y)),
        None => Err(Invalid::Conflict {
            field: "fitness.kind".into(),
            reason: format!(
                "distance needs a goal, and environment \"{}\" has none: add `goal = {{ x = …, y = … }}` to it",
                environment.name
            ),
        }),
    }
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
    /// Revision of how the fitness is computed. Coverage in three dimensions, 2: the cell that is not counted is that of the
    /// settled pivot, not the one on the ground below it.
    pub(crate) fn revision(&self) -> u32 {
        if matches!(self, Self::Coverage { dimensions: 3, .. }) { 2 } else { 1 }
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
