//! Tests of the genetic algorithm on sequences of segments: a toy space with a known optimum, and invariants.

use proptest::prelude::*;
use sim_core::base::digest::Digest;
use sim_core::base::error::Invalid;
use sim_core::base::random::Stream;
use sim_core::base::score::Direction;
use sim_core::genotype::{Gene, Genotype, Length, NamedGene, NoRules, Rules, Space};
use sim_core::search::{OptimiserSpec, Search, build, build_with};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Number of options of a segment's tag.
const TAGS: u32 = 4;

/// Space of sequences whose segments have a tag and a number.
fn sequences(least: u32, most: u32) -> Space {
    let tag = NamedGene { name: "tag".into(), unit: "", gene: Gene::Choice { options: TAGS } };
    let x = NamedGene { name: "x".into(), unit: "", gene: Gene::Real { low: 0.0, high: 1.0 } };
    Space { genes: vec![tag, x], length: Length::Sequence { least, most } }
}

fn segments(genotype: &Genotype) -> std::slice::Chunks<'_, f64> {
    genotype.numbers().chunks(2)
}

/// Number of segments whose tag is their index modulo [`TAGS`]. Its maximum is the greatest length.
fn matches(genotype: &Genotype) -> f64 {
    segments(genotype).zip(0u32..).filter(|(segment, i)| segment[0] == f64::from(i % TAGS)).count() as f64
}

fn spec(settings: &str) -> OptimiserSpec {
    let spec: OptimiserSpec = toml::from_str(&format!("kind = 'sequence-ga'\n{settings}")).unwrap();
    assert_eq!(spec.validate(), Ok(()));
    spec
}

/// Eight individuals with 4 crossover children and 2 mutants a generation.
fn small() -> OptimiserSpec {
    spec("population = 8\nelite = 1\nranked = 3\nrandom = 4\nmutation_rate = 0.25")
}

/// Runs a search and returns the candidates of each generation.
fn path(search: &mut dyn Search, generations: u32, f: impl Fn(&Genotype) -> Option<f64>) -> Vec<Vec<Genotype>> {
    (0..generations)
        .map(|_| {
            let batch = search.ask();
            let scores: Vec<_> = batch.genotypes.iter().map(&f).collect();
            search.tell(&batch.clone().scored(&scores));
            batch.genotypes
        })
        .collect()
}

/// Returns the median over nine seeds of the best score that a search finds.
fn median_best(spec: &OptimiserSpec, space: &Space) -> f64 {
    let best = |seed| {
        let mut search = build(spec, space.clone(), Direction::Maximise, seed);
        let candidates = path(&mut *search, spec.generations(), |genotype| Some(matches(genotype)));
        candidates.iter().flatten().map(matches).fold(0.0, f64::max)
    };
    let mut found: Vec<f64> = (1..=9).map(best).collect();
    found.sort_by(f64::total_cmp);
    found[4]
}

/// With the paper's two mutants a generation, new segments are rare. The settings of more small mutations find the
/// optimum.
#[test]
fn known_optimum_is_approached() {
    let alone = "generations = 1\npopulation = 1118\nelite = 1118\nranked = 0\nrandom = 0";
    for space in [sequences(10, 10), sequences(2, 10)] {
        let drawn = median_best(&spec(alone), &space);
        let paper = median_best(&spec(""), &space);
        let better = median_best(&spec("mutation_rate = 0.5\nmutated = 1"), &space);
        assert!(drawn <= 7.0 && paper > drawn && better == 10.0, "{:?}: {drawn}, {paper}, {better}", space.length);
    }
}

