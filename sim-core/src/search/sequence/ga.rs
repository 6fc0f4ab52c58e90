//! A genetic algorithm on sequences of segments, with one-point crossover between segments and hybrid selection
//! (E. Yoshida, S. Murata, A. Kamimura, K. Tomita, H. Kurokawa and S. Kokaji, *Evolutionary Motion Synthesis for a
//! Modular Robot using Genetic Algorithm*, section 3).
//!
//! Children are bred from the individuals of the last generation and compete with them. Individuals keep their scores:
//! only children are evaluated. So generation 0 has a whole population of candidates, and later generations have fewer.
//!
//! The paper does not state how parents are chosen. Here each pair of parents, and the parent of each mutant, is drawn
//! uniformly from the population.

use super::domain::Domain;
use crate::base::encoding::encoded;
use crate::base::error::{Faults, Invalid};
use crate::base::limits::{MAX_GENOTYPE, MAX_POPULATION, MAX_TRIES};
use crate::base::random::{Purpose, Stream};
use crate::base::registry::Component;
use crate::base::score::Direction;
use crate::base::settings::{Configurable, Number, Setting, Settings};
use crate::genotype::{Genotype, Length, Rules, Space};
use crate::search::{Ask, BadState, Batch, Evaluation, GENERATIONS, Search, SearchKind, ranking};
use serde::{Deserialize, Serialize};
use std::iter;
use std::sync::Arc;

/// The genetic algorithm on sequences of segments.
pub struct SequenceGa;

/// Number of individuals.
const POPULATION: Setting = Setting::whole("population", 40).within(2.0, MAX_POPULATION as f64);
/// Number of generations that are scored, with this kind's default.
const SCORED: Setting = Setting { default: Some(Number::Whole(50)), ..GENERATIONS };
/// r_c: number of children that are bred by crossover, as a share of the population.
const CROSSOVER_RATE: Setting = Setting::real("crossover_rate", "", 0.5).within(0.0, 1.0);
/// r_m: number of children that are bred by mutation, as a share of the population.
const MUTATION_RATE: Setting = Setting::real("mutation_rate", "", 0.05).within(0.0, 1.0);
/// Number of best individuals that survive.
const ELITE: Setting = Setting::whole("elite", 4).within(0.0, MAX_POPULATION as f64);
/// Number of individuals that survive by linear ranking.
const RANKED: Setting = Setting::whole("ranked", 12).within(0.0, MAX_POPULATION as f64);
/// Number of individuals that survive by a uniform draw.
const RANDOM: Setting = Setting::whole("random", 24).within(0.0, MAX_POPULATION as f64);
/// Selection pressure of linear ranking: the probability of the best as a multiple of the mean probability.
const PRESSURE: Setting = Setting::real("pressure", "", 1.5).within(1.0, 2.0);
/// Number of segments that a mutation replaces. Default: a random number, 1 to all.
const MUTATED: Setting = Setting::optional_whole("mutated").within(1.0, MAX_GENOTYPE as f64);

impl Component for SequenceGa {
    fn name(&self) -> &'static str {
        "sequence-ga"
    }
}

impl Configurable for SequenceGa {
    fn settings(&self) -> &'static [Setting] {
        &[POPULATION, SCORED, CROSSOVER_RATE, MUTATION_RATE, ELITE, RANKED, RANDOM, PRESSURE, MUTATED]
    }
}

impl SearchKind for SequenceGa {
    fn population(&self, settings: &Settings) -> u32 {
        settings.whole(&POPULATION)
    }

    fn evaluations(&self, settings: &Settings, generations: u32) -> u64 {
        let later = u64::from(generations.saturating_sub(1));
        u64::from(generations.min(1) * self.population(settings)) + later * u64::from(Breeding::of(settings).children())
    }

