//! Examples of the paper (Yoshida et al. 2003, Figs. 2 and 3).

use super::{FIG_2, FIG_3, m, port, robot, segment};
use sim_core::control::sequence::Segment;
use sim_core::control::sequence::{Rule, Semantics, Step};
use sim_core::model::mtran::Configuration;
use std::collections::BTreeSet;

/// Semantics that let a segment divide the robot, as (a) and (b) of Fig. 3 do, and do not check collisions.
const DIVIDING: Semantics =
    Semantics { reading: sim_core::control::sequence::Reading::EitherFace, connectivity: false, penetration: None };

#[track_caller]
fn assert_link(configuration: &Configuration, module: usize, origin: [f64; 3], y: [f64; 3], z: [f64; 3]) {
    let place = configuration.places()[module];
    for (found, expected) in [(place.position, origin), (place.y, y), (place.z, z)] {
        let near = found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(near, "module {module}: {found:?} instead of {expected:?}");
    }
}

#[track_caller]
fn assert_same_part(before: &Configuration, step: &Step, module: usize, part: u8) {
    let (a, b) = (before.part(module, part), step.after.part(module, part));
    assert!(
        (a.origin - b.origin).norm() < 1e-6 && (a.rotation - b.rotation).norm() < 1e-6,
        "module {module} part {part}"
    );
}

