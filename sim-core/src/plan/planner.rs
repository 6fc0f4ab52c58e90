//! Interface of planners.

use super::{Metric, Posture, Tree};
use crate::base::random::Stream;
use crate::base::registry::{Chosen, Component};
use crate::model::Place;
use std::fmt;

/// Settings of a tree's growth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannerSettings {
    /// Kind of planner.
    pub algorithm: Chosen<dyn PlannerKind>,
    /// K_max, the number of iterations.
    pub iterations: u32,
    /// ϱ, the metric.
    pub metric: Metric,
    /// Width and height of the map from which q_rand is drawn, mu.
    pub map: [f64; 2],
    /// Goal (x, y, radius; mu). Growth ends once a node is within the radius of (x, y).
    pub stop_at: Option<(f64, f64, f64)>,
}

impl PlannerSettings {
    /// Starts the planner at a root. All random numbers are drawn from `stream`.
    pub fn start(self, root: impl Into<Root>, stream: Stream) -> Box<dyn Planner> {
        self.algorithm.0.start(self, root.into(), stream)
    }
}

/// Root of a tree.
#[derive(Clone, Debug, PartialEq)]
pub struct Root {
    /// The pivot's place.
    pub place: Place,
    /// Tilt and joint angles at the root.
    pub posture: Posture,
    /// Least and greatest angle of every joint, rad. The joint angles of q_rand are drawn between them.
    pub limits: Vec<[f64; 2]>,
}

impl From<Place> for Root {
    /// Makes a root without a posture, for a metric that does not weigh postures.
    fn from(place: Place) -> Self {
        Self { place, posture: Posture::default(), limits: Vec::new() }
    }
}

/// Outcome of executing a gait from a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Arrival {
    /// The robot arrives at this place; it neither touches an obstacle nor leaves the map on its way.
    Free(Place),
    /// The robot would arrive at this place, but touches an obstacle or leaves the map on its way.
    Blocked(Place),
    /// The rollout did not complete, so it has no end.
    Lost,
}

impl Arrival {
    /// Returns the place if the way there is free.
    pub fn free(self) -> Option<Place> {
        match self {
            Self::Free(place) => Some(place),
            Self::Blocked(_) | Self::Lost => None,
        }
    }

    /// Returns the place, also if the way there is blocked.
    pub fn place(self) -> Option<Place> {
        match self {
            Self::Free(place) | Self::Blocked(place) => Some(place),
            Self::Lost => None,
        }
    }
}

/// Next request of a planner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ask {
    /// The arrivals of all gaits from this node are needed.
    Expand(usize),
    /// The tree is complete.
    Done,
}

/// A tree being grown, with an ask–tell interface. [`Planner::ask`] returns the node to expand next with all gaits, and
/// [`Planner::tell`] receives the arrivals. A planner runs no rollouts itself, so many planners can be advanced side by
/// side.
///
/// Its requests depend only on its settings, root, stream and the arrivals it has received, never on time or on other
/// planners.
pub trait Planner: fmt::Debug + Send {
    /// Runs iterations until one needs an expansion whose arrivals are not known yet. Repeated calls before
    /// [`Planner::tell`] return the same request. A node whose arrivals were received must not be requested again.
    /// `ground` returns the pivot's height (mu) at a place (x, y; mu) of the map.
    fn ask(&mut self, ground: &dyn Fn(f64, f64) -> f64) -> Ask;

    /// Receives the robot's posture at each arrival of the next [`Planner::tell`]. Called only if the metric [weighs
    /// postures](Metric::weighs_postures).
    fn postures(&mut self, _postures: Vec<Posture>) {}

    /// Receives the arrival of each gait from the requested node. The edge of a node that is added has the requested
    /// node, or one expanded before, and the index of a gait whose arrival there is free.
    ///
    /// # Panics
    /// If no request is pending.
    fn tell(&mut self, arrivals: Vec<Arrival>);

    /// Returns the tree so far. Nodes are only appended.
    fn tree(&self) -> &Tree;

    /// Returns true if the growth ended at the goal of [`PlannerSettings::stop_at`].
    fn at_goal(&self) -> bool;
}

/// Kind of planner, selected by its name in `[planner] algorithm`.
pub trait PlannerKind: Component {
    /// Starts a tree at a root. All random numbers are drawn from `stream`.
    fn start(&self, settings: PlannerSettings, root: Root, stream: Stream) -> Box<dyn Planner>;
}
