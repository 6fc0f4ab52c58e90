//! Length of the path to a goal. Section IV-B of Vonásek and Faigl (2016) names this objective, and the reason why it
//! needs another measure while no path is found.

use super::distance::goal_of;
use super::{Centers, Objective, ObjectiveKind};
use crate::base::error::Invalid;
use crate::base::registry::Component;
use crate::base::score::Direction;
use crate::base::settings::{Configurable, Setting, Settings};
use crate::model::Place;
use crate::model::environment::{Environment, Goal};
use crate::plan::Tree;

/// Length of the tree's shortest path to a node within the goal's radius, mu: the sum of planar distances between the
/// pivots of consecutive nodes. Without a node in the radius, [`UNREACHED`] plus the least planar distance to the goal.
/// Minimised.
pub struct PathLength;

/// Offset of the score if no node reaches the goal, mu: more than any path length worth comparing.
pub const UNREACHED: f64 = 1e6;

impl Component for PathLength {
    fn name(&self) -> &'static str {
        "path-length"
    }
}

impl Configurable for PathLength {
    fn settings(&self) -> &'static [Setting] {
        &[]
    }
}

impl ObjectiveKind for PathLength {
    fn validate(&self, _: &Settings, environment: &Environment) -> Result<(), Invalid> {
        goal_of("path-length", environment).map(|_| ())
    }

    fn direction(&self) -> Direction {
        Direction::Minimise
    }

    fn label(&self) -> (&'static str, &'static str) {
        ("path length", "mu")
    }

    fn range(&self) -> (f64, f64) {
        (0.0, f64::MAX)
    }

    fn prepare(&self, _: &Settings, environment: &Environment, _: f64) -> Result<Box<dyn Objective>, Invalid> {
        Ok(Box::new(ToGoal(goal_of("path-length", environment)?)))
    }
}

/// Goal that a tree must reach.
#[derive(Debug)]
struct ToGoal(Goal);

impl Objective for ToGoal {
    fn score(&self, tree: &Tree, _: &Centers<'_>) -> f64 {
        let goal = Place { x: self.0.x, y: self.0.y, ..Place::ORIGIN };
        // A child comes after its parent.
        let mut lengths: Vec<f64> = Vec::with_capacity(tree.nodes.len());
        let (mut shortest, mut nearest) = (f64::INFINITY, f64::INFINITY);
        for node in &tree.nodes {
            let length = node
                .edge
                .map_or(0.0, |(parent, _)| lengths[parent] + node.place.planar_distance(&tree.nodes[parent].place));
            lengths.push(length);
            let distance = node.place.planar_distance(&goal);
            nearest = nearest.min(distance);
            if distance <= self.0.radius {
                shortest = shortest.min(length);
            }
        }
        if shortest.is_finite() { shortest } else { UNREACHED + nearest }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Node;

    fn node(x: f64, y: f64, edge: Option<(usize, usize)>) -> Node {
        Node { place: Place { x, y, ..Place::ORIGIN }, edge }
    }

    #[test]
    fn shortest_path_counts_unless_goal_is_unreached() {
        let score = |radius: f64, tree: &Tree| ToGoal(Goal::at(4.0, 3.0, radius)).score(tree, &|_| [0.0; 3]);
        let around = vec![
            node(0.0, 0.0, None),
            node(4.0, 0.0, Some((0, 0))),
            node(4.0, 3.0, Some((1, 1))),
            node(2.0, 1.5, Some((0, 2))),
            node(4.0, 3.5, Some((3, 0))),
        ];
        let tree = Tree { nodes: around };
        assert_eq!(score(0.25, &tree), 7.0);
        let straight = 2.5 + 8.0f64.sqrt();
        assert!((score(0.5, &tree) - straight).abs() < 1e-12, "the second path also ends within 0.5 mu");
        assert_eq!(score(0.25, &Tree::new(Place::ORIGIN)), UNREACHED + 5.0);
        assert_eq!(score(5.0, &Tree::new(Place::ORIGIN)), 0.0);
    }
}
