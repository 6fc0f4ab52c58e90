//! Distance objective: the least distance of a tree's nodes to the goal.

use super::{Centers, Objective, ObjectiveKind};
use crate::base::error::Invalid;
use crate::base::registry::Component;
use crate::base::score::Direction;
use crate::base::settings::{Configurable, Setting, Settings};
use crate::model::Place;
use crate::model::environment::{Environment, Goal};
use crate::plan::{Metric, Tree};

/// Least distance of a node's pivot to the environment's goal, mu. Minimised. The distance is planar. `yaw_weight` and
/// `z_weight` add heading and height as in the planners' metric, for goals that have them.
pub struct Distance;

impl Component for Distance {
    fn name(&self) -> &'static str {
        "distance"
    }
}

/// Weight of the heading, w, mu/rad.
const YAW_WEIGHT: Setting = Setting::optional_real("yaw_weight", "mu/rad").within(0.0, 1000.0);
/// Weight of the height.
const Z_WEIGHT: Setting = Setting::optional_real("z_weight", "").within(0.0, 1000.0);
const SETTINGS: [Setting; 2] = [YAW_WEIGHT, Z_WEIGHT];

impl Configurable for Distance {
    fn settings(&self) -> &'static [Setting] {
        &SETTINGS
    }
}

impl ObjectiveKind for Distance {
    fn validate(&self, settings: &Settings, environment: &Environment) -> Result<(), Invalid> {
        let goal = goal_of("distance", environment)?;
        for (setting, coordinate, there) in [(&YAW_WEIGHT, "yaw", goal.yaw), (&Z_WEIGHT, "z", goal.z)] {
            if settings.optional(setting).is_some() && there.is_none() {
                let reason =
                    format!("the goal of environment \"{}\" has no {coordinate}: add one to it", environment.name);
                return Err(Invalid::Conflict { field: format!("fitness.{}", setting.name), reason });
            }
        }
        Ok(())
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

    fn prepare(&self, settings: &Settings, environment: &Environment, _: f64) -> Result<Box<dyn Objective>, Invalid> {
        let Goal { x, y, z, yaw, .. } = goal_of("distance", environment)?;
        let weight = |setting| settings.optional(setting).unwrap_or(0.0);
        Ok(Box::new(ToGoal {
            place: Place { x, y, z: z.unwrap_or(0.0), yaw: yaw.unwrap_or(0.0) },
            metric: Metric { yaw_weight: weight(&YAW_WEIGHT), z: weight(&Z_WEIGHT), ..Metric::default() },
        }))
    }
}

/// Goal, and the metric for the distance to it.
#[derive(Debug)]
struct ToGoal {
    place: Place,
    metric: Metric,
}

impl Objective for ToGoal {
    fn score(&self, tree: &Tree, _: &Centers<'_>) -> f64 {
        let distance = |place: &Place| self.metric.squared(place, &self.place).sqrt();
        distance(&tree.nodes[tree.least(distance)].place)
    }
}

/// Returns the environment's goal, or the error that an objective of this kind needs one.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Node;

    #[test]
    fn distance_is_planar_unless_heading_or_height_has_weight() {
        let at = |x: f64, z: f64, yaw: f64| Node { place: Place { x, y: 4.0, z, yaw }, edge: None };
        let tree = Tree { nodes: vec![at(3.0, 1.0, 0.0), at(3.5, 0.0, 2.0)] };
        let score = |yaw_weight: f64, z: f64| {
            let place = Place { x: 0.0, y: 0.0, z: 0.0, yaw: 2.0 };
            ToGoal { place, metric: Metric { yaw_weight, z, ..Metric::default() } }.score(&tree, &|_| [0.0; 3])
        };
        assert_eq!(score(0.0, 0.0), 5.0);
        let second = (3.5f64 * 3.5 + 16.0).sqrt();
        assert_eq!(
            (score(2.0, 0.0), score(0.0, 3.0)),
            (second, second),
            "the second node has the goal's heading and height"
        );
    }
}
