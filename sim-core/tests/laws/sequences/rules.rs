//! Rules of static feasibility, and connections that are made.

use super::{FIG_2, FIG_3, m, port, random_segment, robot, segment, source};
use sim_core::control::sequence::{Reading, Rule, Semantics};
use sim_core::model::mtran::random;
use std::collections::BTreeSet;

/// Two modules on each other, connected at both parts: each axis of one is an axis of the other.
const DOUBLE: &str = "\
ID 0 p(0,0,0) z(0,0,1) y(0,1,0) (0, 0)
ID 1 p(0,1,1) z(0,0,1) y(0,-1,0) (0, 0)
";

#[test]
fn unknown_module_is_refused() {
    let refusal = robot(FIG_2).apply(&segment(&[m(3, 0, 0, 0)], &[])).expect_err("three modules");
    assert_eq!((refusal.rule, refusal.modules.clone()), (Rule::Module, vec![3]));
    assert_eq!(refusal.to_string(), "segment: rule module: module 3 does not exist: allowed are 0 to 2");
    let refusal = robot(FIG_2).apply(&segment(&[], &[port(7, 0, 0)])).expect_err("three modules");
    assert_eq!((refusal.rule, refusal.modules), (Rule::Module, vec![7]));
}

#[test]
fn unknown_parts_and_double_turns_are_refused() {
    for wrong in [
        segment(&[m(0, 2, 0, 0)], &[]),
        segment(&[], &[port(0, 2, 0)]),
        segment(&[], &[port(0, 0, 3)]),
        segment(&[m(1, 0, 0, 0), m(1, 1, 0, 0)], &[]),
    ] {
        assert_eq!(robot(FIG_2).apply(&wrong).expect_err("malformed").rule, Rule::Form);
    }
}

#[test]
fn refusal_in_a_program_has_the_segments_index() {
    let keep = segment(&[m(1, 0, 30, 0)], &[]);
    let divide = segment(&[m(1, 1, 0, 0)], &[]);
    let refusal =
        robot(FIG_2).apply_all([&keep, &keep, &divide], &Semantics::default()).expect_err("module 1 is alone");
    assert_eq!((refusal.segment, refusal.rule, &refusal.modules), (Some(2), Rule::Connectivity, &vec![1]));
    assert!(refusal.to_string().starts_with("segment 2: rule connectivity: the robot is in 2 pieces"), "{refusal}");
}

#[test]
fn readings_differ_as_described() {
    let cuts = |reading, turns: &[_], named: &[_]| {
        let semantics = Semantics { reading, connectivity: false, penetration: None };
        robot(FIG_2).apply_with(&segment(turns, named), &semantics).map(|step| step.cut.len())
    };
    // The moving part 1 of module 0 holds both connections. The other side of one is named.
    let turn = [m(0, 0, 0, 30)];
    let other_side = [port(1, 0, 0)];
    assert_eq!(cuts(Reading::EitherFace, &turn, &other_side), Ok(1));
    assert_eq!(cuts(Reading::MovingFace, &turn, &other_side), Ok(2));
    assert_eq!(cuts(Reading::MovingFace, &turn, &[port(0, 1, 1)]), Ok(1));
    // No angle changes.
    let still = [m(0, 0, 0, 0)];
    assert_eq!(cuts(Reading::EitherFace, &still, &[]), Ok(2));
    assert_eq!(cuts(Reading::Changed, &still, &[]), Ok(0));
    assert_eq!(cuts(Reading::Changed, &turn, &[]), Ok(2));
    // Part 0 of module 0 is free.
    assert_eq!(cuts(Reading::FixedBase, &[m(0, 1, 30, 0)], &[]), Ok(0));
    let refusal = cuts(Reading::FixedBase, &turn, &[port(0, 1, 1), port(0, 1, 2)]).expect_err("free base");
    assert_eq!((refusal.rule, refusal.modules), (Rule::Base, vec![0]));
}

