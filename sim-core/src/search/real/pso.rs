//! Particle swarm optimisation: Eq. 1 and Algorithm 2 of V. Vonásek and J. Faigl, *Evolution of multiple gaits for
//! modular robots*, IEEE SSCI 2016.
//!
//! Choices that the paper leaves open:
//! - The swarm is synchronous: all particles are scored before any moves.
//! - First velocities are uniform in ± half a parameter's range.
//! - A particle that would leave the bounds stops at them, and that component of its velocity becomes 0.
//! - Only a strictly better value replaces a best; ties go to the lowest index.
//! - A failed evaluation is never a best, and a particle without a best is not pulled to one.

use crate::base::limits::MAX_POPULATION;
use crate::base::random::{Purpose, Stream};
use crate::base::registry::Component;
use crate::base::score::Direction;
use crate::base::settings::{Configurable, Setting, Settings};
use crate::genotype::{Genotype, Rules, Space};
use crate::search::state::{Owner, Reader, Writer};
use crate::search::{Ask, BadState, Batch, Evaluation, GENERATIONS, Search, SearchKind, random_genotype};
use std::sync::Arc;

/// The swarm of Eq. 1. The defaults are the paper's coefficients.
pub struct Pso;

/// p, the number of particles.
pub(super) const PARTICLES: Setting = Setting::whole("particles", 20).within(1.0, MAX_POPULATION as f64);
/// w in Eq. 1, the inertia weight.
const INERTIA_WEIGHT: Setting = Setting::real("inertia_weight", "", 0.1).within(0.0, 2.0);
/// φ₁ in Eq. 1, the pull to the particle's own best.
const COGNITIVE: Setting = Setting::real("cognitive", "", 2.0).within(0.0, 10.0);
/// φ₂ in Eq. 1, the pull to the swarm's best.
const SOCIAL: Setting = Setting::real("social", "", 2.0).within(0.0, 10.0);

impl Component for Pso {
    fn name(&self) -> &'static str {
        "pso"
    }
}

impl Configurable for Pso {
    fn settings(&self) -> &'static [Setting] {
        &[PARTICLES, GENERATIONS, INERTIA_WEIGHT, COGNITIVE, SOCIAL]
    }
}

impl SearchKind for Pso {
    fn population(&self, settings: &Settings) -> u32 {
        settings.whole(&PARTICLES)
    }

    fn build(
        &self,
        settings: &Settings,
        space: Space,
        _: Arc<dyn Rules>,
        direction: Direction,
        seed: u64,
    ) -> Box<dyn Search> {
        let coefficients = Coefficients {
            constriction: 1.0,
            inertia_weight: settings.real(&INERTIA_WEIGHT),
            cognitive: settings.real(&COGNITIVE),
            social: settings.real(&SOCIAL),
        };
        Box::new(Swarm::new(self.population(settings), coefficients, space, direction, seed))
    }
}

/// Coefficients of v ← χ (w v + φ₁ r₁ (x̄ − x) + φ₂ r₂ (x̂ − x)). Eq. 1 has χ = 1; the constricted form has w = 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Coefficients {
    /// χ, the constriction factor.
    pub constriction: f64,
    /// w, the inertia weight.
    pub inertia_weight: f64,
    /// φ₁, the pull to the particle's own best.
    pub cognitive: f64,
    /// φ₂, the pull to the swarm's best.
    pub social: f64,
}

/// Best position so far and its score.
#[derive(Clone, Debug, PartialEq)]
struct Best {
    position: Genotype,
    score: f64,
}

#[derive(Clone, Debug, PartialEq)]
struct Particle {
    /// x, the candidate.
    position: Genotype,
    /// v, the velocity.
    velocity: Vec<f64>,
    /// x̄, the best position of the particle's history.
    best: Option<Best>,
}

/// The swarm.
#[derive(Clone, Debug)]
pub(super) struct Swarm {
    coefficients: Coefficients,
    space: Space,
    direction: Direction,
    seed: u64,
    generation: u32,
    particles: Vec<Particle>,
    /// x̂, the best position of all particles' histories.
    best: Option<Best>,
}

