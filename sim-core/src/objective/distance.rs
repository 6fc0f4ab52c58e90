//! Distance to a goal: how near a tree comes to it.

use super::{Objective, ObjectiveKind};
use crate::base::error::Invalid;
use crate::base::registry::Component;
use crate::base::score::Direction;
use crate::base::settings::{Configurable, Setting, Settings};
use crate::model::Place;
use crate::model::environment::{Environment, Goal};
use crate::plan::Tree;

/// Least planar distance of a node's pivot to the environment's goal, mu. Minimised.
pub struct Distance;

impl Component for Distance {
    fn name(&self) -> &'static str {
        "distance"
    }
}

impl Configurable for Distance {
    fn settings(&self) -> &'static [Setting] {
        &[]
    }
}

impl ObjectiveKind for Distance {
    fn validate(&self, _: &Settings, environment: &Environment) -> Result<(), Invalid> {
        goal_of("distance", environment).map(|_| ())
    }

    fn direction(&self) -> Direction {
        Direction::Minimise
    }

    fn label(&self) -> (&'static str, &'static str) {
        ("distance to goal", "mu")
    }

    fn range(&self) -> (f64, f64) {
        (0.0, f64::MAX)
    }

    fn prepare(&self, _: &Settings, environment: &Environment, _: f64) -> Result<Box<dyn Objective>, Invalid> {
        let Goal { x, y, .. } = goal_of("distance", environment)?;
        Ok(Box::new(ToGoal(Place { x, y, ..Place::ORIGIN })))
    }
}

/// The goal.
#[derive(Debug)]
struct ToGoal(Place);

impl Objective for ToGoal {
    fn score(&self, tree: &Tree) -> f64 {
        let nearest = tree.least(|place| place.planar_distance(&self.0));
        tree.nodes[nearest].place.planar_distance(&self.0)
    }
}

/// The goal that an objective of this kind looks at.
pub(super) fn goal_of(kind: &str, environment: &Environment) -> Result<Goal, Invalid> {
    match environment.goal {
        Some(goal) => Ok(goal),
        None => Err(Invalid::Conflict {
            field: "fitness.kind".into(),
            reason: format!(
                "{kind} needs a goal, and environment \"{}\" has none: add `goal = {{ x = …, y = … }}` to it",
                environment.name
            ),
        }),
    }
}
