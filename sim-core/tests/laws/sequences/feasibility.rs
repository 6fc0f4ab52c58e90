//! Share of random segments that keep the robot of Fig. 2 connected.

use super::{FIG_2, random_segment, robot, source};
use sim_core::control::sequence::{Reading, Rule, Semantics};
use std::collections::BTreeMap;

const DRAWS: u32 = 100_000;

#[test]
fn shares_of_connected_segments_match_the_expected_ones() {
    let start = robot(FIG_2);
    // Exact shares, from an enumeration of all draws.
    let expected = [
        (Reading::EitherFace, 0.3480),
        (Reading::MovingFace, 0.3175),
        (Reading::Changed, 0.3572),
        (Reading::FixedBase, 7.0 / 24.0),
    ];
    let mut found = Vec::new();
    for (reading, share) in expected {
        let semantics = Semantics { reading, penetration: None, ..Semantics::default() };
        let mut below = source(1);
        let feasible =
            (0..DRAWS).filter(|_| start.apply_with(&random_segment(3, &mut below), &semantics).is_ok()).count();
        let measured = feasible as f64 / f64::from(DRAWS);
        println!("{}: {measured:.4}, expected {share:.4}", reading.name());
        found.push((reading, measured, share));
    }
    for (reading, measured, share) in found {
        assert!((measured - share).abs() < 0.005, "{}: {measured} instead of {share}", reading.name());
    }
}

#[test]
fn collisions_refuse_some_connected_segments() {
    let start = robot(FIG_2);
    let mut below = source(2);
    let mut counts: BTreeMap<&str, u32> = BTreeMap::new();
    for _ in 0..20_000 {
        let key =
            start.apply(&random_segment(3, &mut below)).map_or_else(|refusal| refusal.rule.name(), |_| "feasible");
        *counts.entry(key).or_default() += 1;
    }
    println!("{counts:?}");
    assert!(counts["feasible"] > 0 && counts[Rule::Connectivity.name()] > 0);
}

/// Programs of ten segments that each keep the robot connected: about 39 % make modules overlap.
#[test]
fn collisions_refuse_a_third_of_connected_programs() {
    const PROGRAMS: u32 = 2_000;
    let start = robot(FIG_2);
    let mut below = source(3);
    let connected = Semantics { penetration: None, ..Semantics::default() };
    let mut colliding = 0;
    for _ in 0..PROGRAMS {
        let mut program = Vec::new();
        while program.len() < 10 {
            let segment = random_segment(3, &mut below);
            if start.apply_with(&segment, &connected).is_ok() {
                program.push(segment);
            }
        }
        let refused = start.apply_all(&program, &Semantics::default()).err();
        colliding += u32::from(refused.is_some_and(|refusal| refusal.rule == Rule::Collision));
    }
    let share = f64::from(colliding) / f64::from(PROGRAMS);
    println!("{share:.3} of {PROGRAMS} programs collide");
    assert!((share - 0.39).abs() < 0.03, "{share}");
}
