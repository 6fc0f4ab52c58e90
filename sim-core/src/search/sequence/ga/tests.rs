//! Tests of crossover, mutation and selection.

use super::*;
use crate::genotype::{Gene, NamedGene, NoRules};
use proptest::prelude::*;
use std::collections::BTreeSet;

const SELECTION: Selection = Selection { elite: 4, ranked: 12, random: 24, pressure: 1.5 };

fn stream(place: usize) -> Stream {
    Stream::new(3, Purpose::Selection, 1, place as u32, 0)
}

fn domain(least: u32, most: u32) -> Domain {
    let named = |name: &str, gene| NamedGene { name: name.into(), unit: "", gene };
    let genes = vec![named("tag", Gene::Choice { options: 3 }), named("x", Gene::Real { low: 0.0, high: 1.0 })];
    Domain { space: Space { genes, length: Length::Sequence { least, most } }, rules: Arc::new(NoRules) }
}

proptest! {
    #[test]
    fn survivors_are_elites_then_ranked_then_random(
        [elite, ranked, random, children] in [0usize..9, 0..9, 0..9, 0..9], pressure in 1.0..2.0, seed: u64,
    ) {
        let all = elite + ranked + random + children;
        let order: Vec<usize> = (0..all).rev().collect();
        let stream = |place| Stream::new(seed, Purpose::Selection, 1, place as u32, 0);
        let next = Selection { elite, ranked, random, pressure }.survivors(order.clone(), stream);
        prop_assert_eq!(next.len(), elite + ranked + random);
        prop_assert_eq!(&next[..elite], &order[..elite]);
        prop_assert_eq!(next.iter().collect::<BTreeSet<_>>().len(), next.len());
        // Each draw depends on its own place alone: fewer random survivors leave the others as they are.
        let without = Selection { elite, ranked, random: 0, pressure }.survivors(order, stream);
        prop_assert_eq!(&without[..], &next[..elite + ranked]);
    }

    #[test]
    fn children_of_a_crossing_have_allowed_lengths(
        least in 0u32..6, more in 0u32..9, lengths: [prop::sample::Index; 2], seed: u64,
    ) {
        let domain = domain(least, least + more);
        let [a, b] = lengths.map(|i| least + i.index(more as usize + 1) as u32);
        let [cut_a, cut_b] = domain.cuts([a, b], &mut Stream::new(seed, Purpose::Sample, 0, 0, 0));
        prop_assert!(cut_a <= a && cut_b <= b);
        for child in [cut_a + b - cut_b, cut_b + a - cut_a] {
            prop_assert!((least..=least + more).contains(&child), "{}", child);
        }
        if a == b {
            prop_assert_eq!(cut_a, cut_b);
            prop_assert!(a < 2 || (1..a).contains(&cut_a));
        }
    }

    #[test]
    fn mutation_replaces_the_set_number_of_segments(length in 0u32..12, count in 1u32..15, seed: u64) {
        let domain = domain(0, 12);
        // No drawn number is −1, so each replaced segment differs.
        let mut genotype: Genotype = vec![-1.0; 2 * length as usize].into();
        domain.mutate(&mut genotype, Some(count), &mut Stream::new(seed, Purpose::Sample, 0, 0, 0));
        let replaced = genotype.numbers().chunks(2).filter(|segment| **segment != [-1.0; 2]).count() as u32;
        prop_assert_eq!(replaced, count.min(length));
        let whole = |segment: &[f64]| segment.iter().all(|v| *v >= 0.0) || segment == [-1.0; 2];
        prop_assert!(genotype.numbers().chunks(2).all(whole));
    }
}

#[test]
fn random_number_of_replaced_segments_is_uniform() {
    let domain = domain(5, 5);
    let mut counts = [0u32; 5];
    let mut places = [0u32; 5];
    for candidate in 0..5000 {
        let mut genotype: Genotype = vec![-1.0; 10].into();
        domain.mutate(&mut genotype, None, &mut Stream::new(1, Purpose::Sample, 0, candidate, 0));
        let replaced: Vec<bool> = genotype.numbers().chunks(2).map(|segment| segment[0] >= 0.0).collect();
        counts[replaced.iter().filter(|it| **it).count() - 1] += 1;
        places.iter_mut().zip(replaced).for_each(|(place, it)| *place += u32::from(it));
    }
    assert!(counts.iter().all(|count| count.abs_diff(1000) < 120), "{counts:?}");
    // Three of five segments on average.
    assert!(places.iter().all(|place| place.abs_diff(3000) < 150), "{places:?}");
}