#[test]
fn connection_is_kept_if_one_of_two_moving_parts_names_it() {
    let semantics = Semantics { penetration: None, ..Semantics::default() };
    let both = segment(&[m(0, 0, 0, 0), m(1, 1, 0, 0)], &[port(0, 1, 1), port(0, 1, 2)]);
    assert!(robot(FIG_2).apply_with(&both, &semantics).is_ok());
    let moving = Semantics { reading: Reading::MovingFace, ..semantics };
    assert_eq!(robot(FIG_2).apply_with(&both, &moving).expect_err("cut by module 1").rule, Rule::Connectivity);
}

#[test]
fn loop_must_stay_closed() {
    let double = robot(DOUBLE);
    assert_eq!(double.connections().len(), 2);
    let named = [port(0, 1, 1), port(0, 0, 1)];
    let alone = double.apply(&segment(&[m(0, 0, 90, 0)], &named)).expect_err("module 1 does not turn");
    assert_eq!((alone.rule, alone.modules), (Rule::Loop, vec![0, 1]));
    let against = double.apply(&segment(&[m(0, 0, 90, 0), m(1, 1, 0, -90)], &named));
    assert_eq!(against.expect_err("modules turn apart").rule, Rule::Loop);
    let together = double.apply(&segment(&[m(0, 0, 90, 0), m(1, 1, 0, 90)], &named)).expect("feasible");
    assert_eq!(together.after.connections().len(), 2);
    let other_end = together.after.part(1, 0).origin;
    assert!((other_end - nalgebra::Vector3::new(1.0, 0.0, 1.0)).norm() < 1e-12, "{other_end}");
}

#[test]
fn loop_may_be_opened_by_a_cut() {
    let step = robot(DOUBLE).apply(&segment(&[m(0, 0, 90, 0)], &[])).expect("feasible");
    assert_eq!(step.cut, BTreeSet::from([(port(0, 1, 1), port(1, 0, 2))]));
}

#[test]
fn named_faces_that_meet_connect_and_others_do_not() {
    // Part 0 of module 1 leaves part 1 of module 0 and comes back.
    let open = robot(DOUBLE).apply(&segment(&[m(0, 0, 90, 0)], &[])).expect("feasible").after;
    let back = m(0, 0, 0, 0);
    let unnamed = open.apply(&segment(&[back], &[])).expect("feasible");
    assert!(unnamed.made.is_empty());
    for face in [port(0, 1, 1), port(1, 0, 2)] {
        let named = open.apply(&segment(&[back], &[face])).expect("feasible");
        assert_eq!(named.made, BTreeSet::from([(port(0, 1, 1), port(1, 0, 2))]));
        assert_eq!(named.after.connections(), robot(DOUBLE).connections());
    }
    let both = open.apply(&segment(&[back], &[port(0, 1, 1), port(1, 0, 2)])).expect("feasible");
    assert_eq!(both.made.len(), 1);
    let elsewhere = open.apply(&segment(&[back], &[port(0, 1, 0)])).expect("feasible");
    assert!(elsewhere.made.is_empty());
}

#[test]
fn module_moves_onto_another_one_and_collides() {
    // The row rolls up: its last part would end where its second one is.
    let curl = segment(&[m(1, 0, 90, -90), m(2, 0, 90, -90), m(0, 1, 0, -90)], &[port(1, 1, 0), port(0, 1, 0)]);
    let refusal = robot(FIG_3).apply(&curl).expect_err("collision");
    assert_eq!(refusal.rule, Rule::Collision, "{refusal}");
    let unchecked = Semantics { penetration: None, ..Semantics::default() };
    assert!(robot(FIG_3).apply_with(&curl, &unchecked).is_ok());
}

#[test]
fn kept_and_made_connections_meet_after_random_segments() {
    let mut below = source(5);
    let (mut feasible, mut made) = (0, 0);
    for _ in 0..400 {
        let modules = 1 + below(6);
        let mut robot = random(modules as usize, &mut below).expect("free places");
        for _ in 0..20 {
            let Ok(step) = robot.apply(&random_segment(modules, &mut below)) else { continue };
            feasible += 1;
            made += step.made.len();
            assert!((0.0..=6.0).contains(&step.duration), "{} s", step.duration);
            robot = step.after;
            for &(a, b) in robot.connections() {
                assert!(robot.face(a).meets(&robot.face(b)), "{a:?} and {b:?}");
            }
        }
    }
    assert!(feasible > 1000 && made > 0, "{feasible} feasible segments, {made} new connections");
}
