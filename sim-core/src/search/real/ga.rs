//! A genetic algorithm on real vectors: tournament selection, simulated binary crossover (K. Deb and R. B. Agrawal,
//! *Simulated binary crossover for continuous search space*, Complex Systems 9, 1995), Gaussian mutation, elitism.
//!
//! A gene that would leave its bounds is reflected at them, so that genes do not gather at bounds. Elites are kept
//! unchanged and are scored again like all others: if scores depend on luck, an elite must achieve its score again. A
//! failed evaluation is never an elite, and wins a tournament only against other failures.

use crate::base::error::{Faults, Invalid, whole_in_range};
use crate::base::limits::MAX_POPULATION;
use crate::base::random::{Purpose, Stream};
use crate::base::registry::Component;
use crate::base::score::Direction;
use crate::base::settings::{Configurable, Setting, Settings};
use crate::genotype::{Genotype, Rules, Space};
use crate::search::state::{Owner, Reader, Writer};
use crate::search::{Ask, BadState, Batch, Evaluation, GENERATIONS, Search, SearchKind, random_genotype, ranking};
use std::sync::Arc;

/// The genetic algorithm.
pub struct Ga;

/// Number of individuals.
const POPULATION: Setting = Setting::whole("population", 20).within(2.0, MAX_POPULATION as f64);
/// Number of individuals in the tournament for a parent: 1 to all.
const TOURNAMENT: Setting = Setting::whole("tournament", 2);
/// Probability that a pair of parents is crossed rather than copied.
const CROSSOVER_RATE: Setting = Setting::real("crossover_rate", "", 0.9).within(0.0, 1.0);
/// η of simulated binary crossover: a larger value keeps children nearer to their parents.
const CROSSOVER_ETA: Setting = Setting::real("crossover_eta", "", 10.0).within(0.0, 1000.0);
/// Probability that a gene mutates. Default: 1 / length.
const MUTATION_RATE: Setting = Setting::optional_real("mutation_rate", "").within(0.0, 1.0);
/// Standard deviation of a mutation, as a share of the gene's range.
const MUTATION_SCALE: Setting = Setting::real("mutation_scale", "", 0.1).within(0.0, 1.0);
/// Number of best individuals that are kept unchanged: 0 to all but one.
const ELITE: Setting = Setting::whole("elite", 1);

impl Component for Ga {
    fn name(&self) -> &'static str {
        "ga"
    }
}

impl Configurable for Ga {
    fn settings(&self) -> &'static [Setting] {
        &[POPULATION, GENERATIONS, TOURNAMENT, CROSSOVER_RATE, CROSSOVER_ETA, MUTATION_RATE, MUTATION_SCALE, ELITE]
    }
}

impl SearchKind for Ga {
    fn population(&self, settings: &Settings) -> u32 {
        settings.whole(&POPULATION)
    }

    fn conflicts(&self, settings: &Settings) -> Result<(), Invalid> {
        let mut faults = Faults::default();
        if settings.fits(&POPULATION) {
            let (all, whole) = (u64::from(self.population(settings)), |setting| settings.whole(setting));
            faults.take(whole_in_range("optimiser.tournament", whole(&TOURNAMENT), (1, all), ""));
            faults.take(whole_in_range("optimiser.elite", whole(&ELITE), (0, all - 1), ""));
        }
        faults.end()
    }

    fn build(
        &self,
        settings: &Settings,
        space: Space,
        _: Arc<dyn Rules>,
        direction: Direction,
        seed: u64,
    ) -> Box<dyn Search> {
        let breeding = Breeding {
            tournament: settings.whole(&TOURNAMENT),
            crossover_rate: settings.real(&CROSSOVER_RATE),
            crossover_eta: settings.real(&CROSSOVER_ETA),
            mutation_rate: settings.optional(&MUTATION_RATE).unwrap_or(1.0 / space.genes.len().max(1) as f64),
            mutation_scale: settings.real(&MUTATION_SCALE),
            elite: settings.whole(&ELITE),
        };
        Box::new(GeneticAlgorithm::new(self.population(settings), breeding, space, direction, seed))
    }
}

/// Parameters of breeding, named as the settings.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Breeding {
    pub tournament: u32,
    pub crossover_rate: f64,
    pub crossover_eta: f64,
    pub mutation_rate: f64,
    pub mutation_scale: f64,
    pub elite: u32,
}

