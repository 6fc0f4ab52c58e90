//! Transition reuse: what a gait does depends on the local state it starts from, not on where on the map.
//!
//! A *local state* is a configuration in the canonical frame (x = y = 0, heading 0): joint angles, tilt and height. A
//! gait drives the robot onto a limit cycle, so its ends cluster; a tree of hundreds of expansions has but a few local
//! states. A node belongs to the first representative within the tolerance; representatives never move. So the
//! transition from (representative, gait) is simulated once and laid into the map wherever it is needed.
//!
//! With tolerance 0 every configuration is its own representative, and every expansion is simulated.
//!
//! A robot whose every step repeats exactly may walk a closed polygon that the small differences between its steps would
//! lead it out of. So a local state can keep several *members*: the first V distinct configurations that fall into it,
//! its representative first. A node that is one of them starts from itself, any other from one of them, picked by the
//! node's index, so that transitions come in up to V simulated variants. With at least as many variants as distinct
//! configurations every node starts from itself: the tree is that of tolerance 0.

use super::Extent;
use crate::base::math::{angle_between, heading};
use crate::model::{Place, State};
use crate::physics::{Outcome, Rollout, canonical};

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
    /// How far it reaches, in the frame of the rollout.
    pub extent: Extent,
    /// The representative of where it ends. `None` if it did not run to its end.
    pub end_start: Option<StartId>,
    /// Where it ends, if that is a member of its local state.
    pub end_member: Option<StartId>,
}

#[derive(Clone, Debug)]
struct Start {
    state: State,
    /// Bound to a place: simulated there, among the terrain, and never matched.
    in_place: bool,
    /// Of a representative, the members of its local state, itself first; of others none.
    members: Vec<StartId>,
    transitions: Vec<Option<Transition>>,
}

/// How far transitions are reused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reuse {
    /// Most that joint angles (rad), tilt (rad) and height (mu) may differ; 0: nothing is reused.
    pub tolerance: f64,
    /// V, members of a local state, at least 1.
    pub variants: u32,
}

/// The table of one candidate: its local states and the transitions simulated from them.
#[derive(Clone, Debug)]
pub struct Transitions {
    gaits: usize,
    tolerance: f32,
    variants: usize,
    starts: Vec<Start>,
}

impl Transitions {
    /// A table for so many gaits; `root` is the settled start in the canonical frame and becomes start 0.
    pub fn new(gaits: usize, reuse: Reuse, root: &State) -> Self {
        let (tolerance, variants) = (reuse.tolerance as f32, reuse.variants as usize);
        let mut table = Self { gaits, tolerance, variants, starts: Vec::new() };
        table.add_representative(root.clone());
        table
    }

    /// The representative that a configuration belongs to, and the member of the local state that it is, if it is one.
    fn local_state(&mut self, state: State) -> (StartId, Option<StartId>) {
        let local = canonical(state);
        let close = |s: &Start| !s.members.is_empty() && self.close(&s.state, &local);
        let found = if self.tolerance > 0.0 { self.starts.iter().position(close) } else { None };
        let Some(i) = found else {
            let new = self.add_representative(local);
            return (new, Some(new));
        };
        let members = &self.starts[i].members;
        let same = members.iter().copied().find(|m| same_bits(self.start(*m), &local));
        if same.is_some() || members.len() >= self.variants {
            return (StartId(i), same);
        }
        let new = self.add(local, false);
        self.starts[i].members.push(new);
        (StartId(i), Some(new))
    }

    /// What a node starts from that a transition led to: itself if it is a member of its local state, else one of the
    /// members. Which one follows from the node's index, mixed: siblings are neighbours, so by the remainder alone a
    /// gait would be tied to a variant.
    pub fn start_of_node(&self, transition: &Transition, node: usize) -> StartId {
        let representative = transition.end_start.unwrap_or(StartId(0));
        let members = &self.starts[representative.0].members;
        transition.end_member.unwrap_or_else(|| members[(mixed(node as u64) % members.len() as u64) as usize])
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
        let (end_start, end_member) = match sound.then(|| self.local_state(rollout.end.clone().at_rest())) {
            Some((representative, member)) => (Some(representative), member),
            None => (None, None),
        };
        let extent = Extent::of(&rollout);
        let transition = Transition { rollout, end, extent, end_start, end_member };
        self.starts[key.start.0].transitions[key.gait] = Some(transition);
    }