impl Swarm {
    /// Creates particles at random positions within the bounds: line 3 of Algorithm 2.
    pub fn new(size: u32, coefficients: Coefficients, space: Space, direction: Direction, seed: u64) -> Self {
        let particle = |i| {
            let mut random = Stream::new(seed, Purpose::InitialVelocity, 0, i, 0);
            let half_range = |(low, high): (f64, f64)| (high - low) / 2.0;
            let component = |bound| random.uniform(-half_range(bound), half_range(bound));
            Particle {
                position: random_genotype(&space, seed, i),
                velocity: space.bounds().map(component).collect(),
                best: None,
            }
        };
        let particles = (0..size).map(particle).collect();
        Self { coefficients, space, direction, seed, generation: 0, particles, best: None }
    }

    /// Updates the bests: lines 9 and 10 of Algorithm 2.
    fn update_bests(&mut self, evaluations: &[Evaluation]) {
        for (particle, &Evaluation { score, .. }) in self.particles.iter_mut().zip(evaluations) {
            let beats = |best: &Option<Best>| self.direction.better(score, best.as_ref().map(|b| b.score));
            let Some(value) = score else { continue };
            if beats(&particle.best) {
                particle.best = Some(Best { position: particle.position.clone(), score: value });
            }
            if beats(&self.best) {
                self.best = Some(Best { position: particle.position.clone(), score: value });
            }
        }
    }

    /// Moves the particles to their positions of `self.generation` by Eq. 1: line 11 of Algorithm 2.
    fn fly(&mut self) {
        let Coefficients { constriction, inertia_weight, cognitive, social } = self.coefficients;
        for (i, particle) in self.particles.iter_mut().enumerate() {
            let mut random = Stream::new(self.seed, Purpose::SwarmUpdate, self.generation, i as u32, 0);
            let position = particle.position.numbers_mut();
            for (j, (low, high)) in self.space.bounds().enumerate() {
                let (r1, r2) = (random.unit(), random.unit());
                let x = position[j];
                let toward = |best: &Option<Best>| best.as_ref().map_or(0.0, |b| b.position.numbers()[j] - x);
                let v = constriction
                    * (inertia_weight * particle.velocity[j]
                        + cognitive * r1 * toward(&particle.best)
                        + social * r2 * toward(&self.best));
                let moved = x + v;
                let inside = moved.clamp(low, high);
                position[j] = inside;
                particle.velocity[j] = if inside == moved { v } else { 0.0 };
            }
        }
    }

    fn owner(&self) -> Owner {
        Owner { kind: b'p', seed: self.seed, population: self.particles.len(), genotype: self.space.genes.len() }
    }

    /// Returns the number of numbers in a stored state: the swarm's best, and position, velocity and best of every
    /// particle.
    fn numbers(&self) -> usize {
        let (best, vector) = (2 + self.space.genes.len(), self.space.genes.len());
        best + self.particles.len() * (2 * vector + best)
    }

    fn write_best(&self, writer: &mut Writer, best: Option<&Best>) {
        writer.number(if best.is_some() { 1.0 } else { 0.0 });
        writer.number(best.map_or(0.0, |b| b.score));
        match best {
            Some(best) => writer.numbers(best.position.numbers()),
            // Any place within the bounds is valid: it is not read back as a best.
            None => self.space.bounds().for_each(|(low, _)| writer.number(low)),
        }
    }

    fn read_best(&self, reader: &mut Reader) -> Result<Option<Best>, BadState> {
        let there = reader.number()?;
        let score = reader.number()?;
        let position = reader.genotype(&self.space)?;
        match there {
            0.0 => Ok(None),
            1.0 => Ok(Some(Best { position, score })),
            other => Err(BadState(format!("it holds {other} where only 0 or 1 is allowed"))),
        }
    }
}

impl Search for Swarm {
    fn ask(&self) -> Batch {
        Batch { ask: Ask::Set, genotypes: self.particles.iter().map(|p| p.position.clone()).collect() }
    }

    /// Receives the evaluations. A particle that was evaluated at another position moves there.
    fn tell(&mut self, evaluations: &[Evaluation]) {
        assert_eq!(evaluations.len(), self.particles.len(), "one evaluation per particle is needed");
        for (particle, evaluation) in self.particles.iter_mut().zip(evaluations) {
            particle.position.clone_from(&evaluation.genotype);
        }
        self.update_bests(evaluations);
        self.generation += 1;
        self.fly();
    }

    fn generation(&self) -> u32 {
        self.generation
    }

    fn save(&self) -> Vec<u8> {
        let mut writer = Writer::new(self.owner(), self.generation, self.numbers());
        self.write_best(&mut writer, self.best.as_ref());
        for particle in &self.particles {
            writer.numbers(particle.position.numbers());
            writer.numbers(&particle.velocity);
            self.write_best(&mut writer, particle.best.as_ref());
        }
        writer.finish()
    }