    fn conflicts(&self, settings: &Settings) -> Result<(), Invalid> {
        let mut faults = Faults::default();
        let mut conflict = |field: &str, reason| faults.add(Invalid::Conflict { field: field.into(), reason });
        let fit = |all: &[Setting]| all.iter().all(|setting| settings.fits(setting));
        let population = self.population(settings);
        if fit(&[POPULATION, ELITE, RANKED, RANDOM]) {
            let [elite, ranked, random] = [ELITE, RANKED, RANDOM].map(|setting| settings.whole(&setting));
            let sum = elite + ranked + random;
            if sum != population {
                let reason = format!(
                    "elite + ranked + random must be the population, and here {elite} + {ranked} + {random} = {sum} is \
                     not {population}: change one of them"
                );
                conflict("optimiser.elite", reason);
            }
        }
        if fit(&[POPULATION, CROSSOVER_RATE, MUTATION_RATE]) {
            let Breeding { crossed, mutants, .. } = Breeding::of(settings);
            let children = crossed + mutants;
            if children == 0 || children > population {
                let reason = format!(
                    "crossover_rate and mutation_rate give {crossed} + {mutants} = {children} children a generation: \
                     allowed is 1 to {population}, the population"
                );
                conflict("optimiser.crossover_rate", reason);
            }
        }
        faults.end()
    }

    fn takes(&self, space: &Space) -> Result<(), Invalid> {
        match space.length {
            Length::Sequence { .. } => Ok(()),
            Length::Fixed => {
                let reason = format!(
                    "\"{}\" searches sequences of segments, and the genotypes of this job have a fixed length: choose \
                     another kind, or another controller",
                    self.name()
                );
                Err(Invalid::Conflict { field: "optimiser.kind".into(), reason })
            }
        }
    }

    fn build(
        &self,
        settings: &Settings,
        space: Space,
        rules: Arc<dyn Rules>,
        direction: Direction,
        seed: u64,
    ) -> Box<dyn Search> {
        let (breeding, selection) = (Breeding::of(settings), Selection::of(settings));
        let size = self.population(settings);
        Box::new(GeneticAlgorithm::new(size, breeding, selection, Domain { space, rules }, direction, seed))
    }
}

/// Numbers of children.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Breeding {
    /// Number of children that are bred by crossover. The last pair has only one child if it is odd.
    crossed: u32,
    /// Number of children that are bred by mutation.
    mutants: u32,
    /// Number of segments that a mutation replaces; `None` for a random number.
    mutated: Option<u32>,
}

impl Breeding {
    fn of(settings: &Settings) -> Self {
        let population = f64::from(settings.whole(&POPULATION));
        let share = |rate: &Setting| libm::round(settings.real(rate) * population) as u32;
        Self {
            crossed: share(&CROSSOVER_RATE),
            mutants: share(&MUTATION_RATE),
            mutated: settings.optional_whole(&MUTATED),
        }
    }

    fn children(self) -> u32 {
        self.crossed + self.mutants
    }
}

/// Hybrid selection, named as the settings.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Selection {
    elite: usize,
    ranked: usize,
    random: usize,
    pressure: f64,
}

impl Selection {
    fn of(settings: &Settings) -> Self {
        let number = |setting| settings.whole(setting) as usize;
        Self {
            elite: number(&ELITE),
            ranked: number(&RANKED),
            random: number(&RANDOM),
            pressure: settings.real(&PRESSURE),
        }
    }

    /// Returns the individuals that survive, each once: the first of the order, then those drawn by rank, then those
    /// drawn uniformly. `order` lists individuals from best to worst. `stream` returns the stream of a place in the
    /// result.
    fn survivors(self, order: Vec<usize>, stream: impl Fn(usize) -> Stream) -> Vec<usize> {
        let mut rest = order;
        let mut next: Vec<usize> = rest.drain(..self.elite).collect();
        for place in self.elite..self.elite + self.ranked {
            let rank = by_rank(rest.len(), self.pressure, stream(place).unit());
            next.push(rest.remove(rank));
        }
        for place in next.len()..next.len() + self.random {
            let at = stream(place).below(rest.len() as u32) as usize;
            next.push(rest.remove(at));
        }
        next
    }
}

/// Returns a rank from 0, the best, to n − 1 by linear ranking: rank r has the probability
/// (s − 2 (s − 1) r / (n − 1)) / n, where s is the pressure. `u` is uniform in [0, 1).
fn by_rank(n: usize, pressure: f64, u: f64) -> usize {
    let fall = 2.0 * (pressure - 1.0) / n.saturating_sub(1).max(1) as f64;
    let mut left = u * n as f64;
    for rank in 0..n {
        left -= pressure - fall * rank as f64;
        if left < 0.0 {
            return rank;
        }
    }
    // Rounding may leave a positive rest.
    n - 1
}