#[test]
fn ranks_are_drawn_with_linear_probabilities() {
    for (pressure, expected) in [(1.0, [0.25; 4]), (1.5, [0.375, 0.29167, 0.20833, 0.125])] {
        let mut counts = [0u32; 4];
        (0..40_000).for_each(|i| counts[by_rank(4, pressure, (f64::from(i) + 0.5) / 40_000.0)] += 1);
        for (count, expected) in counts.iter().zip(expected) {
            assert!((f64::from(*count) / 40_000.0 - expected).abs() < 1e-3, "{pressure}: {counts:?}");
        }
    }
    assert_eq!([by_rank(1, 2.0, 0.99), by_rank(2, 2.0, 0.999), by_rank(5, 1.0, 1.0 - f64::EPSILON)], [0, 0, 4]);
}

#[test]
fn ranked_survivors_are_better_than_random_ones() {
    let (mut ranked, mut random) = (0, 0);
    for seed in 0..200 {
        let stream = |place| Stream::new(seed, Purpose::Selection, 1, place as u32, 0);
        let next = SELECTION.survivors((0..62).collect(), stream);
        ranked += next[4..16].iter().sum::<usize>();
        random += next[16..].iter().sum::<usize>();
    }
    let mean = |sum, count: usize| f64::from(sum as u32) / (200 * count) as f64;
    assert!(mean(ranked, 12) < 31.0 && mean(random, 24) > 32.0, "{} {}", mean(ranked, 12), mean(random, 24));
    assert_eq!(SELECTION.survivors((0..62).collect(), stream).len(), 40);
}

#[test]
fn ties_and_failures_are_ordered_by_index() {
    let breeding = Breeding { crossed: 2, mutants: 1, mutated: None };
    let selection = Selection { elite: 4, ranked: 0, random: 0, pressure: 1.5 };
    let mut ga = GeneticAlgorithm::new(4, breeding, selection, domain(2, 2), Direction::Maximise, 9);
    let first = ga.ask().genotypes;
    ga.tell(&ga.ask().scored(&[None, Some(1.0), Some(f64::NAN), Some(1.0)]));
    let children = ga.ask().genotypes;
    ga.tell(&ga.ask().scored(&[Some(1.0), Some(f64::NAN), None]));
    let survivors: Vec<&Genotype> = ga.population.iter().map(|individual| &individual.genotype).collect();
    // Too few succeed, so the first failure is among the elites.
    assert_eq!(survivors, [&first[1], &first[3], &children[0], &first[0]]);
    assert_eq!(ga.population.iter().map(|i| i.score).collect::<Vec<_>>(), [Some(1.0), Some(1.0), Some(1.0), None]);
}

#[test]
fn pairs_exchange_their_tails_at_one_cross_point() {
    let breeding = Breeding { crossed: 6, mutants: 0, mutated: None };
    let selection = Selection { elite: 0, ranked: 0, random: 6, pressure: 1.5 };
    let mut ga = GeneticAlgorithm::new(6, breeding, selection, domain(5, 5), Direction::Maximise, 4);
    ga.tell(&ga.ask().scored(&[Some(1.0); 6]));
    let parents: Vec<Genotype> = ga.population.iter().map(|individual| individual.genotype.clone()).collect();
    for pair in ga.ask().genotypes.chunks(2) {
        let [a, b] = pair else { panic!("{} children", pair.len()) };
        let crossed = |[p, q]: [&Genotype; 2], cut| {
            ga.domain.join([p, q], [cut; 2]) == *a && ga.domain.join([q, p], [cut; 2]) == *b
        };
        let found = (1..5).any(|cut| parents.iter().any(|p| parents.iter().any(|q| p != q && crossed([p, q], cut))));
        assert!(found, "{pair:?}");
    }
}