#[test]
fn generations_have_the_number_of_candidates_of_the_rates() {
    for (settings, first, later) in [
        ("", 40, 22),
        ("mutation_rate = 0.5", 40, 40),
        ("crossover_rate = 0", 40, 2),
        ("mutation_rate = 0", 40, 20),
        ("population = 10\nelite = 0\nranked = 0\nrandom = 10\ncrossover_rate = 0.3", 10, 4),
    ] {
        let spec = spec(settings);
        let mut search = build(&spec, sequences(3, 5), Direction::Maximise, 1);
        let sizes: Vec<u32> = path(&mut *search, 4, |_| Some(1.0)).iter().map(|all| all.len() as u32).collect();
        assert_eq!(sizes, [first, later, later, later], "{settings}");
        assert_eq!((0..4).map(|generation| spec.candidates(generation)).collect::<Vec<_>>(), sizes, "{settings}");
        assert_eq!([0, 1, 4].map(|n| spec.evaluations(n)), [0, first.into(), u64::from(first + 3 * later)]);
        assert_eq!(spec.population(), first);
    }
    assert_eq!((spec("").generations(), spec("").evaluations(50)), (50, 1118));
}

#[test]
fn mutants_differ_from_a_parent_in_the_set_number_of_segments() {
    let spec = spec("crossover_rate = 0\nmutation_rate = 0.5\nmutated = 2");
    let mut search = build(&spec, sequences(6, 6), Direction::Maximise, 3);
    let generations = path(&mut *search, 6, |genotype| Some(matches(genotype)));
    for (g, generation) in generations.iter().enumerate().skip(1) {
        for mutant in generation {
            let differing = |parent: &Genotype| segments(parent).zip(segments(mutant)).filter(|(a, b)| a != b).count();
            let parents = || generations[..g].iter().flatten();
            assert!(parents().any(|parent| differing(parent) == 2), "generation {g}");
            assert!(parents().all(|parent| differing(parent) >= 1), "generation {g}");
        }
    }
}

/// Segments with tag 0 need a large number; segments that follow each other need different tags.
#[derive(Debug)]
struct Apart;

impl Apart {
    fn keeps(segment: &[f64]) -> bool {
        segment[0] != 0.0 || segment[1] > 0.5
    }
}

impl Rules for Apart {
    fn draw(&self, space: &Space, random: &mut Stream) -> Vec<f64> {
        loop {
            let segment = space.draw_segment(random);
            if Self::keeps(&segment) {
                return segment;
            }
        }
    }

    fn allows(&self, _: &Space, genotype: &Genotype) -> bool {
        let all: Vec<&[f64]> = segments(genotype).collect();
        all.iter().all(|segment| Self::keeps(segment)) && all.windows(2).all(|pair| pair[0][0] != pair[1][0])
    }
}

#[test]
fn all_candidates_keep_the_rules() {
    let spec = spec("mutation_rate = 0.5");
    for space in [sequences(8, 8), sequences(1, 9)] {
        let mut search = build_with(&spec, space.clone(), Arc::new(Apart), Direction::Maximise, 5);
        for genotype in path(&mut *search, 20, |genotype| Some(matches(genotype))).iter().flatten() {
            assert!(Apart.allows(&space, genotype), "{genotype:?}");
        }
        assert_eq!(search.copies(), 0);
    }
}

/// Rules that forbid everything once they are closed.
#[derive(Debug, Default)]
struct Closing(AtomicBool);

impl Rules for Closing {
    fn draw(&self, space: &Space, random: &mut Stream) -> Vec<f64> {
        space.draw_segment(random)
    }

    fn allows(&self, _: &Space, _: &Genotype) -> bool {
        !self.0.load(Ordering::Relaxed)
    }
}

#[test]
fn copies_of_parents_replace_children_that_rules_forbid() {
    let rules = Arc::new(Closing::default());
    let make = || build_with(&small(), sequences(3, 5), rules.clone(), Direction::Maximise, 5);
    let (mut search, mut restored) = (make(), make());
    rules.0.store(true, Ordering::Relaxed);
    let generations = path(&mut *search, 3, |genotype| Some(matches(genotype)));
    assert!(generations[1..].iter().flatten().all(|child| generations[0].contains(child)));
    // Three generations of six children, of which the last is not evaluated yet.
    assert_eq!(search.copies(), 18);
    restored.restore(&search.save()).unwrap();
    assert_eq!(restored.copies(), 18);
}

