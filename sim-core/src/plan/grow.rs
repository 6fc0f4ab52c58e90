//! Growth of one tree: runs a planner on a table of transitions and returns the transitions that are missing.

use super::{
    Arrival, Ask, Planner, PlannerSettings, Posture, Root, StartId, TransitionKey, Transitions, Tree, leaves_map,
    on_terrain, touches,
};
use crate::base::math::{Pose, Vector, about_z};
use crate::base::random::Stream;
use crate::base::score::Counts;
use crate::model::environment::Environment;
use crate::model::{Place, Robot, State};
use crate::physics::{Outcome, canonical};

/// Robot, environment and gaits that a tree is grown for.
#[derive(Clone, Copy, Debug)]
pub struct TreeScene<'a> {
    /// The robot.
    pub robot: &'a Robot,
    /// The environment that it moves in.
    pub environment: &'a Environment,
    /// k, the number of gaits.
    pub gaits: usize,
    /// Height of the pivot above the ground at rest, mu.
    pub height: f64,
}

/// A tree being grown.
#[derive(Debug)]
pub struct Growth {
    planner: Box<dyn Planner>,
    nodes: Vec<NodeStart>,
    /// Transitions behind the arrivals of all gaits, by node; empty for nodes that are not expanded.
    edges: Vec<Vec<TransitionKey>>,
    /// True if the planner needs postures, because its metric weighs them.
    postures: bool,
    counts: Counts,
}

/// Start configuration of a node.
#[derive(Clone, Debug)]
struct NodeStart {
    /// The node's local state in the canonical frame, from which its canonical rollouts start.
    local: StartId,
    /// The exact configuration in the map, if a rollout in place led to the node.
    exact: Option<State>,
    /// The start bound to the node's place; `None` until terrain requires one.
    in_place: Option<StartId>,
}

impl Growth {
    /// Begins a tree at `root`. The root's configuration is start 0 of the table.
    pub fn new(settings: PlannerSettings, root: impl Into<Root>, stream: Stream) -> Self {
        let root_start = NodeStart { local: StartId(0), exact: None, in_place: None };
        Self {
            planner: settings.start(root, stream),
            nodes: vec![root_start],
            edges: vec![Vec::new()],
            postures: settings.metric.weighs_postures(),
            counts: Counts::default(),
        }
    }

    /// Returns the tree so far.
    pub fn tree(&self) -> &Tree {
        self.planner.tree()
    }

    /// Returns true if the growth ended at the goal of [`PlannerSettings::stop_at`].
    pub fn at_goal(&self) -> bool {
        self.planner.at_goal()
    }

    /// Returns the numbers of edges tried, edges rejected and nodes. Rollouts are counted where they are run.
    pub fn counts(&self) -> Counts {
        Counts { nodes: self.tree().nodes.len() as u64, ..self.counts }
    }

    /// Returns the transition that led to a node, or `None` for the root.
    pub fn transition_to(&self, node: usize) -> Option<TransitionKey> {
        let (parent, gait) = self.tree().nodes[node].edge?;
        self.edges[parent].get(gait).copied()
    }

    /// Returns the place from which a node's transition is laid out: the node's place for a transition in the canonical
    /// frame, the map's origin for a rollout in place.
    pub fn frame(&self, table: &Transitions, node: usize, key: TransitionKey) -> Place {
        if table.is_in_place(key.start) { Place::ORIGIN } else { self.tree().nodes[node].place }
    }

    /// Returns the centre of mass of the robot at a node, (x, y, z) in the map, mu.
    pub fn mass_center(&self, robot: &Robot, table: &Transitions, node: usize) -> [f64; 3] {
        let NodeStart { local, exact, .. } = &self.nodes[node];
        let standing = || standing_at(table.start(*local), &self.tree().nodes[node].place);
        robot.mass_center(exact.as_ref().unwrap_or(&standing()))
    }

    /// Grows the tree until transitions are missing and returns their keys. Returns no keys once the tree is complete.
    pub fn advance(&mut self, setting: &TreeScene<'_>, table: &mut Transitions) -> Vec<TransitionKey> {
        let ground = |x: f64, y: f64| {
            let over = setting.environment.terrain.iter().filter(|t| t.covers(x, y, 0.0));
            setting.height + over.map(|t| t.top).fold(0.0, f64::max)
        };
        loop {
            let asked = self.planner.ask(&ground);
            self.register(table);
            let Ask::Expand(node) = asked else { return Vec::new() };
            let keys: Vec<TransitionKey> = (0..setting.gaits).map(|g| self.key(setting, table, node, g)).collect();
            let missing: Vec<TransitionKey> = keys.iter().copied().filter(|k| table.get(*k).is_none()).collect();
            if !missing.is_empty() {
                return missing;
            }
            let arrivals = keys.iter().map(|key| self.arrival(setting, table, node, *key)).collect();
            if self.postures {
                let posture =
                    |key: &TransitionKey| table.get(*key).map(|t| Posture::of(&t.rollout.end)).unwrap_or_default();
                self.planner.postures(keys.iter().map(posture).collect());
            }
            self.edges[node] = keys;
            self.planner.tell(arrivals);
            self.register(table);
        }
    }