    fn restore(&mut self, state: &[u8]) -> Result<(), BadState> {
        let (mut reader, generation) = Reader::new(state, self.owner(), self.numbers())?;
        let best = self.read_best(&mut reader)?;
        let particles = (0..self.particles.len())
            .map(|_| {
                let position = reader.genotype(&self.space)?;
                let velocity = reader.vector()?;
                Ok(Particle { position, velocity, best: self.read_best(&mut reader)? })
            })
            .collect::<Result<_, BadState>>()?;
        (self.generation, self.best, self.particles) = (generation, best, particles);
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
    fn particle_moves_as_eq_1_computed_by_hand() {
        let coefficients = Coefficients { constriction: 1.0, inertia_weight: 0.1, cognitive: 2.0, social: 2.0 };
        let mut swarm = Swarm::new(2, coefficients, Space::of_reals([(-10.0, 10.0)]), Direction::Maximise, 3);
        let best = |at: f64| Some(Best { position: vec![at].into(), score: 0.0 });
        swarm.particles[1] = Particle { position: vec![1.0].into(), velocity: vec![0.5], best: best(1.5) };
        swarm.best = best(2.0);
        swarm.generation = 7;
        let mut random = Stream::new(3, Purpose::SwarmUpdate, 7, 1, 0);
        let (r1, r2) = (random.unit(), random.unit());
        swarm.fly();
        let v = 0.1 * 0.5 + 2.0 * r1 * (1.5 - 1.0) + 2.0 * r2 * (2.0 - 1.0);
        assert_eq!(swarm.particles[1].velocity, [v]);
        assert_eq!(swarm.particles[1].position.numbers(), [1.0 + v]);
    }

    #[test]
    fn particle_stops_at_bound() {
        let coefficients = Coefficients { constriction: 1.0, inertia_weight: 1.0, cognitive: 0.0, social: 0.0 };
        let mut swarm = Swarm::new(1, coefficients, Space::of_reals([(0.0, 1.0); 2]), Direction::Maximise, 3);
        swarm.particles[0].position = vec![0.75, 0.5].into();
        swarm.particles[0].velocity = vec![0.5, 0.25];
        swarm.tell(&swarm.ask().scored(&[Some(1.0)]));
        assert_eq!(swarm.particles[0].position.numbers(), [1.0, 0.75]);
        assert_eq!(swarm.particles[0].velocity, [0.0, 0.25]);
    }

    #[test]
    fn bests_need_strict_improvement_with_ties_to_lowest_index() {
        let coefficients = Coefficients { constriction: 0.73, inertia_weight: 1.0, cognitive: 2.05, social: 2.05 };
        let mut swarm = Swarm::new(3, coefficients, Space::of_reals([(0.0, 1.0); 2]), Direction::Minimise, 3);
        let first = swarm.ask().genotypes;
        swarm.tell(&swarm.ask().scored(&[None, Some(4.0), Some(4.0)]));
        assert_eq!(swarm.particles[0].best, None);
        assert_eq!(swarm.best.as_ref().map(|b| &b.position), Some(&first[1]));
        swarm.tell(&swarm.ask().scored(&[Some(f64::NAN), Some(4.0), Some(5.0)]));
        assert_eq!(swarm.particles[0].best, None);
        assert_eq!(swarm.particles[1].best.as_ref().map(|b| &b.position), Some(&first[1]));
        assert_eq!(swarm.particles[2].best.as_ref().map(|b| &b.position), Some(&first[2]));
    }

    #[test]
    fn genotype_other_than_sent_becomes_position() {
        let coefficients = Coefficients { constriction: 1.0, inertia_weight: 0.0, cognitive: 0.0, social: 0.0 };
        let mut swarm = Swarm::new(2, coefficients, Space::of_reals([(0.0, 1.0); 2]), Direction::Minimise, 3);
        let mut evaluations = swarm.ask().scored(&[Some(2.0), Some(1.0)]);
        evaluations[1].genotype = vec![0.25, 0.75].into();
        swarm.tell(&evaluations);
        // Without inertia and pull, a particle stays where it is.
        assert_eq!(swarm.ask().genotypes, [evaluations[0].genotype.clone(), vec![0.25, 0.75].into()]);
        assert_eq!(swarm.best, Some(Best { position: vec![0.25, 0.75].into(), score: 1.0 }));
    }
}
