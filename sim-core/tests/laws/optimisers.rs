//! Tests of the optimisers: functions with known optima, and invariants of all optimisers.

use proptest::prelude::*;
use sim_core::base::digest::Digest;
use sim_core::base::error::Invalid;
use sim_core::base::score::Direction;
use sim_core::genotype::{Genotype, Space};
use sim_core::search::{OptimiserSpec, Search, build};
use std::f64::consts::PI;

/// Σ xᵢ². Minimum 0 at the origin; searched in ±5.12.
fn sphere(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum()
}

/// Σ 100 (xᵢ₊₁ − xᵢ²)² + (1 − xᵢ)². Minimum 0 at (1, …, 1), at the end of a curved valley; searched in ±2.048.
fn rosenbrock(x: &[f64]) -> f64 {
    let squared = |v: f64| v * v;
    x.windows(2).map(|x| 100.0 * squared(x[1] - x[0] * x[0]) + squared(1.0 - x[0])).sum()
}

/// 10 n + Σ xᵢ² − 10 cos 2πxᵢ. Minimum 0 at the origin, with a local one near every whole number; searched in ±5.12.
fn rastrigin(x: &[f64]) -> f64 {
    x.iter().map(|x| 10.0 + x * x - 10.0 * libm::cos(2.0 * PI * x)).sum()
}

fn spec(kind: &str, size: u32) -> OptimiserSpec {
    let size_field = if kind == "ga" { "population" } else { "particles" };
    toml::from_str(&format!("kind = '{kind}'\n{size_field} = {size}")).unwrap()
}

const KINDS: [&str; 3] = ["pso", "pso-constriction", "ga"];

fn cube(half: f64, dimensions: usize) -> Space {
    Space::of_reals(vec![(-half, half); dimensions])
}

/// Runs a search and returns the candidates of each generation.
fn path(optimiser: &mut dyn Search, generations: u32, f: impl Fn(&[f64]) -> Option<f64>) -> Vec<Vec<Genotype>> {
    (0..generations)
        .map(|_| {
            let batch = optimiser.ask();
            let scores: Vec<_> = batch.genotypes.iter().map(|x| f(x.numbers())).collect();
            optimiser.tell(&batch.clone().scored(&scores));
            batch.genotypes
        })
        .collect()
}

/// Returns the smallest value that a search found.
fn least(spec: &OptimiserSpec, space: Space, generations: u32, seed: u64, f: impl Fn(&[f64]) -> f64) -> f64 {
    let mut optimiser = build(spec, space, Direction::Minimise, seed);
    let candidates = path(&mut *optimiser, generations, |x| Some(f(x)));
    candidates.iter().flatten().map(|x| f(x.numbers())).fold(f64::INFINITY, f64::min)
}

/// Returns the median of [`least`] over nine seeds, so that a single run does not decide.
fn median_least(spec: &OptimiserSpec, space: Space, generations: u32, f: impl Fn(&[f64]) -> f64) -> f64 {
    let mut found: Vec<f64> = (1..=9).map(|seed| least(spec, space.clone(), generations, seed, &f)).collect();
    found.sort_by(f64::total_cmp);
    found[4]
}

/// A correct implementation reaches these limits with a margin. A broken one (no social term, no mutation, candidates
/// that stay at a bound) does not.
#[test]
fn known_optima_are_found() {
    let stated = [
        // kind, sphere in 5 dimensions, Rosenbrock in 3, Rastrigin in 3
        ("pso", 1e-20, 0.1, 1e-9),
        ("pso-constriction", 1e-10, 0.01, 1e-9),
        ("ga", 1e-3, 0.1, 1e-2),
    ];
    for (kind, sphere_value, rosenbrock_value, rastrigin_value) in stated {
        let spec = spec(kind, 40);
        for (name, found, stated) in [
            ("sphere", median_least(&spec, cube(5.12, 5), 200, sphere), sphere_value),
            ("Rosenbrock", median_least(&spec, cube(2.048, 3), 400, rosenbrock), rosenbrock_value),
            ("Rastrigin", median_least(&spec, cube(5.12, 3), 300, rastrigin), rastrigin_value),
        ] {
            assert!(found < stated, "{kind} on {name}: {found:e}, limit {stated:e}");
        }
    }
}

/// Optimisers that clamp positions reach an optimum at a corner exactly. Those that reflect positions come near.
#[test]
fn optima_at_the_bounds_are_found() {
    let sum = |x: &[f64]| x.iter().sum::<f64>();
    for kind in KINDS {
        let found = median_least(&spec(kind, 20), cube(1.0, 4), 100, sum);
        assert!((-4.0..-3.99).contains(&found), "{kind}: {found}");
    }
}

