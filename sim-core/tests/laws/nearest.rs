//! Comparison of the k-d tree of places with a linear scan: same index, same bits.

use proptest::prelude::*;
use sim_core::model::Place;
use sim_core::plan::{Metric, Nearest};
use std::f64::consts::PI;

/// Finds the nearest place by a linear scan, without place `but`. Ties go to the lowest index.
fn scan(metric: &Metric, places: &[Place], q: &Place, but: Option<usize>) -> Option<(usize, f64)> {
    let mut best: Option<(usize, f64)> = None;
    for (i, p) in places.iter().enumerate().filter(|(i, _)| Some(*i) != but) {
        let distance = metric.squared(p, q);
        if best.is_none_or(|b| distance < b.1) {
            best = Some((i, distance));
        }
    }
    best
}

fn bits(answer: Option<(usize, f64)>) -> Option<(usize, u64)> {
    answer.map(|(i, distance)| (i, distance.to_bits()))
}

/// Adds the places one by one. In between, compares the results of all queries with a linear scan, first among all
/// places, then without the nearest one.
fn assert_as_scanned(metric: Metric, places: &[Place], questions: &[Place]) {
    let mut tree = Nearest::new(metric);
    assert_eq!(tree.nearest(&Place::ORIGIN, None), None);
    let every = (places.len() / 40).max(1);
    for (n, place) in (1..).zip(places) {
        tree.add(*place);
        if n % every != 0 && n != places.len() {
            continue;
        }
        for q in questions.iter().chain(&places[n - 1..n]) {
            let expected = scan(&metric, &places[..n], q, None);
            assert_eq!(bits(tree.nearest(q, None)), bits(expected), "nearest of {n} places to {q:?}");
            let but = expected.map(|(i, _)| i);
            assert_eq!(
                bits(tree.nearest(q, but)),
                bits(scan(&metric, &places[..n], q, but)),
                "without {but:?}, nearest to {q:?}"
            );
        }
    }
}

/// Headings: anywhere, within a few ulps of ±π, at multiples of π/2, and beyond ±π, as a start may have them.
fn yaw() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -PI..PI,
        2 => (-40i32..40).prop_map(|ulps| {
            let bits = |from: f64| f64::from_bits(from.to_bits() - u64::from(ulps.unsigned_abs()));
            if ulps < 0 { -bits(PI) } else { bits(PI) }
        }),
        2 => (-2i32..=2).prop_map(|n| f64::from(n) * PI / 2.0),
        1 => -7.0..7.0f64,
    ]
}

/// Places: all over the map, in tight clusters, on a coarse lattice (exact ties), and far outside.
fn place() -> impl Strategy<Value = Place> {
    let anywhere = (-24.0..24.0f64, -13.5..13.5f64, 0.0..3.0f64);
    let cluster = (-2i32..=2, -2i32..=2, 0i32..=1, -1e-9..1e-9f64)
        .prop_map(|(x, y, z, e)| (f64::from(x) * 5.0 + e, f64::from(y) * 5.0 - e, f64::from(z)));
    let lattice = (-3i32..=3, -3i32..=3, 0i32..=1).prop_map(|(x, y, z)| (x.into(), y.into(), z.into()));
    let far = (-1e200..1e200f64, -1e9..1e9f64, Just(0.0));
    let position = prop_oneof![6 => anywhere, 3 => cluster, 4 => lattice, 1 => far];
    (position, yaw()).prop_map(|((x, y, z), yaw)| Place { x, y, z, yaw })
}

fn metric() -> impl Strategy<Value = Metric> {
    let weight = prop_oneof![Just(0.0), Just(0.5), Just(1000.0), 0.0..10.0f64];
    let height = prop_oneof![Just(0.0), Just(1.0), Just(1000.0), 0.0..10.0f64];
    (weight, height).prop_map(|(yaw_weight, z)| Metric { yaw_weight, z, ..Metric::default() })
}

proptest! {
    #[test]
    fn kd_tree_matches_linear_scan(
        metric in metric(),
        places in prop::collection::vec(place(), 1..400),
        questions in prop::collection::vec(place(), 1..12),
    ) {
        assert_as_scanned(metric, &places, &questions);
    }

    #[test]
    fn kd_tree_matches_linear_scan_with_duplicate_points(
        metric in metric(),
        few in prop::collection::vec(place(), 1..4),
        picks in prop::collection::vec(0usize..4, 1..300),
        questions in prop::collection::vec(place(), 1..6),
    ) {
        let places: Vec<Place> = picks.iter().map(|&i| few[i % few.len()]).collect();
        assert_as_scanned(metric, &places, &questions);
    }

    #[test]
    fn kd_tree_matches_linear_scan_with_nonfinite_numbers(
        places in prop::collection::vec(place(), 1..60),
        at in 0usize..60,
        broken in prop::sample::select(vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY]),
        questions in prop::collection::vec(place(), 1..4),
    ) {
        let metric = Metric { yaw_weight: 0.5, ..Metric::default() };
        let mut with = places.clone();
        with[at % places.len()].x = broken;
        assert_as_scanned(metric, &with, &questions);
        assert_as_scanned(metric, &places, &[Place { yaw: broken, ..questions[0] }]);
    }
}

#[test]
fn kd_tree_matches_linear_scan_on_degenerate_sets() {
    let metric = Metric { yaw_weight: 0.5, z: 1.0, ..Metric::default() };
    let line = |i: i32| Place { x: f64::from(i) * 0.25, ..Place::ORIGIN };
    let questions: Vec<Place> = (-3..20).map(|i| Place { x: f64::from(i) * 50.125, ..Place::ORIGIN }).collect();
    let rising: Vec<Place> = (0..3000).map(line).collect();
    let falling: Vec<Place> = (0..3000).rev().map(line).collect();
    let outwards: Vec<Place> = (0..3000).map(|i| line(if i % 2 == 0 { i } else { -i })).collect();
    let turning: Vec<Place> = (0..3000).map(|i| Place { yaw: -PI + f64::from(i) * 2e-3, ..Place::ORIGIN }).collect();
    for places in [rising, falling, outwards, turning, vec![Place::ORIGIN; 3000]] {
        assert_as_scanned(metric, &places, &questions);
    }
}