#[derive(Clone, Debug)]
struct GeneticAlgorithm {
    breeding: Breeding,
    space: Space,
    direction: Direction,
    seed: u64,
    generation: u32,
    population: Vec<Genotype>,
}

impl GeneticAlgorithm {
    pub fn new(size: u32, breeding: Breeding, space: Space, direction: Direction, seed: u64) -> Self {
        let population = (0..size).map(|i| random_genotype(&space, seed, i)).collect();
        Self { breeding, space, direction, seed, generation: 0, population }
    }

    /// Returns the next generation: elites first, then children in pairs. A pair draws from the stream of its first
    /// child.
    fn breed(&self, scores: &[Option<f64>]) -> Vec<Genotype> {
        let order = ranking(self.direction, scores);
        let scored = order.iter().filter(|&&i| scores[i].is_some_and(|s| !s.is_nan()));
        let mut next: Vec<Genotype> =
            scored.take(self.breeding.elite as usize).map(|&i| self.population[i].clone()).collect();
        while next.len() < self.population.len() {
            let mut random = Stream::new(self.seed, Purpose::Breeding, self.generation + 1, next.len() as u32, 0);
            let mut children = [self.parent(&order, &mut random).clone(), self.parent(&order, &mut random).clone()];
            if random.unit() < self.breeding.crossover_rate {
                self.cross(&mut children, &mut random);
            }
            for mut child in children {
                self.mutate(&mut child, &mut random);
                next.push(child);
            }
        }
        next.truncate(self.population.len());
        next
    }

    /// Returns the best of `tournament` individuals, drawn with replacement.
    fn parent(&self, order: &[usize], random: &mut Stream) -> &Genotype {
        let draws = (0..self.breeding.tournament).map(|_| random.below(order.len() as u32) as usize);
        // `order` is sorted, so the least index drawn is the best individual.
        &self.population[order[draws.min().unwrap_or(0)]]
    }

    /// Crosses two genotypes by simulated binary crossover, each gene with probability 1/2. Keeps each gene's mean.
    fn cross(&self, [a, b]: &mut [Genotype; 2], random: &mut Stream) {
        for ((a, b), bound) in a.numbers_mut().iter_mut().zip(b.numbers_mut()).zip(self.space.bounds()) {
            let (crossed, u) = (random.unit() < 0.5, random.unit());
            if crossed {
                let (one, other) = spread(*a, *b, u, self.breeding.crossover_eta);
                (*a, *b) = (reflect(one, bound), reflect(other, bound));
            }
        }
    }

    fn mutate(&self, genotype: &mut Genotype, random: &mut Stream) {
        for (gene, bound) in genotype.numbers_mut().iter_mut().zip(self.space.bounds()) {
            if random.unit() < self.breeding.mutation_rate {
                let deviation = self.breeding.mutation_scale * (bound.1 - bound.0);
                *gene = reflect(*gene + deviation * random.normal(), bound);
            }
        }
    }

    fn owner(&self) -> Owner {
        Owner { kind: b'g', seed: self.seed, population: self.population.len(), genotype: self.space.genes.len() }
    }

    fn numbers(&self) -> usize {
        self.population.len() * self.space.genes.len()
    }
}

/// Returns two children's values, placed symmetrically about the parents' mean: nearer to it than the parents for u <
/// 1/2.
fn spread(a: f64, b: f64, u: f64, eta: f64) -> (f64, f64) {
    let base = if u <= 0.5 { 2.0 * u } else { 0.5 / (1.0 - u) };
    let beta = libm::pow(base, 1.0 / (eta + 1.0));
    let (mean, half) = (0.5 * (a + b), 0.5 * beta * (a - b));
    (mean + half, mean - half)
}

/// Reflects a value at its bounds until it is between them.
fn reflect(value: f64, (low, high): (f64, f64)) -> f64 {
    if value >= low && value <= high {
        return value;
    }
    let range = high - low;
    let folded = (value - low).rem_euclid(2.0 * range);
    let inside = if folded > range { 2.0 * range - folded } else { folded };
    // Rounding, or a range of 0, may still lead out of the bounds.
    if inside.is_nan() { low } else { (low + inside).clamp(low, high) }
}

impl Search for GeneticAlgorithm {
    fn ask(&self) -> Batch {
        Batch { ask: Ask::Set, genotypes: self.population.clone() }
    }