#[test]
fn all_candidates_stay_within_the_bounds() {
    let space = Space::of_reals([(-1.0, 1.0), (3.0, 3.5), (-1e-9, 1e9), (2.0, 2.0)]);
    for kind in KINDS {
        let mut optimiser = build(&spec(kind, 15), space.clone(), Direction::Maximise, 11);
        for candidate in path(&mut *optimiser, 60, |x| Some(sphere(x))).into_iter().flatten() {
            assert_eq!(space.check(&candidate), Ok(()), "{kind}");
        }
    }
}

#[test]
fn restored_optimiser_continues_with_the_same_bits() {
    for kind in KINDS {
        for failures in [false, true] {
            // With failures, some particles have no best yet when the state is stored.
            let score = |x: &[f64]| (!failures || x[0] > 0.3).then(|| rastrigin(x));
            let make = || build(&spec(kind, 7), cube(5.12, 6), Direction::Minimise, 5);
            let mut first = make();
            path(&mut *first, 9, score);
            let mut second = make();
            second.restore(&first.save()).unwrap();
            assert_eq!(second.generation(), 9);
            assert_eq!(second.save(), first.save());
            assert_eq!(path(&mut *first, 9, score), path(&mut *second, 9, score));
        }
    }
}

#[test]
fn candidates_are_repeatable_and_depend_on_the_seed() {
    for kind in KINDS {
        let one = build(&spec(kind, 7), cube(5.12, 6), Direction::Minimise, 5);
        assert_eq!(one.ask(), one.ask());
        assert_ne!(one.ask(), build(&spec(kind, 7), cube(5.12, 6), Direction::Minimise, 6).ask());
    }
}

#[test]
fn mismatched_states_are_refused_without_effect() {
    let make =
        |kind, size, dimensions, seed| build(&spec(kind, size), cube(1.0, dimensions), Direction::Maximise, seed);
    for kind in KINDS {
        let mut optimiser = make(kind, 6, 3, 1);
        path(&mut *optimiser, 2, |x| Some(sphere(x)));
        let good = optimiser.save();
        let other = if kind == "ga" { "pso" } else { "ga" };
        let with_nan = {
            let mut bytes = good.clone();
            let end = bytes.len();
            bytes[end - 8..].copy_from_slice(&f64::NAN.to_bits().to_le_bytes());
            bytes
        };
        let out_of_bounds = {
            let mut bytes = good.clone();
            let end = bytes.len();
            bytes[end - 8..].copy_from_slice(&1.5f64.to_bits().to_le_bytes());
            bytes
        };
        for (bad, says) in [
            (Vec::new(), "first bytes"),
            (good[..20].to_vec(), "ends after 20 bytes"),
            (good[..good.len() - 1].to_vec(), "bytes instead of"),
            ([&good[..], &[0]].concat(), "bytes instead of"),
            (make(other, 6, 3, 1).save(), "another kind"),
            (make(kind, 7, 3, 1).save(), "7 candidates"),
            (make(kind, 6, 4, 1).save(), "4 parameters"),
            (make(kind, 6, 3, 2).save(), "seed is 2"),
            (with_nan, "NaN"),
            (out_of_bounds, "out of its bounds"),
        ] {
            let error = optimiser.restore(&bad).unwrap_err().to_string();
            assert!(error.contains(says), "{kind}: \"{error}\" must contain \"{says}\"");
            assert_eq!(optimiser.save(), good);
        }
    }
}

/// Evaluations in one part of the space always fail, although it has the better values. The search must not settle
/// there.
#[test]
fn failed_evaluation_never_becomes_the_best() {
    for kind in KINDS {
        for failed in [None, Some(f64::NAN)] {
            // Maximises x₀. Everything above 0.5 fails, so the search must settle below.
            let score = |x: &[f64]| if x[0] > 0.5 { failed } else { Some(x[0]) };
            let mut optimiser = build(&spec(kind, 30), cube(1.0, 2), Direction::Maximise, 2);
            let candidates = path(&mut *optimiser, 60, score);
            let best = candidates.iter().flatten().filter_map(|x| score(x.numbers())).fold(f64::NEG_INFINITY, f64::max);
            assert!(best > 0.49, "{kind}: {best}");
            let last = &candidates[59];
            let failing = last.iter().filter(|x| x.numbers()[0] > 0.5).count();
            assert!(failing < 25, "{kind}: {failing} of the last 30 candidates fail");
        }
        let mut optimiser = build(&spec(kind, 4), cube(1.0, 2), Direction::Maximise, 2);
        path(&mut *optimiser, 3, |_| None);
        assert_eq!(optimiser.generation(), 3, "{kind} must continue if all evaluations fail");
    }
}