const Z: [f64; 3] = [0.0, 0.0, 1.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const X: [f64; 3] = [1.0, 0.0, 0.0];

fn first_joint() -> BTreeSet<(sim_core::model::mtran::Port, sim_core::model::mtran::Port)> {
    BTreeSet::from([(port(0, 1, 0), port(1, 0, 0))])
}

fn second_joint() -> BTreeSet<(sim_core::model::mtran::Port, sim_core::model::mtran::Port)> {
    BTreeSet::from([(port(1, 1, 0), port(2, 0, 0))])
}

#[test]
fn state_of_figure_2_has_two_connections() {
    let found = robot(FIG_2);
    let expected = [(port(0, 1, 1), port(1, 0, 0)), (port(0, 1, 2), port(2, 0, 0))];
    assert_eq!(*found.connections(), BTreeSet::from(expected));
    assert_eq!(found.lowest(), -0.5);
}

#[test]
fn segment_a_of_figure_3_turns_the_link_about_part_1() {
    let before = robot(FIG_3);
    let turn = segment(&[m(1, 1, 0, -90)], &[]);
    let step = before.apply_with(&turn, &DIVIDING).expect("feasible");
    assert_eq!(step.cut, first_joint());
    assert_eq!(*step.after.connections(), second_joint());
    assert_same_part(&before, &step, 1, 1);
    assert_link(&step.after, 0, [0.0, 0.0, 0.0], Y, Z);
    assert_link(&step.after, 1, [1.0, 3.0, 0.0], [-1.0, 0.0, 0.0], Z);
    assert_link(&step.after, 2, [0.0, 4.0, 0.0], Y, Z);
    assert_eq!(step.duration, 3.0);
    let refusal = before.apply(&turn).expect_err("module 0 is alone");
    assert_eq!((refusal.rule, refusal.modules), (Rule::Connectivity, vec![1, 2]));
}

#[test]
fn segment_b_of_figure_3_turns_the_link_about_part_0() {
    let before = robot(FIG_3);
    let turn = segment(&[m(1, 0, 90, 0)], &[]);
    let step = before.apply_with(&turn, &DIVIDING).expect("feasible");
    assert_eq!(step.cut, second_joint());
    assert_eq!(*step.after.connections(), first_joint());
    assert_same_part(&before, &step, 1, 0);
    assert_link(&step.after, 0, [0.0, 0.0, 0.0], Y, Z);
    assert_link(&step.after, 1, [0.0, 2.0, 0.0], X, Z);
    assert_link(&step.after, 2, [0.0, 4.0, 0.0], Y, Z);
    let refusal = before.apply(&turn).expect_err("module 2 is alone");
    assert_eq!((refusal.rule, refusal.modules), (Rule::Connectivity, vec![2]));
}

#[test]
fn segment_c_of_figure_3_takes_module_2_along() {
    let before = robot(FIG_3);
    let step = before.apply(&segment(&[m(1, 0, 90, 0)], &[port(1, 1, 0)])).expect("feasible");
    assert!(step.cut.is_empty() && step.made.is_empty());
    assert_eq!(step.after.connections(), before.connections());
    assert_same_part(&before, &step, 1, 0);
    assert_link(&step.after, 0, [0.0, 0.0, 0.0], Y, Z);
    assert_link(&step.after, 1, [0.0, 2.0, 0.0], X, Z);
    assert_link(&step.after, 2, [2.0, 2.0, 0.0], X, Z);
}

#[test]
fn segment_a_with_its_connection_named_takes_module_0_along() {
    let before = robot(FIG_3);
    let step = before.apply(&segment(&[m(1, 1, 0, -90)], &[port(1, 0, 0)])).expect("feasible");
    assert_same_part(&before, &step, 1, 1);
    assert_link(&step.after, 0, [3.0, 3.0, 0.0], [-1.0, 0.0, 0.0], Z);
    assert_link(&step.after, 2, [0.0, 4.0, 0.0], Y, Z);
}

#[test]
fn loosened_end_of_figure_3_can_not_pass_the_flat_end_beside_it() {
    let checked = Semantics { connectivity: false, ..Semantics::default() };
    for turn in [m(1, 1, 0, -90), m(1, 0, 90, 0)] {
        let refusal = robot(FIG_3).apply_with(&segment(&[turn], &[]), &checked).expect_err("corners overlap");
        assert_eq!(refusal.rule, Rule::Collision, "{refusal}");
    }
}

#[test]
fn base_part_of_the_first_turn_stays() {
    let before = robot(FIG_3);
    let named = [port(1, 1, 0), port(2, 0, 0)];
    let step = before.apply(&segment(&[m(2, 0, 0, 30), m(1, 0, 90, 0)], &named)).expect("feasible");
    assert_same_part(&before, &step, 2, 0);
    assert_link(&step.after, 1, [0.0, 2.0, 0.0], Y, Z);
    assert_link(&step.after, 0, [2.0, 2.0, 0.0], [-1.0, 0.0, 0.0], Z);
    let step = before.apply(&segment(&[m(1, 0, 90, 0), m(2, 0, 0, 30)], &named)).expect("feasible");
    assert_same_part(&before, &step, 1, 0);
}

#[test]
fn each_piece_keeps_its_first_base_part() {
    let before = robot(FIG_3);
    let turns = [m(2, 1, 30, 60), m(1, 0, 90, 0), m(0, 1, -30, 60)];
    let step = before.apply_with(&segment(&turns, &[port(0, 1, 0)]), &DIVIDING).expect("feasible");
    assert_eq!(step.cut, second_joint());
    assert_same_part(&before, &step, 2, 1);
    assert_same_part(&before, &step, 1, 0);
    assert_same_part(&before, &step, 0, 1);
}

#[test]
fn segment_that_turns_back_restores_the_configuration() {
    let before = robot(FIG_3);
    let there = segment(&[m(1, 0, 60, -30)], &[port(1, 1, 0)]);
    let back = segment(&[m(1, 0, 0, 0)], &[port(1, 1, 0)]);
    let steps = before.apply_all([&there, &back], &Semantics::default()).expect("feasible");
    for module in 0..3 {
        let place = before.places()[module];
        assert_link(&steps[1].after, module, place.position, place.y, place.z);
    }
    assert_eq!(steps[1].after.connections(), before.connections());
}

#[test]
fn empty_segment_changes_nothing() {
    let before = robot(FIG_2);
    let step = before.apply(&Segment::default()).expect("feasible");
    assert_eq!((step.after, step.duration), (before, 0.0));
}