    /// Adds a start for each node that the planner has added since the last call.
    fn register(&mut self, table: &Transitions) {
        for new in self.nodes.len()..self.tree().nodes.len() {
            self.edges.push(Vec::new());
            let start = self.start_of(table, new);
            self.nodes.push(start);
        }
    }

    /// Returns the transition to use from a node: the canonical one, or one bound to the node's place if the robot
    /// stands over terrain or the canonical transition passes over terrain.
    fn key(&mut self, setting: &TreeScene<'_>, table: &mut Transitions, node: usize, gait: usize) -> TransitionKey {
        let place = self.tree().nodes[node].place;
        let local = TransitionKey { start: self.nodes[node].local, gait };
        let terrain = &setting.environment.terrain;
        if terrain.is_empty() {
            return local;
        }
        let start = &self.nodes[node];
        let clear = start.exact.as_ref().is_none_or(|exact| !over(setting.robot, terrain, exact));
        if clear && table.get(local).is_none_or(|t| !on_terrain(terrain, &place, t)) {
            return local;
        }
        let bound = start.in_place.unwrap_or_else(|| {
            let exact = start.exact.clone();
            let state = table.start(local.start);
            // The root may stand on terrain: then its place is higher than its local state.
            let laid_out = || if node == 0 { standing_at(state, &place) } else { laid_out(state, &place) };
            table.in_place(exact.unwrap_or_else(laid_out))
        });
        self.nodes[node].in_place = Some(bound);
        TransitionKey { start: bound, gait }
    }

    fn arrival(&mut self, setting: &TreeScene<'_>, table: &Transitions, node: usize, key: TransitionKey) -> Arrival {
        self.counts.edges += 1;
        let frame = self.frame(table, node, key);
        let completed = table.get(key).filter(|transition| transition.rollout.outcome == Outcome::Completed);
        let arrival = match completed {
            None => Arrival::Lost,
            Some(transition) => {
                let blocked = leaves_map(setting.environment, &frame, transition)
                    || touches(setting.robot, &setting.environment.obstacles, &frame, transition);
                let place = frame.then(&transition.end);
                if blocked { Arrival::Blocked(place) } else { Arrival::Free(place) }
            }
        };
        self.counts.rejected += u64::from(arrival.free().is_none());
        arrival
    }

    fn start_of(&self, table: &Transitions, node: usize) -> NodeStart {
        let reached = self.transition_to(node).and_then(|key| table.get(key).map(|t| (key, t)));
        let Some((key, transition)) = reached else {
            return NodeStart { local: StartId(0), exact: None, in_place: None };
        };
        let exact = table.is_in_place(key.start).then(|| transition.rollout.end.clone().at_rest());
        NodeStart { local: table.start_of_node(transition, node), exact, in_place: None }
    }
}

/// Moves a canonical configuration to a place of the map; its height stays.
pub(super) fn laid_out(state: &State, place: &Place) -> State {
    let local = canonical(state.clone());
    let height = f64::from(local.pivot.translation.z);
    let turn = about_z(place.yaw);
    let rotation = (turn * local.pivot.rotation).normalize();
    let translation = Vector::new(place.x as f32, place.y as f32, height as f32);
    let velocities = local.velocities.map(|velocities| velocities.turned(turn));
    State { pivot: Pose::from_parts(translation, rotation), velocities, ..local }
}

/// Moves a canonical configuration to a place of the map and to the height of that place.
pub(crate) fn standing_at(state: &State, place: &Place) -> State {
    let mut state = laid_out(state, place);
    state.pivot.translation.z = place.z as f32;
    state
}

/// Returns true if the disc around the robot's bounding box, seen from above, overlaps terrain.
fn over(robot: &Robot, terrain: &[crate::model::environment::Block], state: &State) -> bool {
    let (low, high) = robot.bounds(state);
    let (x, y) = (f64::from(low.x + high.x) / 2.0, f64::from(low.y + high.y) / 2.0);
    let (w, h) = (f64::from(high.x - low.x) / 2.0, f64::from(high.y - low.y) / 2.0);
    terrain.iter().any(|t| t.covers(x, y, (w * w + h * h).sqrt()))
}
