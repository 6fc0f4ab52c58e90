//! RRT-MP: a tree grown with gaits as motion primitives. There are three variants: Algorithm 1 of Vonásek and Faigl
//! (2016), the original planner that it modifies (section IV-A), and a variant of the original.
//!
//! Choices that the paper leaves open: q_rand is uniform in x, y and yaw, and in tilt and joint angles if the metric
//! weighs them. In line 8, q' is the nearest neighbour other than q_near, since with q_near the condition of line 9
//! could never hold. q' is infinitely far if there is no other node; siblings added before count. In Algorithm 1, an
//! iteration that picks a node already expanded counts and adds no node.

use super::{Arrival, Ask, Nearest, Planner, PlannerKind, PlannerSettings, Posture, Root, Tree};
use crate::base::random::Stream;
use crate::base::registry::Component;
use crate::model::Place;
use std::f64::consts::PI;

/// Flood-fill, Algorithm 1: adds every gait's new configuration that is nearer to its parent than to any other node.
pub(super) static FLOOD_FILL: RrtMpKind =
    RrtMpKind { name: "flood-fill", revision: 1, extension: Extension::FloodFill };

/// The original RRT-MP as printed: chooses the new configuration nearest to the random one, and adds it if the robot
/// touches no obstacle on its way there. Revision 1 was the algorithm that is now [`NEAREST_VALID`].
pub(super) static ORIGINAL: RrtMpKind =
    RrtMpKind { name: "original", revision: 2, extension: Extension::Nearest(Arrival::place) };

/// The original RRT-MP with its two steps exchanged: of the new configurations that the robot reaches without touching
/// an obstacle, adds the one nearest to the random one.
pub(super) static NEAREST_VALID: RrtMpKind =
    RrtMpKind { name: "nearest-valid", revision: 1, extension: Extension::Nearest(Arrival::free) };

/// A variant of RRT-MP.
pub(super) struct RrtMpKind {
    name: &'static str,
    revision: u32,
    extension: Extension,
}

/// Rule by which RRT-MP extends its tree.
#[derive(Clone, Copy, Debug)]
enum Extension {
    FloodFill,
    /// Chooses one of the arrivals for which this function returns a place.
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
    fn start(&self, settings: PlannerSettings, root: Root, stream: Stream) -> Box<dyn Planner> {
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
    /// Arrivals of all gaits, by node; `None` for a node that is not expanded. No node is requested twice.
    arrivals: Vec<Option<Vec<Reached>>>,
    /// The pending request: q_rand and the node to expand.
    pending: Option<(Random, usize)>,
    /// Postures; `None` if the metric does not weigh them.
    postures: Option<Postures>,
    at_goal: bool,
}

/// The random configuration q_rand.
#[derive(Clone, Debug)]
struct Random {
    place: Place,
    posture: Posture,
}

/// Postures of nodes and arrivals.
#[derive(Debug)]
struct Postures {
    /// Least and greatest angle of every joint, rad.
    limits: Vec<[f64; 2]>,
    /// Posture of each node.
    nodes: Vec<Posture>,
    /// Postures of the arrivals of all gaits, by node; empty for a node that is not expanded.
    arrivals: Vec<Vec<Posture>>,
    /// Postures of the arrivals that the next `tell` receives.
    told: Vec<Posture>,
}

/// Arrival of a gait from an expanded node.
#[derive(Clone, Copy, Debug)]
struct Reached {
    arrival: Arrival,
    /// True if the arrival is a node of the tree.
    added: bool,
}

impl RrtMp {
    /// Starts a tree at a root; q_rand is drawn from `stream`.
    fn new(extension: Extension, settings: PlannerSettings, root: Root, stream: Stream) -> Self {
        let Root { place, posture, limits } = root;
        let postures = Postures { limits, nodes: Vec::new(), arrivals: Vec::new(), told: Vec::new() };
        let mut rrt = Self {
            extension,
            settings,
            tree: Tree { nodes: Vec::new() },
            nearest: Nearest::new(settings.metric),
            stream,
            iteration: 0,
            arrivals: Vec::new(),
            pending: None,
            postures: settings.metric.weighs_postures().then_some(postures),
            at_goal: false,
        };
        rrt.add(place, posture, None);
        rrt
    }

    /// Adds arrivals from `near` to the tree: lines 6 to 11 of Algorithm 1.
    fn flood(&mut self, near: usize) {
        for gait in 0..self.arrivals[near].as_ref().map_or(0, Vec::len) {
            let Some(new) = self.arrival(near, gait).and_then(Arrival::free) else { continue };
            let posture = self.posture(near, gait);
            let to_parent = self.squared(near, &new, &posture);
            let to_others = self.nearest(&new, &posture, Some(near)).map_or(f64::INFINITY, |(_, d)| d);
            if to_others > to_parent {
                self.add_arrival(new, posture, near, gait);
            }
        }
    }

    /// Extends the tree as the original planner does: chooses the candidate nearest to q_rand among the arrivals from
    /// `near`, and adds it unless the way there is blocked or it is a node already.
    fn extend(&mut self, random: &Random, near: usize, candidate: fn(Arrival) -> Option<Place>) {
        let mut best: Option<(f64, usize, Reached)> = None;
        for (gait, &reached) in self.arrivals[near].iter().flatten().enumerate() {
            let Some(new) = candidate(reached.arrival) else { continue };
            let metric = &self.settings.metric;
            let of_posture = match &self.postures {
                Some(postures) => metric.squared_of_postures(&postures.arrivals[near][gait], &random.posture),
                None => 0.0,
            };
            let distance = metric.squared(&new, &random.place) + of_posture;
            if best.is_none_or(|b| distance < b.0) {
                best = Some((distance, gait, reached));
            }
        }
        if let Some((_, gait, Reached { arrival: Arrival::Free(new), added: false })) = best {
            let posture = self.posture(near, gait);
            self.add_arrival(new, posture, near, gait);
        }
    }