    fn add(&mut self, state: State, in_place: bool) -> StartId {
        self.starts.push(Start { state, in_place, members: Vec::new(), transitions: vec![None; self.gaits] });
        StartId(self.starts.len() - 1)
    }

    fn add_representative(&mut self, state: State) -> StartId {
        let id = self.add(state, false);
        self.starts[id.0].members.push(id);
        id
    }

    /// Whether joint angles (rad), tilt (rad) and height (mu) all differ by at most the tolerance.
    fn close(&self, a: &State, b: &State) -> bool {
        a.joints.iter().zip(&b.joints).all(|(a, b)| (a - b).abs() <= self.tolerance)
            && (a.pivot.translation.z - b.pivot.translation.z).abs() <= self.tolerance
            && angle_between(a.pivot.rotation, b.pivot.rotation) <= self.tolerance
    }
}

fn same_bits(a: &State, b: &State) -> bool {
    let numbers = |s: &State| {
        let (p, q) = (s.pivot.translation, s.pivot.rotation);
        [p.x, p.y, p.z, q.x, q.y, q.z, q.w].map(f32::to_bits)
    };
    numbers(a) == numbers(b)
        && a.joints.len() == b.joints.len()
        && a.joints.iter().zip(&b.joints).all(|(a, b)| a.to_bits() == b.to_bits())
}