/// Genotype that was scored; a score of `None` means a failed evaluation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Individual {
    genotype: Genotype,
    score: Option<f64>,
}

/// Two individuals and their cross points.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Crossing {
    parents: [usize; 2],
    cuts: [u32; 2],
}

impl Crossing {
    /// Returns the crossing that gives the other child of the pair.
    fn mirrored(self) -> Self {
        let Self { parents: [a, b], cuts: [cut_a, cut_b] } = self;
        Self { parents: [b, a], cuts: [cut_b, cut_a] }
    }
}

/// Child and the individual that takes its place if the rules forbid it.
struct Child {
    genotype: Genotype,
    first_parent: usize,
}

#[derive(Clone, Debug)]
struct GeneticAlgorithm {
    size: u32,
    breeding: Breeding,
    selection: Selection,
    domain: Domain,
    direction: Direction,
    seed: u64,
    generation: u32,
    /// Individuals that were scored; none at generation 0.
    population: Vec<Individual>,
    /// Candidates of the current generation.
    candidates: Vec<Genotype>,
    copies: u64,
}

impl GeneticAlgorithm {
    fn new(
        size: u32,
        breeding: Breeding,
        selection: Selection,
        domain: Domain,
        direction: Direction,
        seed: u64,
    ) -> Self {
        let candidates = (0..size).map(|i| domain.draw(seed, i)).collect();
        let (generation, population, copies) = (0, Vec::new(), 0);
        Self { size, breeding, selection, domain, direction, seed, generation, population, candidates, copies }
    }

    /// Adds the scored candidates and selects the next population. Ties are ordered by index: the older individuals
    /// first.
    fn select(&mut self, newest: impl Iterator<Item = Individual>) {
        self.population.extend(newest);
        if self.generation > 0 {
            let scores: Vec<Option<f64>> = self.population.iter().map(|individual| individual.score).collect();
            let stream = |place| Stream::new(self.seed, Purpose::Selection, self.generation, place as u32, 0);
            let survivors = self.selection.survivors(ranking(self.direction, &scores), stream);
            self.population = survivors.into_iter().map(|i| self.population[i].clone()).collect();
        }
    }

    /// Returns the children of the current generation. A pair shares a stream for its parents and its cross points. A
    /// child that the rules forbid is bred again, from new parents, with a stream of its own.
    fn breed(&mut self) -> Vec<Genotype> {
        let Breeding { crossed, mutants, .. } = self.breeding;
        let stream = |seed, generation, child, repeat| Stream::new(seed, Purpose::Breeding, generation, child, repeat);
        let (seed, generation) = (self.seed, self.generation);
        let mut children = Vec::with_capacity((crossed + mutants) as usize);
        for pair in (0..crossed).step_by(2) {
            let crossing = self.crossing(&mut stream(seed, generation, pair, 0));
            for (child, crossing) in (pair..crossed).zip([crossing, crossing.mirrored()]) {
                let mut own = stream(seed, generation, child, 1);
                let again = iter::repeat_with(|| self.crossed(self.crossing(&mut own)));
                let bred = self.allowed(iter::once(self.crossed(crossing)).chain(again));
                children.push(bred);
            }
        }
        for child in crossed..crossed + mutants {
            let mut own = stream(seed, generation, child, 0);
            children.push(self.allowed(iter::repeat_with(|| self.mutant(&mut own))));
        }
        self.copies += children.iter().filter(|(_, copied)| *copied).count() as u64;
        children.into_iter().map(|(genotype, _)| genotype).collect()
    }

    /// Returns the first child that keeps the rules. If none of the first and [`MAX_TRIES`] more does, returns a copy
    /// of the first child's first parent, and true.
    fn allowed(&self, children: impl Iterator<Item = Child>) -> (Genotype, bool) {
        let mut parent = None;
        for Child { genotype, first_parent } in children.take(1 + MAX_TRIES) {
            if self.domain.rules.allows(&self.domain.space, &genotype) {
                return (genotype, false);
            }
            parent.get_or_insert(first_parent);
        }
        (self.population[parent.unwrap_or(0)].genotype.clone(), true)
    }