    /// Receives the evaluations. An individual that was evaluated with another genotype becomes a parent with that
    /// genotype.
    fn tell(&mut self, evaluations: &[Evaluation]) {
        assert_eq!(evaluations.len(), self.population.len(), "one evaluation per individual is needed");
        self.population = evaluations.iter().map(|evaluation| evaluation.genotype.clone()).collect();
        let scores: Vec<Option<f64>> = evaluations.iter().map(|evaluation| evaluation.score).collect();
        self.population = self.breed(&scores);
        self.generation += 1;
    }

    fn generation(&self) -> u32 {
        self.generation
    }

    fn save(&self) -> Vec<u8> {
        let mut writer = Writer::new(self.owner(), self.generation, self.numbers());
        self.population.iter().for_each(|genotype| writer.numbers(genotype.numbers()));
        writer.finish()
    }

    fn restore(&mut self, state: &[u8]) -> Result<(), BadState> {
        let (mut reader, generation) = Reader::new(state, self.owner(), self.numbers())?;
        let population = (0..self.population.len()).map(|_| reader.genotype(&self.space)).collect::<Result<_, _>>()?;
        (self.generation, self.population) = (generation, population);
        Ok(())
    }

    fn direction(&self) -> Direction {
        self.direction
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crossover_keeps_mean_and_contracts_below_one_half() {
        for u in [0.0, 0.2, 0.499, 0.501, 0.9, 0.999] {
            let (c, d) = spread(1.0, 3.0, u, 10.0);
            assert!((c + d - 4.0).abs() < 1e-12);
            assert_eq!((d - c).abs() < 2.0, u < 0.5, "u = {u}");
        }
        let (c, d) = spread(1.0, 3.0, 0.5, 10.0);
        assert_eq!((c, d), (1.0, 3.0));
    }

    #[test]
    fn reflection_repeats_until_value_is_in_bounds() {
        let at = |v| reflect(v, (1.0, 3.0));
        assert_eq!([at(1.0), at(2.5), at(3.0)], [1.0, 2.5, 3.0]);
        assert_eq!([at(0.5), at(3.25), at(5.5), at(-1.5)], [1.5, 2.75, 1.5, 2.5]);
        assert_eq!(reflect(7.0, (2.0, 2.0)), 2.0);
    }

    #[test]
    fn ranking_puts_failures_last_and_ties_in_order() {
        let scores = [None, Some(2.0), Some(f64::NAN), Some(5.0), Some(2.0)];
        assert_eq!(ranking(Direction::Maximise, &scores), [3, 1, 4, 0, 2]);
        assert_eq!(ranking(Direction::Minimise, &scores), [1, 4, 3, 0, 2]);
    }

    #[test]
    fn elites_are_kept_unchanged_and_exclude_failures() {
        let breeding = Breeding {
            tournament: 2,
            crossover_rate: 1.0,
            crossover_eta: 5.0,
            mutation_rate: 1.0,
            mutation_scale: 0.1,
            elite: 2,
        };
        let mut ga = GeneticAlgorithm::new(5, breeding, Space::of_reals([(0.0, 1.0); 3]), Direction::Maximise, 9);
        let first = ga.ask().genotypes;
        ga.tell(&ga.ask().scored(&[Some(1.0), None, Some(3.0), Some(2.0), None]));
        assert_eq!(ga.ask().genotypes[..2], [first[2].clone(), first[3].clone()]);
        let second = ga.ask().genotypes;
        ga.tell(&ga.ask().scored(&[None, None, None, Some(1.0), None]));
        assert_eq!(ga.ask().genotypes[0], second[3]);
        assert!(ga.ask().genotypes[1..].iter().all(|g| !second.contains(g)));
    }

    #[test]
    fn genotype_other_than_sent_becomes_parent() {
        let breeding = Breeding {
            tournament: 5,
            crossover_rate: 0.0,
            crossover_eta: 5.0,
            mutation_rate: 0.0,
            mutation_scale: 0.1,
            elite: 1,
        };
        let mut ga = GeneticAlgorithm::new(5, breeding, Space::of_reals([(0.0, 1.0); 3]), Direction::Maximise, 9);
        let mut evaluations = ga.ask().scored(&[Some(1.0), None, Some(3.0), Some(2.0), None]);
        evaluations[2].genotype = vec![0.25, 0.5, 0.75].into();
        ga.tell(&evaluations);
        // Without crossover and mutation, the next generation consists of copies.
        assert_eq!(ga.ask().genotypes[0].numbers(), [0.25, 0.5, 0.75]);
        assert!(ga.ask().genotypes.iter().all(|child| evaluations.iter().any(|parent| parent.genotype == *child)));
    }
}