/// All bits of a number spread over all bits of another (the finaliser of SplitMix64: Steele, Lea and Flood, Fast
/// splittable pseudorandom number generators, OOPSLA 2014).
fn mixed(n: u64) -> u64 {
    let n = n.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let n = (n ^ (n >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let n = (n ^ (n >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    n ^ (n >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::{Pose, Rotation, Vector, about, about_z};
    use crate::base::random::{Purpose, Stream};
    use crate::physics::Effort;
    use crate::plan::grow::laid_out;
    use std::f32::consts::{FRAC_PI_2, PI};

    fn state(x: f32, rotation: Rotation, joint: f32) -> State {
        let translation = Vector::new(x, -x, 0.5);
        State::new(Pose::from_parts(translation, rotation.normalize()), vec![joint, 0.2])
    }

    fn place_of(state: &State) -> Place {
        let p = state.pivot.translation;
        Place { x: p.x.into(), y: p.y.into(), z: p.z.into(), yaw: heading(state.pivot.rotation) }
    }

    fn table(root: &State) -> Transitions {
        Transitions::new(1, Reuse { tolerance: 0.05, variants: 1 }, &canonical(root.clone()))
    }

    #[test]
    fn place_and_heading_are_no_part_of_a_local_state_and_joints_tilt_and_height_are() {
        for tilt in [0.0, 0.4, FRAC_PI_2, 3.0] {
            let tilted = |angle: f32| about(Vector::new(0.6, 0.8, 0.0), angle);
            let root = state(0.0, tilted(tilt), 0.1);
            let mut table = table(&root);
            for yaw in [-3.1, -1.0, 0.7, 2.0] {
                let moved = state(5.0, about_z(yaw) * tilted(tilt), 0.1);
                assert_eq!(table.local_state(moved.clone()).0, StartId(0), "tilt {tilt}, yaw {yaw}");
                let by = |change: &dyn Fn(&mut State)| {
                    let mut other = moved.clone();
                    change(&mut other);
                    other
                };
                assert_eq!(table.local_state(by(&|s| s.joints[1] += 0.049)).0, StartId(0));
                assert_eq!(table.local_state(by(&|s| s.pivot.translation.z += 0.049)).0, StartId(0));
                assert_ne!(table.clone().local_state(by(&|s| s.joints[1] += 0.051)).0, StartId(0));
                assert_ne!(table.clone().local_state(by(&|s| s.pivot.translation.z += 0.051)).0, StartId(0));
                let tipped = state(5.0, about_z(yaw) * tilted(tilt + 0.051), 0.1);
                assert_ne!(table.clone().local_state(tipped).0, StartId(0));
            }
        }
    }

    #[test]
    fn a_configuration_belongs_to_the_first_representative_within_the_tolerance_and_none_moves() {
        let at = |joint: f32| state(0.0, Rotation::IDENTITY, joint);
        let mut table = table(&at(0.0));
        // Each is near the one before, but only what is near the first belongs to it: local states do not creep.
        assert_eq!(table.local_state(at(0.04)).0, StartId(0));
        assert_eq!(table.local_state(at(0.08)).0, StartId(1));
        assert_eq!(table.local_state(at(0.045)).0, StartId(0), "of two within the tolerance the first");
        assert_eq!(table.local_state(at(0.12)).0, StartId(1));
        assert_eq!(table.start(StartId(0)).joints[0], 0.0);
        assert_eq!(table.start(StartId(1)).joints[0], 0.08);
    }

    /// On its head a robot has hardly a heading: it may count as another local state, never as a wrong one.
    #[test]
    fn what_shares_a_local_state_is_laid_out_alike_in_any_tilt_up_to_the_half_turn() {
        let mut stream = Stream::new(4, Purpose::Sample, 0, 0, 0);
        let half_turn = Rotation::from_xyzw(0.6, 0.8, 0.0, 0.0);
        let mut shared = 0;
        for tilt in [FRAC_PI_2, PI - 0.1, PI - 1e-3, PI - 1e-6, PI] {
            for _ in 0..300 {
                let horizontal = stream.uniform(-3.2, 3.2);
                let axis = Vector::new(libm::cos(horizontal) as f32, libm::sin(horizontal) as f32, 0.0);
                let base = if tilt == PI { half_turn } else { about(axis, tilt) };
                let mut near = || {
                    let jitter = about(Vector::X, stream.uniform(-0.03, 0.03) as f32)
                        * about(Vector::Y, stream.uniform(-0.03, 0.03) as f32);
                    state(1.0, about_z(stream.uniform(-3.1, 3.1)) * jitter * base, 0.1)
                };
                let (root, other) = (near(), near());
                let mut table = table(&root);
                let (representative, _) = table.local_state(other.clone());
                let again = laid_out(table.start(representative), &place_of(&other));
                let apart = angle_between(again.pivot.rotation, other.pivot.rotation);
                assert!(apart <= 0.05 + 1e-3, "{apart} rad apart at tilt {tilt}");
                shared += u32::from(representative == StartId(0));
            }
        }
        assert!(shared > 150, "{shared} of 1500 share a local state: this shows little");
        let exact = state(0.0, half_turn, 0.1);
        assert_eq!(heading(exact.pivot.rotation), 0.0);
        assert_eq!(table(&exact).local_state(exact.clone()), (StartId(0), Some(StartId(0))));
    }

    #[test]
    fn members_are_the_first_distinct_configurations_and_nodes_are_spread_over_them() {
        let at = |joint: f32| state(0.0, Rotation::IDENTITY, joint);
        let mut table = Transitions::new(1, Reuse { tolerance: 0.05, variants: 3 }, &canonical(at(0.0)));
        let members: Vec<_> = [0.01, 0.0, 0.02, 0.01, 0.03, 0.02].map(|j| table.local_state(at(j)).1).to_vec();
        let [one, two] = [Some(StartId(1)), Some(StartId(2))];
        assert_eq!(members, [one, Some(StartId(0)), two, one, None, two]);
        let (end_start, end_member) = (Some(StartId(0)), None);
        let rollout = Rollout {
            end: at(0.03),
            end_speed: 0.0,
            trace: crate::physics::Trace::new(2),
            swept: Vec::new(),
            outcome: Outcome::Completed,
            simulated_ms: 0,
            effort: Effort::default(),
        };
        let transition =
            Transition { end: Place::ORIGIN, extent: Extent::of(&rollout), rollout, end_start, end_member };
        // Three gaits add nodes in turn: no gait may be tied to a member.
        for gait in 0..3 {
            let mut uses = [0u32; 3];
            (0..300).for_each(|i| uses[table.start_of_node(&transition, 3 * i + gait).0] += 1);
            assert!(uses.iter().all(|n| (70..130).contains(n)), "{uses:?}");
        }
    }
}