    /// Draws two different individuals and their cross points.
    fn crossing(&self, random: &mut Stream) -> Crossing {
        let a = random.below(self.size);
        let b = random.below(self.size - 1);
        let parents = [a, if b < a { b } else { b + 1 }].map(|i| i as usize);
        let lengths = parents.map(|i| self.domain.segments(&self.population[i].genotype));
        Crossing { parents, cuts: self.domain.cuts(lengths, random) }
    }

    fn crossed(&self, Crossing { parents, cuts }: Crossing) -> Child {
        let genotype = self.domain.join(parents.map(|i| &self.population[i].genotype), cuts);
        Child { genotype, first_parent: parents[0] }
    }

    /// Returns a mutated copy of an individual drawn at random.
    fn mutant(&self, random: &mut Stream) -> Child {
        let first_parent = random.below(self.size) as usize;
        let mut genotype = self.population[first_parent].genotype.clone();
        self.domain.mutate(&mut genotype, self.breeding.mutated, random);
        Child { genotype, first_parent }
    }
}

/// First byte of a stored state.
const FORMAT: u8 = 0xE1;

/// Stored state.
#[derive(Serialize, Deserialize)]
struct Saved {
    seed: u64,
    generation: u32,
    size: u32,
    genes: u32,
    population: Vec<Individual>,
    candidates: Vec<Genotype>,
    copies: u64,
}

encoded!(Saved = FORMAT);

impl Search for GeneticAlgorithm {
    fn ask(&self) -> Batch {
        Batch { ask: Ask::Set, genotypes: self.candidates.clone() }
    }

    /// Receives the evaluations. A candidate that was evaluated with another genotype becomes an individual with that
    /// genotype.
    fn tell(&mut self, evaluations: &[Evaluation]) {
        assert_eq!(evaluations.len(), self.candidates.len(), "one evaluation per candidate is needed");
        self.select(evaluations.iter().map(|evaluation| Individual {
            genotype: evaluation.genotype.clone(),
            score: evaluation.score.filter(|score| !score.is_nan()),
        }));
        self.generation += 1;
        self.candidates = self.breed();
    }

    fn generation(&self) -> u32 {
        self.generation
    }

    fn save(&self) -> Vec<u8> {
        let saved = Saved {
            seed: self.seed,
            generation: self.generation,
            size: self.size,
            genes: self.domain.genes() as u32,
            population: self.population.clone(),
            candidates: self.candidates.clone(),
            copies: self.copies,
        };
        saved.encode()
    }

    fn restore(&mut self, state: &[u8]) -> Result<(), BadState> {
        let Saved { seed, generation, size, genes, population, candidates, copies } =
            Saved::decode(state).map_err(|e| BadState(e.to_string()))?;
        let refuse = |why: String| Err(BadState(why));
        if seed != self.seed {
            return refuse(format!("its seed is {seed}, but this job's is {}", self.seed));
        }
        let own = (self.size, self.domain.genes() as u32);
        if (size, genes) != own {
            return refuse(format!(
                "it holds {size} individuals with segments of {genes} parameters, but this job has {} with {}",
                own.0, own.1
            ));
        }
        let wanted = if generation == 0 { (0, size) } else { (size, self.breeding.children()) };
        let found = (population.len(), candidates.len());
        if found != (wanted.0 as usize, wanted.1 as usize) {
            return refuse(format!(
                "it holds {} individuals and {} candidates at generation {generation}, but this job has {} and {}",
                found.0, found.1, wanted.0, wanted.1
            ));
        }
        if population.iter().any(|individual| individual.score.is_some_and(f64::is_nan)) {
            return refuse("it holds a NaN".into());
        }
        let genotypes = population.iter().map(|individual| &individual.genotype).chain(&candidates);
        if let Some(misfit) = genotypes.filter_map(|genotype| self.domain.space.check(genotype).err()).next() {
            return refuse(format!("a candidate is not in the job's space: {misfit}"));
        }
        (self.generation, self.population, self.candidates, self.copies) = (generation, population, candidates, copies);
        Ok(())
    }

    fn copies(&self) -> u64 {
        self.copies
    }

    fn direction(&self) -> Direction {
        self.direction
    }
}

#[cfg(test)]
mod tests;