#[test]
#[should_panic(expected = "one evaluation")]
fn missing_evaluation_causes_a_panic() {
    build(&spec("pso", 4), cube(1.0, 2), Direction::Maximise, 2).tell(&[]);
}

/// Stored and published runs depend on these digests. Only a change that is meant to change results may change them.
#[test]
fn search_paths_have_their_recorded_digests() {
    let hash = |kind| {
        let mut optimiser = build(&spec(kind, 10), cube(5.12, 4), Direction::Minimise, 2016);
        Digest::of("optimiser path", &path(&mut *optimiser, 20, |x| Some(rastrigin(x)))).short()
    };
    assert_eq!(KINDS.map(hash), ["15af5f3b9031", "2350e7cd134a", "f35b301a3852"]);
}

#[test]
fn settings_out_of_range_are_refused_by_name() {
    let refused = |text: &str| match toml::from_str::<OptimiserSpec>(text).unwrap().validate() {
        Err(
            Invalid::OutOfRange { field, .. }
            | Invalid::WholeOutOfRange { field, .. }
            | Invalid::Conflict { field, .. },
        ) => field,
        other => panic!("{text}: {other:?}"),
    };
    for (text, field) in [
        ("kind = 'pso'\nparticles = 0", "optimiser.particles"),
        ("kind = 'pso'\nparticles = 10001", "optimiser.particles"),
        ("kind = 'pso'\ngenerations = 0", "optimiser.generations"),
        ("kind = 'pso'\ngenerations = 1000001", "optimiser.generations"),
        ("kind = 'pso'\ninertia_weight = nan", "optimiser.inertia_weight"),
        ("kind = 'pso'\ncognitive = -0.1", "optimiser.cognitive"),
        ("kind = 'pso'\nsocial = inf", "optimiser.social"),
        ("kind = 'pso-constriction'\ncognitive = 2\nsocial = 2", "optimiser.cognitive"),
        ("kind = 'ga'\npopulation = 1", "optimiser.population"),
        ("kind = 'ga'\npopulation = 5\nelite = 5", "optimiser.elite"),
        ("kind = 'ga'\npopulation = 5\ntournament = 6", "optimiser.tournament"),
        ("kind = 'ga'\ntournament = 0", "optimiser.tournament"),
        ("kind = 'ga'\ncrossover_rate = 1.1", "optimiser.crossover_rate"),
        ("kind = 'ga'\ncrossover_eta = nan", "optimiser.crossover_eta"),
        ("kind = 'ga'\nmutation_rate = -1", "optimiser.mutation_rate"),
        ("kind = 'ga'\nmutation_scale = 2", "optimiser.mutation_scale"),
    ] {
        assert_eq!(refused(text), field);
    }
    for kind in KINDS {
        assert_eq!(spec(kind, 20).validate(), Ok(()), "the defaults of {kind}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    /// Optimisers use only the order of scores, so adding a constant changes nothing. Values on a grid of 1/1024 keep
    /// the addition exact.
    #[test]
    fn translation_of_the_objective_changes_nothing(seed: u64, constant in -1_000_000i32..1_000_000, kind in 0usize..3) {
        let f = |x: &[f64]| (rastrigin(x) * 1024.0).round() / 1024.0;
        let run = |c: f64| {
            let mut optimiser = build(&spec(KINDS[kind], 8), cube(5.12, 3), Direction::Minimise, seed);
            path(&mut *optimiser, 15, |x| Some(f(x) + c))
        };
        prop_assert_eq!(run(0.0), run(constant.into()));
    }

    /// Minimising f is the same as maximising −f.
    #[test]
    fn minimising_is_maximising_the_negative(seed: u64, kind in 0usize..3) {
        let run = |direction, sign: f64| {
            let mut optimiser = build(&spec(KINDS[kind], 8), cube(5.12, 3), direction, seed);
            path(&mut *optimiser, 15, |x| (x[1] < 4.0).then(|| sign * rosenbrock(x)))
        };
        prop_assert_eq!(run(Direction::Minimise, 1.0), run(Direction::Maximise, -1.0));
    }
}
