//! RRT-MP: a tree grown with gaits as motion primitives. Algorithm 1 of Vonásek and Faigl (2016), the original planner that
//! it modifies (section IV-A), and a variant of that.
//!
//! How silences are read: q_rand is uniform in x, y and yaw; in line 8, q' is the nearest neighbour other than q_near
//! (with q_near included line 9 could never hold), infinitely far if there is none, and siblings added before count. An
//! iteration that picks a node already expanded counts and adds nothing.

use super::{Arrival, Ask, Nearest, Planner, PlannerKind, PlannerSettings, Tree};
use crate::base::random::Stream;
use crate::base::registry::Component;
use crate::model::Place;
use std::f64::consts::PI;

/// Flood-fill, Algorithm 1: every gait's new configuration is added unless it lies nearer to another node than to its
/// parent.
pub(super) static FLOOD_FILL: RrtMpKind =
    RrtMpKind { name: "flood-fill", revision: 1, extension: Extension::FloodFill };

/// The original RRT-MP as printed: of all new configurations the one nearest to the random one is chosen, and added if the
/// robot touches nothing on its way there. Revision 1 was what is [`NEAREST_VALID`] now.
pub(super) static ORIGINAL: RrtMpKind =
    RrtMpKind { name: "original", revision: 2, extension: Extension::Nearest(Arrival::place) };

/// The original RRT-MP with its two steps the other way round: of the new configurations that the robot gets to without
/// touching anything, the one nearest to the random one is added.
pub(super) static NEAREST_VALID: RrtMpKind =
    RrtMpKind { name: "nearest-valid", revision: 1, extension: Extension::Nearest(Arrival::free) };

/// One of these planners.
pub(super) struct RrtMpKind {
    name: &'static str,
    revision: u32,
    extension: Extension,
}

/// How RRT-MP extends its tree.
#[derive(Clone, Copy, Debug)]
enum Extension {
    FloodFill,
    /// One of the arrivals is chosen, among those that have such a place.
    Nearest(fn(Arrival) -> Option<Place>),
}

impl Component for RrtMpKind {
    fn name(&self) -> &'static str {
        self.name
    }

    fn revision(&self) -> u32 {
        self.revision
    }
}

impl PlannerKind for RrtMpKind {
    fn start(&self, settings: PlannerSettings, root: Place, stream: Stream) -> Box<dyn Planner> {
        Box::new(RrtMp::new(self.extension, settings, root, stream))
    }
}

/// A tree being grown.
#[derive(Debug)]
struct RrtMp {
    extension: Extension,
    settings: PlannerSettings,
    tree: Tree,
    nearest: Nearest,
    stream: Stream,
    iteration: u32,
    /// Where the gaits lead from every expanded node. Never asked for twice.
    arrivals: Vec<Option<Vec<Reached>>>,
    /// An expansion that was asked for: q_rand and the node.
    pending: Option<(Place, usize)>,
    at_goal: bool,
}

/// Where a gait leads from an expanded node.
#[derive(Clone, Copy, Debug)]
struct Reached {
    arrival: Arrival,
    /// It is a node of the tree.
    added: bool,
}

impl RrtMp {
    /// Starts at a root; q_rand is drawn from `stream`.
    fn new(extension: Extension, settings: PlannerSettings, root: Place, stream: Stream) -> Self {
        let mut rrt = Self {
            extension,
            settings,
            tree: Tree { nodes: Vec::new() },
            nearest: Nearest::new(settings.metric),
            stream,
            iteration: 0,
            arrivals: Vec::new(),
            pending: None,
            at_goal: false,
        };
        rrt.add(root, None);
        rrt
    }

    /// Lines 6 to 11 of Algorithm 1.
    fn flood(&mut self, near: usize) {
        for gait in 0..self.arrivals[near].as_ref().map_or(0, Vec::len) {
            let Some(new) = self.arrival(near, gait).and_then(Arrival::free) else { continue };
            let to_parent = self.settings.metric.squared(&new, &self.tree.nodes[near].place);
            let to_others = self.nearest.nearest(&new, Some(near)).map_or(f64::INFINITY, |(_, d)| d);
            if to_others > to_parent {
                self.add_arrival(new, near, gait);
            }
        }
    }

    /// The original planner: of the candidates among the configurations reachable from q_near, the nearest to q_rand is
    /// added, unless the way there is blocked or it is in the tree already.
    fn extend(&mut self, random: Place, near: usize, candidate: fn(Arrival) -> Option<Place>) {
        let mut best: Option<(f64, usize, Reached)> = None;
        for (gait, &reached) in self.arrivals[near].iter().flatten().enumerate() {
            let Some(new) = candidate(reached.arrival) else { continue };
            let distance = self.settings.metric.squared(&new, &random);
            if best.is_none_or(|b| distance < b.0) {
                best = Some((distance, gait, reached));
            }
        }
        if let Some((_, gait, Reached { arrival: Arrival::Free(new), added: false })) = best {
            self.add_arrival(new, near, gait);
        }
    }

    fn arrival(&self, near: usize, gait: usize) -> Option<Arrival> {
        Some(self.arrivals[near].as_ref()?.get(gait)?.arrival)
    }

    fn add_arrival(&mut self, new: Place, near: usize, gait: usize) {
        if let Some(arrival) = self.arrivals[near].as_mut().and_then(|a| a.get_mut(gait)) {
            arrival.added = true;
        }
        self.add(new, Some((near, gait)));
    }

    fn add(&mut self, place: Place, edge: Option<(usize, usize)>) {
        self.tree.nodes.push(super::Node { place, edge });
        self.nearest.add(place);
        self.arrivals.push(None);
        if let Some((x, y, radius)) = self.settings.stop_at {
            let goal = Place { x, y, ..place };
            self.at_goal |= place.planar_distance(&goal) <= radius;
        }
    }

    fn random_place(&mut self, ground: &dyn Fn(f64, f64) -> f64) -> Place {
        let [width, height] = self.settings.map;
        let x = self.stream.uniform(-width / 2.0, width / 2.0);
        let y = self.stream.uniform(-height / 2.0, height / 2.0);
        Place { x, y, z: ground(x, y), yaw: self.stream.uniform(-PI, PI) }
    }
}

impl Planner for RrtMp {
    /// `ground` is for q_rand; it counts only if the metric looks at height.
    fn ask(&mut self, ground: &dyn Fn(f64, f64) -> f64) -> Ask {
        loop {
            if let Some((_, node)) = self.pending {
                return Ask::Expand(node);
            }
            if self.at_goal || self.iteration == self.settings.iterations {
                return Ask::Done;
            }
            self.iteration += 1;
            let random = self.random_place(ground);
            let Some((near, _)) = self.nearest.nearest(&random, None) else { return Ask::Done };
            match (&self.arrivals[near], self.extension) {
                (None, _) => self.pending = Some((random, near)),
                (Some(_), Extension::FloodFill) => {}
                (Some(_), Extension::Nearest(candidate)) => self.extend(random, near, candidate),
            }
        }
    }

    fn tell(&mut self, arrivals: Vec<Arrival>) {
        let (random, near) = self.pending.take().expect("only what was asked for can be told");
        let reached = |arrival| Reached { arrival, added: false };
        self.arrivals[near] = Some(arrivals.into_iter().map(reached).collect());
        match self.extension {
            Extension::FloodFill => self.flood(near),
            Extension::Nearest(candidate) => self.extend(random, near, candidate),
        }
    }

    fn tree(&self) -> &Tree {
        &self.tree
    }

    fn at_goal(&self) -> bool {
        self.at_goal
    }
}
