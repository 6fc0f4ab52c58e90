//! The interface of planners.

use super::{Metric, Posture, Tree};
use crate::base::random::Stream;
use crate::base::registry::{Chosen, Component};
use crate::model::Place;
use std::fmt;

/// How a tree is grown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannerSettings {
    /// The planner.
    pub algorithm: Chosen<dyn PlannerKind>,
    /// K_max.
    pub iterations: u32,
    /// ϱ.
    pub metric: Metric,
    /// Width and height of the map that q_rand is drawn from, mu.
    pub map: [f64; 2],
    /// Ends the growth once a node is as near to (x, y) as the radius (x, y, radius; mu).
    pub stop_at: Option<(f64, f64, f64)>,
}

impl PlannerSettings {
    /// Starts the planner at a root. Everything random is drawn from `stream`.
    pub fn start(self, root: impl Into<Root>, stream: Stream) -> Box<dyn Planner> {
        self.algorithm.0.start(self, root.into(), stream)
    }
}

/// Where a tree begins.
#[derive(Clone, Debug, PartialEq)]
pub struct Root {
    /// The pivot's place.
    pub place: Place,
    /// Tilt and joint angles there.
    pub posture: Posture,
    /// Least and greatest angle of every joint, rad: what q_rand is drawn from.
    pub limits: Vec<[f64; 2]>,
}

impl From<Place> for Root {
    /// A root whose posture does not count.
    fn from(place: Place) -> Self {
        Self { place, posture: Posture::default(), limits: Vec::new() }
    }
}

/// Where a gait leads from a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Arrival {
    /// The robot gets here, and touches nothing on its way.
    Free(Place),
    /// It would get here, but touches an obstacle or leaves the map on its way.
    Blocked(Place),
    /// Nowhere: the rollout has no end.
    Lost,
}

impl Arrival {
    /// Where it may go.
    pub fn free(self) -> Option<Place> {
        match self {
            Self::Free(place) => Some(place),
            Self::Blocked(_) | Self::Lost => None,
        }
    }

    /// Where it would get, whatever is in the way.
    pub fn place(self) -> Option<Place> {
        match self {
            Self::Free(place) | Self::Blocked(place) => Some(place),
            Self::Lost => None,
        }
    }
}

/// What a planner needs next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ask {
    /// Where all gaits lead from this node.
    Expand(usize),
    /// Nothing: the tree is grown.
    Done,
}

/// A tree being grown. The planner asks, it does not call: [`Planner::ask`] says which node must be expanded with all
/// gaits next, and [`Planner::tell`] takes where they arrive. So many planners can be advanced side by side.
///
/// What it asks follows from its settings, root, stream, and what it was told: never from time or other planners.
pub trait Planner: fmt::Debug + Send {
    /// Runs iterations until one needs an expansion that was not told yet. Asked again before it is told, it gives the
    /// same answer. No node may be asked for twice once it was told. `ground` gives the pivot's height (mu) at a place
    /// (x, y; mu) of the map.
    fn ask(&mut self, ground: &dyn Fn(f64, f64) -> f64) -> Ask;

    /// Takes the robot's posture at each of the arrivals that are told next; only where the metric
    /// [weighs postures](Metric::weighs_postures).
    fn postures(&mut self, _postures: Vec<Posture>) {}

    /// Takes where each gait arrives from the node asked for. A node that is added to the tree has as its edge the node
    /// asked for, or one told before, and the index of a gait that is free to arrive there.
    ///
    /// # Panics
    /// If nothing was asked for.
    fn tell(&mut self, arrivals: Vec<Arrival>);

    /// The tree so far. Nodes are only ever added, at its end.
    fn tree(&self) -> &Tree;

    /// Whether the growth ended at the goal of [`PlannerSettings::stop_at`].
    fn at_goal(&self) -> bool;
}

/// A kind of planner, by its name in `[planner] algorithm`.
pub trait PlannerKind: Component {
    /// Starts a tree at a root. Everything random is drawn from `stream`.
    fn start(&self, settings: PlannerSettings, root: Root, stream: Stream) -> Box<dyn Planner>;
}