#[test]
fn rules_that_forbid_everything_leave_a_whole_population() {
    let rules = Arc::new(Closing(AtomicBool::new(true)));
    let space = sequences(3, 5);
    let search = build_with(&small(), space.clone(), rules, Direction::Maximise, 5);
    let drawn = search.ask().genotypes;
    assert!(drawn.len() == 8 && drawn.iter().all(|genotype| space.check(genotype).is_ok()));
}

#[test]
fn space_without_rules_is_searched_as_with_none() {
    let make = |rules: Option<Arc<dyn Rules>>| match rules {
        Some(rules) => build_with(&small(), sequences(2, 6), rules, Direction::Maximise, 5),
        None => build(&small(), sequences(2, 6), Direction::Maximise, 5),
    };
    let run = |rules| path(&mut *make(rules), 5, |genotype| Some(matches(genotype)));
    assert_eq!(run(None), run(Some(Arc::new(NoRules))));
}

#[test]
fn restored_search_continues_with_the_same_bits() {
    for space in [sequences(6, 6), sequences(0, 7)] {
        for failures in [false, true] {
            for before in [0, 1, 9] {
                let score = |genotype: &Genotype| {
                    let first = genotype.numbers().get(1).copied().unwrap_or(1.0);
                    (!failures || first > 0.3).then(|| matches(genotype) - first)
                };
                let make = || build(&small(), space.clone(), Direction::Minimise, 5);
                let mut first = make();
                path(&mut *first, before, score);
                let mut second = make();
                second.restore(&first.save()).unwrap();
                assert_eq!(second.generation(), before);
                assert_eq!(second.save(), first.save());
                assert_eq!(path(&mut *first, 9, score), path(&mut *second, 9, score));
                assert_eq!(second.save(), first.save());
            }
        }
    }
}

#[test]
fn candidates_are_repeatable_and_depend_on_the_seed() {
    let make = |seed| build(&small(), sequences(3, 6), Direction::Minimise, seed);
    assert_eq!(make(5).ask(), make(5).ask());
    assert_ne!(make(5).ask(), make(6).ask());
}

#[test]
fn mismatched_states_are_refused_without_effect() {
    let make = |settings: &str, space, seed, generations| {
        let mut search = build(&spec(settings), space, Direction::Maximise, seed);
        path(&mut *search, generations, |genotype| Some(matches(genotype)));
        search
    };
    let settings = "population = 8\nelite = 1\nranked = 3\nrandom = 4\n";
    let other = |size: u32| format!("population = {size}\nelite = {size}\nranked = 0\nrandom = 0");
    let mut search = make(settings, sequences(3, 6), 1, 2);
    let good = search.save();
    let three_genes = {
        let mut space = sequences(3, 6);
        space.genes.push(space.genes[1].clone());
        space
    };
    let ga: OptimiserSpec = toml::from_str("kind = 'ga'").unwrap();
    let of_ga = build(&ga, Space::of_reals([(0.0, 1.0)]), Direction::Maximise, 1).save();
    // One byte each: format, seed, generation, size, genes, number of individuals, number of numbers. Then the first
    // individual's tag, then its x.
    let with_first_x = |value: f64| {
        let mut bytes = good.clone();
        bytes[7 + 8..][..8].copy_from_slice(&value.to_bits().to_le_bytes());
        bytes
    };
    for (bad, says) in [
        (Vec::new(), "it is empty"),
        (of_ga, "another kind of value"),
        (good[..20].to_vec(), "can't be decoded"),
        (good[..good.len() - 1].to_vec(), "can't be decoded"),
        ([&good[..], &[0]].concat(), "not canonical"),
        (make(&other(7), sequences(3, 6), 1, 2).save(), "7 individuals with segments of 2 parameters"),
        (make(settings, three_genes, 1, 2).save(), "8 individuals with segments of 3 parameters"),
        (make(settings, sequences(3, 6), 2, 2).save(), "seed is 2"),
        (make(&format!("{settings}mutation_rate = 0.5"), sequences(3, 6), 1, 2).save(), "8 candidates at generation 2"),
        (make(settings, sequences(9, 9), 1, 2).save(), "it has 18 numbers; 6 to 12 in steps of 2 are needed"),
        (with_first_x(f64::NAN), "its number 1 (x) is not finite"),
        (with_first_x(1.5), "its number 1 (x) is 1.5: allowed is 0 to 1"),
    ] {
        let error = search.restore(&bad).unwrap_err().to_string();
        assert!(error.contains(says), "\"{error}\" must contain \"{says}\"");
        assert_eq!(search.save(), good);
    }
    let mut ga = build(&ga, Space::of_reals([(0.0, 1.0)]), Direction::Maximise, 1);
    assert!(ga.restore(&good).unwrap_err().to_string().contains("first bytes"));
}

