//! Travel of the centre of mass (Yoshida et al. 2003, section 3.2 B: "traveling distance").

use super::{Centers, Objective, ObjectiveKind};
use crate::base::error::Invalid;
use crate::base::registry::Component;
use crate::base::score::Direction;
use crate::base::settings::{Configurable, Setting, Settings};
use crate::model::environment::Environment;
use crate::plan::Tree;

/// Greatest displacement of the centre of mass from the root to a node, mu: a weighted sum of the displacement along x
/// and along y, without their signs, and of the planar distance. Maximised. Without weights it is the planar distance.
/// With one gait and one iteration the tree has one edge, so this is the travel of one motion.
pub struct Travel;

impl Component for Travel {
    fn name(&self) -> &'static str {
        "travel"
    }
}

/// Weight of the displacement along x.
const X: Setting = Setting::optional_real("x", "").within(0.0, 1000.0);
/// Weight of the displacement along y.
const Y: Setting = Setting::optional_real("y", "").within(0.0, 1000.0);
/// Weight of the planar distance.
const TOTAL: Setting = Setting::optional_real("total", "").within(0.0, 1000.0);
const SETTINGS: [Setting; 3] = [X, Y, TOTAL];

impl Configurable for Travel {
    fn settings(&self) -> &'static [Setting] {
        &SETTINGS
    }
}

impl Travel {
    fn weights(settings: &Settings) -> Weights {
        match SETTINGS.map(|setting| settings.optional(&setting)) {
            [None, None, None] => Weights { x: 0.0, y: 0.0, total: 1.0 },
            weights => {
                let [x, y, total] = weights.map(Option::unwrap_or_default);
                Weights { x, y, total }
            }
        }
    }
}

impl ObjectiveKind for Travel {
    fn validate(&self, settings: &Settings, _: &Environment) -> Result<(), Invalid> {
        let Weights { x, y, total } = Self::weights(settings);
        if x + y + total > 0.0 {
            return Ok(());
        }
        let reason = "all weights are 0, so every candidate would score 0: give x, y or total a weight above 0";
        Err(Invalid::Conflict { field: "fitness".into(), reason: reason.into() })
    }

    fn direction(&self) -> Direction {
        Direction::Maximise
    }

    fn label(&self) -> (&'static str, &'static str) {
        ("travel", "mu")
    }

    fn range(&self) -> (f64, f64) {
        (0.0, f64::MAX)
    }

    fn prepare(&self, settings: &Settings, _: &Environment, _: f64) -> Result<Box<dyn Objective>, Invalid> {
        Ok(Box::new(Self::weights(settings)))
    }
}

/// Weights of the displacements.
#[derive(Debug)]
struct Weights {
    x: f64,
    y: f64,
    total: f64,
}

impl Objective for Weights {
    fn score(&self, tree: &Tree, centers: &Centers<'_>) -> f64 {
        let from = centers(0);
        let travel = |node: usize| {
            let to = centers(node);
            let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
            self.x * dx.abs() + self.y * dy.abs() + self.total * libm::hypot(dx, dy)
        };
        (1..tree.nodes.len()).map(travel).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Place;
    use crate::plan::Node;

    #[test]
    fn travel_is_greatest_weighted_displacement_of_mass_center() {
        let node = |edge| Node { place: Place::ORIGIN, edge };
        let tree = Tree { nodes: vec![node(None), node(Some((0, 0))), node(Some((1, 0)))] };
        let centers = |node: usize| [[1.0, 1.0, 0.5], [4.0, -3.0, 0.2], [1.0, 5.5, 0.9]][node];
        let score = |x: f64, y: f64, total: f64| Weights { x, y, total }.score(&tree, &centers);
        assert_eq!((score(1.0, 0.0, 0.0), score(0.0, 1.0, 0.0), score(0.0, 0.0, 1.0)), (3.0, 4.5, 5.0));
        assert_eq!(score(2.0, 1.0, 0.0), 10.0);
        let root = Tree { nodes: vec![node(None)] };
        assert_eq!(Weights { x: 1.0, y: 1.0, total: 1.0 }.score(&root, &centers), 0.0);
    }
}