    fn arrival(&self, near: usize, gait: usize) -> Option<Arrival> {
        Some(self.arrivals[near].as_ref()?.get(gait)?.arrival)
    }

    fn add_arrival(&mut self, new: Place, posture: Posture, near: usize, gait: usize) {
        if let Some(arrival) = self.arrivals[near].as_mut().and_then(|a| a.get_mut(gait)) {
            arrival.added = true;
        }
        self.add(new, posture, Some((near, gait)));
    }

    fn add(&mut self, place: Place, posture: Posture, edge: Option<(usize, usize)>) {
        if let Some(postures) = &mut self.postures {
            postures.nodes.push(posture);
            postures.arrivals.push(Vec::new());
        }
        self.tree.nodes.push(super::Node { place, edge });
        self.nearest.add(place);
        self.arrivals.push(None);
        if let Some((x, y, radius)) = self.settings.stop_at {
            let goal = Place { x, y, ..place };
            self.at_goal |= place.planar_distance(&goal) <= radius;
        }
    }

    fn random(&mut self, ground: &dyn Fn(f64, f64) -> f64) -> Random {
        let [width, height] = self.settings.map;
        let x = self.stream.uniform(-width / 2.0, width / 2.0);
        let y = self.stream.uniform(-height / 2.0, height / 2.0);
        let place = Place { x, y, z: ground(x, y), yaw: self.stream.uniform(-PI, PI) };
        let Some(postures) = &self.postures else { return Random { place, posture: Posture::default() } };
        // Coordinates of weight 0 are drawn, too: then a weight of 0 gives the same tree as a tiny one.
        let tilt = [(); 2].map(|()| self.stream.uniform(-PI, PI));
        let joints = postures.limits.iter().map(|[low, high]| self.stream.uniform(*low, *high)).collect();
        Random { place, posture: Posture { tilt, joints } }
    }

    /// Returns the posture at a gait's arrival.
    fn posture(&self, near: usize, gait: usize) -> Posture {
        self.postures.as_ref().map_or_else(Posture::default, |postures| postures.arrivals[near][gait].clone())
    }

    /// Returns ϱ² between a node and a configuration.
    fn squared(&self, node: usize, place: &Place, posture: &Posture) -> f64 {
        let metric = &self.settings.metric;
        let of_places = metric.squared(place, &self.tree.nodes[node].place);
        match &self.postures {
            Some(postures) => of_places + metric.squared_of_postures(posture, &postures.nodes[node]),
            None => of_places,
        }
    }

    /// Returns the index and squared distance of the nearest node other than `but`; ties go to the lowest index. If the
    /// metric weighs postures, all nodes are scanned.
    fn nearest(&self, place: &Place, posture: &Posture, but: Option<usize>) -> Option<(usize, f64)> {
        if self.postures.is_none() {
            return self.nearest.nearest(place, but);
        }
        let mut best: Option<(usize, f64)> = None;
        for node in (0..self.tree.nodes.len()).filter(|node| Some(*node) != but) {
            let distance = self.squared(node, place, posture);
            if best.is_none_or(|(_, least)| distance < least) {
                best = Some((node, distance));
            }
        }
        best
    }
}

impl Planner for RrtMp {
    /// `ground` gives the height of q_rand; it matters only if the metric weighs height.
    fn ask(&mut self, ground: &dyn Fn(f64, f64) -> f64) -> Ask {
        loop {
            if let Some((_, node)) = self.pending {
                return Ask::Expand(node);
            }
            if self.at_goal || self.iteration == self.settings.iterations {
                return Ask::Done;
            }
            self.iteration += 1;
            let random = self.random(ground);
            let Some((near, _)) = self.nearest(&random.place, &random.posture, None) else { return Ask::Done };
            match (&self.arrivals[near], self.extension) {
                (None, _) => self.pending = Some((random, near)),
                (Some(_), Extension::FloodFill) => {}
                (Some(_), Extension::Nearest(candidate)) => self.extend(&random, near, candidate),
            }
        }
    }

    fn postures(&mut self, told: Vec<Posture>) {
        if let Some(postures) = &mut self.postures {
            postures.told = told;
        }
    }

    fn tell(&mut self, arrivals: Vec<Arrival>) {
        let (random, near) = self.pending.take().expect("tell needs a pending request: call ask first");
        if let Some(postures) = &mut self.postures {
            assert_eq!(postures.told.len(), arrivals.len(), "if the metric weighs postures, each arrival needs one");
            postures.arrivals[near] = std::mem::take(&mut postures.told);
        }
        let reached = |arrival| Reached { arrival, added: false };
        self.arrivals[near] = Some(arrivals.into_iter().map(reached).collect());
        match self.extension {
            Extension::FloodFill => self.flood(near),
            Extension::Nearest(candidate) => self.extend(&random, near, candidate),
        }
    }

    fn tree(&self) -> &Tree {
        &self.tree
    }

    fn at_goal(&self) -> bool {
        self.at_goal
    }
}
