//! Transition reuse: what a gait does depends on the local state it starts from, not on where on the map.
//!
//! A *local state* is a configuration in the canonical frame (x = y = 0, heading 0): joint angles, tilt and height. A
//! gait drives the robot onto a limit cycle, so its ends cluster; a tree of hundreds of expansions has but a few local
//! states. A node belongs to the first representative within the tolerance; representatives never move. So the
//! transition from (representative, gait) is simulated once and laid into the map wherever it is needed.
//!
//! With tolerance 0 every configuration is its own representative, and every expansion is simulated.

use super::Place;
use crate::math::{angle_between, heading};
use crate::robot::State;
use crate::rollout::{Outcome, Rollout, canonical};

/// Index of a start in a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct StartId(pub usize);

/// What a transition is known by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TransitionKey {
    /// Where it starts.
    pub start: StartId,
    /// Which gait.
    pub gait: usize,
}

/// A rollout and what the planner needs of it.
#[derive(Clone, Debug)]
pub struct Transition {
    /// The rollout; in the canonical frame, or in the map if its start is bound to a place.
    pub rollout: Rollout,
    /// Where it ends, in the frame of the rollout.
    pub end: Place,
    /// The representative of where it ends. `None` if it was unstable.
    pub end_start: Option<StartId>,
}

#[derive(Clone, Debug)]
struct Start {
    state: State,
    /// Bound to a place: simulated there, among the terrain, and never matched.
    in_place: bool,
    transitions: Vec<Option<Transition>>,
}

/// The table of one candidate: its local states and the transitions simulated from them.
#[derive(Clone, Debug)]
pub struct Transitions {
    gaits: usize,
    tolerance: f32,
    starts: Vec<Start>,
}

impl Transitions {
    /// A table for so many gaits; `root` is the settled start in the canonical frame and becomes start 0.
    pub fn new(gaits: usize, tolerance: f64, root: &State) -> Self {
        let mut table = Self { gaits, tolerance: tolerance as f32, starts: Vec::new() };
        table.add(root.clone(), false);
        table
    }

    /// The start that a configuration belongs to.
    pub fn representative(&mut self, state: State) -> StartId {
        let local = canonical(state);
        if self.tolerance > 0.0
            && let Some(i) = self.starts.iter().position(|s| !s.in_place && self.close(&s.state, &local))
        {
            return StartId(i);
        }
        self.add(local, false)
    }

    /// A start bound to a place of the map, exactly this configuration.
    pub fn in_place(&mut self, state: State) -> StartId {
        self.add(state, true)
    }

    /// The configuration of a start.
    pub fn start(&self, id: StartId) -> &State {
        &self.starts[id.0].state
    }

    /// Whether a start is bound to a place of the map.
    pub fn is_in_place(&self, id: StartId) -> bool {
        self.starts[id.0].in_place
    }

    /// How many starts there are.
    pub fn starts(&self) -> usize {
        self.starts.len()
    }

    /// A transition, if it was simulated.
    pub fn get(&self, key: TransitionKey) -> Option<&Transition> {
        self.starts[key.start.0].transitions[key.gait].as_ref()
    }

    /// Takes a simulated transition.
    pub fn insert(&mut self, key: TransitionKey, rollout: Rollout) {
        let (p, yaw) = (rollout.end.pivot.translation, heading(rollout.end.pivot.rotation));
        let end = Place { x: p.x.into(), y: p.y.into(), z: p.z.into(), yaw };
        let sound = rollout.outcome == Outcome::Completed;
        let end_start = sound.then(|| self.representative(rollout.end.clone()));
        self.starts[key.start.0].transitions[key.gait] = Some(Transition { rollout, end, end_start });
    }

    fn add(&mut self, state: State, in_place: bool) -> StartId {
        self.starts.push(Start { state, in_place, transitions: vec![None; self.gaits] });
        StartId(self.starts.len() - 1)
    }

    /// Whether joint angles (rad), tilt (rad) and height (mu) all differ by at most the tolerance.
    fn close(&self, a: &State, b: &State) -> bool {
        a.joints.iter().zip(&b.joints).all(|(a, b)| (a - b).abs() <= self.tolerance)
            && (a.pivot.translation.z - b.pivot.translation.z).abs() <= self.tolerance
            && angle_between(a.pivot.rotation, b.pivot.rotation) <= self.tolerance
    }
}
