//! Distance to a goal: how near a tree comes to it.

use super::{Objective, ObjectiveKind};
use crate::base::error::Invalid;
use crate::base::registry::Component;
use crate::base::score::Direction;
use crate::base::settings::{Configurable, Setting, Settings};
use crate::model::Place;
use crate::model::environment::Environment;
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
        goal_of(environment).map(|_| ())
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
        let (x, y) = goal_of(environment)?;
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