#[test]
fn failed_evaluations_never_become_the_best() {
    for failed in [None, Some(f64::NAN)] {
        let fails = |genotype: &Genotype| genotype.numbers()[0] == 0.0;
        let score = |genotype: &Genotype| if fails(genotype) { failed } else { Some(matches(genotype)) };
        let spec = spec("mutation_rate = 0.5\nmutated = 1");
        let mut search = build(&spec, sequences(6, 6), Direction::Maximise, 2);
        let candidates = path(&mut *search, 50, score);
        // The first segment's tag must be 0 to match, so one match less is possible.
        let best = candidates.iter().flatten().filter(|it| !fails(it)).map(matches).fold(0.0, f64::max);
        assert_eq!(best, 5.0);
    }
    let mut search = build(&small(), sequences(2, 4), Direction::Maximise, 2);
    path(&mut *search, 3, |_| None);
    assert_eq!(search.generation(), 3, "the search must continue if all evaluations fail");
}

#[test]
fn genotype_other_than_sent_becomes_parent() {
    let spec = spec("population = 2\nelite = 2\nranked = 0\nrandom = 0\ncrossover_rate = 1\nmutation_rate = 0");
    let mut search = build(&spec, sequences(2, 2), Direction::Maximise, 9);
    let mut evaluations = search.ask().scored(&[Some(1.0), Some(2.0)]);
    evaluations[0].genotype = vec![1.0, 0.125, 1.0, 0.25].into();
    evaluations[1].genotype = vec![2.0, 0.5, 2.0, 0.75].into();
    search.tell(&evaluations);
    let mut children = search.ask().genotypes;
    children.sort_by(|a, b| a.numbers()[0].total_cmp(&b.numbers()[0]));
    assert_eq!(children[0].numbers(), [1.0, 0.125, 2.0, 0.75]);
    assert_eq!(children[1].numbers(), [2.0, 0.5, 1.0, 0.25]);
}

#[test]
#[should_panic(expected = "one evaluation")]
fn evaluations_of_a_whole_population_cause_a_panic_later() {
    let mut search = build(&spec(""), sequences(2, 2), Direction::Maximise, 2);
    let whole = search.ask().scored(&[Some(1.0); 40]);
    search.tell(&whole);
    search.tell(&whole);
}

/// Stored and published runs depend on these digests. Only a change that is meant to change results may change them.
#[test]
fn search_paths_have_their_recorded_digests() {
    let hash = |settings, space| {
        let mut search = build(&spec(settings), space, Direction::Maximise, 2003);
        Digest::of("optimiser path", &path(&mut *search, 20, |genotype| Some(matches(genotype)))).short()
    };
    let found = [hash("", sequences(10, 10)), hash("mutation_rate = 0.2\nmutated = 1", sequences(3, 9))];
    assert_eq!(found, ["c1dce2c3b1c7", "b5fb398530ad"]);
}

