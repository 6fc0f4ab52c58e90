//! A planner and the table of transitions it is fed from: grows one tree, saying which rollouts it lacks.

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

/// Where trees are grown.
#[derive(Clone, Copy, Debug)]
pub struct Setting<'a> {
    /// Who moves.
    pub robot: &'a Robot,
    /// Where.
    pub environment: &'a Environment,
    /// k.
    pub gaits: usize,
    /// Height of the pivot above the ground at rest, mu.
    pub height: f64,
}

/// A tree on its way.
#[derive(Debug)]
pub struct Growth {
    planner: Box<dyn Planner>,
    nodes: Vec<NodeStart>,
    /// Of every expanded node, the transition behind each gait's arrival.
    edges: Vec<Vec<TransitionKey>>,
    /// The planner is told postures, too.
    postures: bool,
    counts: Counts,
}

/// What a node starts from.
#[derive(Clone, Debug)]
struct NodeStart {
    /// Its local state in the canonical frame: the configuration to start from.
    local: StartId,
    /// The exact configuration in the map, where it was reached by a rollout in place.
    exact: Option<State>,
    /// The start bound to its place, once one was needed.
    in_place: Option<StartId>,
}

impl Growth {
    /// Starts at a place, in start 0 of the table.
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

    /// The tree so far.
    pub fn tree(&self) -> &Tree {
        self.planner.tree()
    }

    /// Whether it ended at the goal of [`PlannerSettings::stop_at`].
    pub fn at_goal(&self) -> bool {
        self.planner.at_goal()
    }

    /// Edges tried and rejected, and nodes. Rollouts are counted where they are run.
    pub fn counts(&self) -> Counts {
        Counts { nodes: self.tree().nodes.len() as u64, ..self.counts }
    }

    /// The transition that led to a node; `None` for the root.
    pub fn transition_to(&self, node: usize) -> Option<TransitionKey> {
        let (parent, gait) = self.tree().nodes[node].edge?;
        self.edges[parent].get(gait).copied()
    }

    /// Where a node is laid out from when its transition was simulated in the canonical frame: its place, or the map's
    /// origin for a rollout in place.
    pub fn frame(&self, table: &Transitions, node: usize, key: TransitionKey) -> Place {
        if table.is_in_place(key.start) { Place::ORIGIN } else { self.tree().nodes[node].place }
    }

    /// Grows until transitions are missing and returns them, or returns none when the tree is grown.
    pub fn advance(&mut self, setting: &Setting<'_>, table: &mut Transitions) -> Vec<TransitionKey> {
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

    /// Takes in the nodes that were added since.
    fn register(&mut self, table: &Transitions) {
        for new in self.nodes.len()..self.tree().nodes.len() {
            self.edges.push(Vec::new());
            let start = self.start_of(table, new);
            self.nodes.push(start);
        }
    }

    /// The transition to use from a node: the canonical one unless it comes over terrain.
    fn key(&mut self, setting: &Setting<'_>, table: &mut Transitions, node: usize, gait: usize) -> TransitionKey {
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
            // The root may stand on terrain, where its place is higher than its local state.
            let laid_out = || if node == 0 { standing_at(state, &place) } else { laid_out(state, &place) };
            table.in_place(exact.unwrap_or_else(laid_out))
        });
        self.nodes[node].in_place = Some(bound);
        TransitionKey { start: bound, gait }
    }

    fn arrival(&mut self, setting: &Setting<'_>, table: &Transitions, node: usize, key: TransitionKey) -> Arrival {
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

/// A canonical configuration, moved to a place of the map.
pub(super) fn laid_out(state: &State, place: &Place) -> State {
    let local = canonical(state.clone());
    let height = f64::from(local.pivot.translation.z);
    let turn = about_z(place.yaw);
    let rotation = (turn * local.pivot.rotation).normalize();
    let translation = Vector::new(place.x as f32, place.y as f32, height as f32);
    let velocities = local.velocities.map(|velocities| velocities.turned(turn));
    State { pivot: Pose::from_parts(translation, rotation), velocities, ..local }
}

/// A canonical configuration, moved to a place of the map and to its height.
pub(crate) fn standing_at(state: &State, place: &Place) -> State {
    let mut state = laid_out(state, place);
    state.pivot.translation.z = place.z as f32;
    state
}

/// Whether the robot's bounds come over terrain.
fn over(robot: &Robot, terrain: &[crate::model::environment::Block], state: &State) -> bool {
    let (low, high) = robot.bounds(state);
    let (x, y) = (f64::from(low.x + high.x) / 2.0, f64::from(low.y + high.y) / 2.0);
    let (w, h) = (f64::from(high.x - low.x) / 2.0, f64::from(high.y - low.y) / 2.0);
    terrain.iter().any(|t| t.covers(x, y, (w * w + h * h).sqrt()))
}
