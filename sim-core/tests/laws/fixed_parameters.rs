//! Tests of equal bounds: they keep a parameter at their value in every optimiser.

use sim_core::base::random::{Purpose, Stream};
use sim_core::problem::Job;

const OPTIMISERS: [&str; 4] = [
    "{ kind = \"pso\", particles = 5 }",
    "{ kind = \"pso-constriction\", particles = 5 }",
    "{ kind = \"ga\", population = 5 }",
    "{ kind = \"ga\", population = 5, mutation_rate = 1.0, mutation_scale = 0.9, crossover_rate = 1.0, elite = 0 }",
];

fn job(bounds: &str, optimiser: &str) -> Result<Job, String> {
    let text = format!(
        "name = \"a\"\nrobot = \"lizard\"\nenvironment = \"empty\"\nfitness = {{ kind = \"coverage\" }}\n\
         finish = {{ kind = \"none\" }}\noptimiser = {optimiser}\n\
         gaits = {{ count = 2, duration = 2.0, bounds = {{ {bounds} }} }}"
    );
    Job::from_toml(&text).map_err(|e| e.to_string())
}

#[test]
fn fixed_parameters_keep_their_value_in_every_optimiser() {
    let others = "alpha = [7.0, 7.0], beta = [0.1, 0.1], omega1 = [4.0, 4.0], omega2 = [0.3, 0.3], b = [0.5, 0.5]";
    for (bounds, fixed) in [
        ("mu = [0.5, 0.5]", 1),
        ("mu = [0.1, 0.1], omega1 = [0.0, 0.0]", 2),
        ("b = [-0.3, -0.3], alpha = [1e-9, 1e-9], beta = [0.7, 0.7]", 3),
        (others, 5),
        ("omega2 = [-1000.0, -1000.0]", 1),
    ] {
        for optimiser in OPTIMISERS {
            let job = job(bounds, optimiser).unwrap();
            let bounds_of: Vec<(f64, f64)> = job.space().bounds().collect();
            let is_fixed = |i: usize| bounds_of[i].0 == bounds_of[i].1;
            assert_eq!((0..bounds_of.len()).filter(|&i| is_fixed(i)).count() * 6, fixed * bounds_of.len(), "{bounds}");
            let mut search = job.optimiser();
            let mut random = Stream::new(5, Purpose::Sample, 0, 0, 0);
            let mut seen = search.ask().genotypes;
            for generation in 0..30 {
                let candidates = search.ask().genotypes;
                for genotype in &candidates {
                    for (i, gene) in genotype.numbers().iter().enumerate().filter(|(i, _)| is_fixed(*i)) {
                        assert_eq!(gene.to_bits(), bounds_of[i].0.to_bits(), "{bounds}, {optimiser}: {generation}");
                    }
                }
                seen.extend(candidates);
                let scores: Vec<_> = (0..5).map(|i| (i != 3).then(|| random.uniform(0.0, 9.0))).collect();
                search.tell(&search.ask().scored(&scores));
                let state = search.save();
                search.restore(&state).unwrap();
            }
            let free = (0..bounds_of.len()).find(|&i| !is_fixed(i)).unwrap();
            assert!(
                seen.iter().any(|genotype| genotype.numbers()[free] != seen[0].numbers()[free]),
                "parameters that are not fixed must vary"
            );
        }
    }
}

#[test]
fn bounds_that_leave_nothing_to_search_are_refused() {
    let ga = OPTIMISERS[2];
    let all = "mu = [0.5, 0.5], alpha = [7.0, 7.0], beta = [0.1, 0.1], omega1 = [4.0, 4.0], omega2 = [0.3, 0.3], b = [0.5, 0.5]";
    let error = job(all, ga).unwrap_err();
    assert!(error.starts_with("gaits.bounds: all parameters are fixed"), "{error}");
    for (bounds, reason) in [
        ("mu = [0.6, 0.5]", "the lower bound 0.6 lies above the upper bound 0.5; two equal bounds keep"),
        ("mu = [nan, 0.5]", "out of range"),
        ("mu = [0.5, nan]", "out of range"),
        ("mu = [inf, inf]", "out of range"),
    ] {
        let error = job(bounds, ga).unwrap_err();
        assert!(error.starts_with("gaits.bounds.mu") && error.contains(reason), "{error}");
    }
}