#[test]
fn settings_out_of_range_are_refused_by_name() {
    let refused = |text: &str| {
        let spec: OptimiserSpec = toml::from_str(&format!("kind = 'sequence-ga'\n{text}")).unwrap();
        spec.validate().unwrap_err().to_string()
    };
    for (text, says) in [
        ("population = 1\nelite = 1\nranked = 0\nrandom = 0", "optimiser.population = 1 is out of range"),
        ("generations = 0", "optimiser.generations = 0 is out of range"),
        ("elite = 10001", "optimiser.elite = 10001 is out of range"),
        ("pressure = 0.9", "optimiser.pressure = 0.9 is out of range: allowed is 1 to 2"),
        ("pressure = 2.5", "optimiser.pressure = 2.5 is out of range: allowed is 1 to 2"),
        ("mutated = 0", "optimiser.mutated = 0 is out of range"),
        ("crossover_rate = 1.5", "optimiser.crossover_rate = 1.5 is out of range"),
        ("mutation_rate = nan", "optimiser.mutation_rate = NaN is out of range"),
        (
            "random = 20",
            "optimiser.elite: elite + ranked + random must be the population, and here 4 + 12 + 20 = 36 is not 40",
        ),
        (
            "crossover_rate = 0\nmutation_rate = 0.01",
            "optimiser.crossover_rate: crossover_rate and mutation_rate give 0 + 0 = 0 children a generation: allowed \
             is 1 to 40",
        ),
        ("crossover_rate = 1", "give 40 + 2 = 42 children a generation"),
    ] {
        let said = refused(text);
        assert!(said.contains(says), "\"{said}\" must contain \"{says}\"");
    }
}

#[test]
fn kinds_accept_only_their_spaces() {
    let refused = |found: Result<(), Invalid>| found.unwrap_err().to_string();
    assert_eq!(
        refused(spec("").takes(&Space::of_reals([(0.0, 1.0)]))),
        "optimiser.kind: \"sequence-ga\" searches sequences of segments, and the genotypes of this job have a fixed \
         length: choose another kind, or another controller"
    );
    assert_eq!(spec("").takes(&sequences(2, 4)), Ok(()));
    let ga: OptimiserSpec = toml::from_str("kind = 'ga'").unwrap();
    assert!(refused(ga.takes(&sequences(2, 4))).contains("sequences of segments"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]

    #[test]
    fn all_candidates_stay_in_the_space(
        least in 0u32..5, more in 0u32..6, crossover in 0.0..0.6, mutated in prop::option::of(1u32..12), seed: u64,
    ) {
        let mutated = mutated.map_or(String::new(), |mutated| format!("mutated = {mutated}"));
        let spec = spec(&format!("crossover_rate = {crossover}\nmutation_rate = 0.3\n{mutated}"));
        let space = sequences(least, least + more);
        let mut search = build(&spec, space.clone(), Direction::Maximise, seed);
        for genotype in path(&mut *search, 8, |genotype| Some(matches(genotype))).iter().flatten() {
            prop_assert_eq!(space.check(genotype), Ok(()));
        }
    }

    /// The search uses only the order of scores.
    #[test]
    fn translation_of_the_objective_changes_nothing(seed: u64, constant in -1_000_000i32..1_000_000) {
        let run = |c: f64| {
            let mut search = build(&small(), sequences(2, 6), Direction::Minimise, seed);
            path(&mut *search, 15, |genotype| Some(matches(genotype) + c))
        };
        prop_assert_eq!(run(0.0), run(constant.into()));
    }

    /// Minimising f is the same as maximising −f.
    #[test]
    fn minimising_is_maximising_the_negative(seed: u64) {
        let run = |direction, sign: f64| {
            let mut search = build(&small(), sequences(1, 6), direction, seed);
            path(&mut *search, 15, |genotype| (genotype.numbers()[1] < 0.8).then(|| sign * matches(genotype)))
        };
        prop_assert_eq!(run(Direction::Minimise, 1.0), run(Direction::Maximise, -1.0));
    }
}
