//! Transition reuse: the outcome of a gait depends on the local state it starts from, not on the place in the map.
//!
//! A *local state* is a configuration in the canonical frame (x = y = 0, heading 0): joint angles, tilt and height. A
//! gait drives the robot onto a limit cycle, so its ends cluster: a tree of hundreds of expansions has only a few local
//! states. A node belongs to the first representative within the tolerance; representatives never move. So the
//! transition of a pair (representative, gait) is simulated once and laid out in the map wherever it is needed.
//!
//! With tolerance 0 every configuration is its own representative, and every expansion is simulated.
//!
//! A robot whose steps all repeat exactly may walk a closed polygon; small differences between its steps would lead it
//! out. So a local state can keep several *members*: the first V distinct configurations that fall into it, the
//! representative first. A node whose configuration is a member starts from it. Any other node starts from a member
//! chosen by the node's index, so that transitions occur in up to V simulated variants. If V is at least the number of
//! distinct configurations, every node starts from its own: the tree equals that of tolerance 0.

use super::Extent;
use crate::base::math::{angle_between, heading};
use crate::model::{Place, State};
use crate::physics::{Outcome, Rollout, canonical};

/// Index of a start in a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct StartId(pub usize);

/// Key of a transition.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TransitionKey {
    /// Start of the transition.
    pub start: StartId,
    /// Index of the gait.
    pub gait: usize,
}

/// A rollout and the results of it that the planner needs.
#[derive(Clone, Debug)]
pub struct Transition {
    /// The rollout, in the canonical frame, or in the map if its start is bound to a place.
    pub rollout: Rollout,
    /// Place of its end, in the frame of the rollout.
    pub end: Place,
    /// Bounds of the rollout, in its own frame.
    pub extent: Extent,
    /// Representative of the end; `None` if the rollout did not complete.
    pub end_start: Option<StartId>,
    /// Start with the end's own configuration, if that is a member of its local state.
    pub end_member: Option<StartId>,
}

#[derive(Clone, Debug)]
struct Start {
    state: State,
    /// True if the start is bound to a place: simulated there, with the terrain, and never matched.
    in_place: bool,
    /// For a representative, the members of its local state, itself first; else empty.
    members: Vec<StartId>,
    transitions: Vec<Option<Transition>>,
}

/// Settings of transition reuse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reuse {
    /// Greatest difference of joint angles (rad), tilt (rad) and height (mu); 0: no transition is reused.
    pub tolerance: f64,
    /// V, most members of a local state, at least 1.
    pub variants: u32,
}

/// Table of one candidate: its local states and the transitions simulated from them.
#[derive(Clone, Debug)]
pub struct Transitions {
    gaits: usize,
    tolerance: f32,
    variants: usize,
    starts: Vec<Start>,
}

impl Transitions {
    /// Creates a table for this number of gaits. `root` is the settled start in the canonical frame; it becomes
    /// start 0.
    pub fn new(gaits: usize, reuse: Reuse, root: &State) -> Self {
        let (tolerance, variants) = (reuse.tolerance as f32, reuse.variants as usize);
        let mut table = Self { gaits, tolerance, variants, starts: Vec::new() };
        table.add_representative(root.clone());
        table
    }

    /// Returns the representative of a configuration, and the member with exactly this configuration if there is one.
    /// Adds the configuration as representative or member where there is room.
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

    /// Returns the start of a node that a transition led to: the end's own configuration if it is a member of its local
    /// state, else one of the members. The member is chosen by the mixed bits of the node's index. Siblings have
    /// consecutive indexes, so the remainder of the index alone would tie a gait to a variant.
    pub fn start_of_node(&self, transition: &Transition, node: usize) -> StartId {
        let representative = transition.end_start.unwrap_or(StartId(0));
        let members = &self.starts[representative.0].members;
        transition.end_member.unwrap_or_else(|| members[(mixed(node as u64) % members.len() as u64) as usize])
    }

    /// Adds a start that is bound to a place of the map, with exactly this configuration.
    pub fn in_place(&mut self, state: State) -> StartId {
        self.add(state, true)
    }

    /// Returns the configuration of a start.
    pub fn start(&self, id: StartId) -> &State {
        &self.starts[id.0].state
    }

    /// Returns true if a start is bound to a place of the map.
    pub fn is_in_place(&self, id: StartId) -> bool {
        self.starts[id.0].in_place
    }

    /// Returns the number of starts.
    pub fn starts(&self) -> usize {
        self.starts.len()
    }

    /// Returns a transition, or `None` if it was not simulated.
    pub fn get(&self, key: TransitionKey) -> Option<&Transition> {
        self.starts[key.start.0].transitions[key.gait].as_ref()
    }

    /// Stores a simulated transition.
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

    /// Returns true if joint angles (rad), tilt (rad) and height (mu) all differ by at most the tolerance.
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

/// Mixes the bits of a number (the finaliser of SplitMix64: Steele, Lea and Flood, Fast splittable pseudorandom number
/// generators, OOPSLA 2014).
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
    fn local_state_is_joints_tilt_and_height_without_place() {
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
    fn first_representative_within_tolerance_matches_and_never_moves() {
        let at = |joint: f32| state(0.0, Rotation::IDENTITY, joint);
        let mut table = table(&at(0.0));
        // Each is close to the one before, but only those close to the first belong to it: local states do not drift.
        assert_eq!(table.local_state(at(0.04)).0, StartId(0));
        assert_eq!(table.local_state(at(0.08)).0, StartId(1));
        assert_eq!(
            table.local_state(at(0.045)).0,
            StartId(0),
            "of two representatives within the tolerance, the first is chosen"
        );
        assert_eq!(table.local_state(at(0.12)).0, StartId(1));
        assert_eq!(table.start(StartId(0)).joints[0], 0.0);
        assert_eq!(table.start(StartId(1)).joints[0], 0.08);
    }

    /// Upside down, a robot's heading is almost undefined: the configuration may become a new local state, never a
    /// wrong one.
    #[test]
    fn configurations_of_one_local_state_agree_at_any_tilt() {
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
        assert!(shared > 150, "{shared} of 1500 share a local state: too few to test the layout");
        let exact = state(0.0, half_turn, 0.1);
        assert_eq!(heading(exact.pivot.rotation), 0.0);
        assert_eq!(table(&exact).local_state(exact.clone()), (StartId(0), Some(StartId(0))));
    }

    #[test]
    fn nodes_spread_over_distinct_members_of_local_state() {
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
        // Three gaits add nodes in turn; no gait may be tied to a member.
        for gait in 0..3 {
            let mut uses = [0u32; 3];
            (0..300).for_each(|i| uses[table.start_of_node(&transition, 3 * i + gait).0] += 1);
            assert!(uses.iter().all(|n| (70..130).contains(n)), "{uses:?}");
        }
    }
}
