//! The `[optimiser]` table of a job.

use crate::base::error::{Faults, Invalid, in_range, whole_in_range};
use crate::base::limits::{MAX_GENERATIONS, MAX_POPULATION};
use serde::{Deserialize, Serialize};

mod table;

/// Which optimiser, with its settings. The defaults are the paper's where it states one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", try_from = "table::Table")]
pub enum OptimiserSpec {
    /// Particle swarm by Eq. 1 and Algorithm 2 of Vonásek and Faigl (2016).
    Pso {
        /// p, particles.
        particles: u32,
        /// g, generations.
        generations: u32,
        /// w in Eq. 1.
        inertia_weight: f64,
        /// φ₁ in Eq. 1, the pull to the particle's own best.
        cognitive: f64,
        /// φ₂ in Eq. 1, the pull to the swarm's best.
        social: f64,
    },
    /// The same swarm with Clerc and Kennedy's constriction: v ← χ (v + φ₁ r₁ (…) + φ₂ r₂ (…)),
    /// χ = 2 / |2 − φ − √(φ² − 4φ)| with φ = φ₁ + φ₂ > 4 (IEEE Trans. Evol. Comp. 6(1), 2002).
    PsoConstriction {
        /// Particles.
        particles: u32,
        /// Generations.
        generations: u32,
        /// φ₁.
        cognitive: f64,
        /// φ₂.
        social: f64,
    },
    /// Genetic algorithm on real vectors: tournaments, simulated binary crossover, Gaussian mutation, elitism.
    Ga {
        /// Individuals.
        population: u32,
        /// Generations.
        generations: u32,
        /// Individuals that compete for a parent's place.
        tournament: u32,
        /// Chance that a pair of parents is crossed rather than copied.
        crossover_rate: f64,
        /// η of simulated binary crossover: larger keeps children nearer to their parents.
        crossover_eta: f64,
        /// Chance of a gene to mutate; 1 / length unless given.
        #[serde(skip_serializing_if = "Option::is_none")]
        mutation_rate: Option<f64>,
        /// Standard deviation of a mutation, as a share of the gene's range.
        mutation_scale: f64,
        /// Best individuals that pass on unchanged.
        elite: u32,
    },
}

impl OptimiserSpec {
    /// Revision of how candidates are searched for.
    pub(crate) fn revision(&self) -> u32 {
        match self {
            Self::Pso { .. } | Self::PsoConstriction { .. } | Self::Ga { .. } => 1,
        }
    }

    /// How many candidates a generation has.
    pub fn population(&self) -> u32 {
        match *self {
            Self::Pso { particles, .. } | Self::PsoConstriction { particles, .. } => particles,
            Self::Ga { population, .. } => population,
        }
    }

    /// How many generations are scored.
    pub fn generations(&self) -> u32 {
        match *self {
            Self::Pso { generations, .. }
            | Self::PsoConstriction { generations, .. }
            | Self::Ga { generations, .. } => generations,
        }
    }

    /// Refuses settings that can't work: nobody to score, nothing to do, swarms that explode, more elites than places.
    pub fn validate(&self) -> Result<(), Invalid> {
        let chance = |field, value| in_range(field, value, (0.0, 1.0), "");
        let pull = |field, value| in_range(field, value, (0.0, 10.0), "");
        let mut faults = Faults::default();
        faults.take(whole_in_range("optimiser.generations", self.generations(), (1, MAX_GENERATIONS.into()), ""));
        match *self {
            Self::Pso { particles, inertia_weight, cognitive, social, .. } => {
                faults.take(whole_in_range("optimiser.particles", particles, (1, MAX_POPULATION.into()), ""));
                faults.take(in_range("optimiser.inertia_weight", inertia_weight, (0.0, 2.0), ""));
                faults.take(pull("optimiser.cognitive", cognitive));
                faults.take(pull("optimiser.social", social));
            }
            Self::PsoConstriction { particles, cognitive, social, .. } => {
                faults.take(whole_in_range("optimiser.particles", particles, (1, MAX_POPULATION.into()), ""));
                let pulls = [pull("optimiser.cognitive", cognitive), pull("optimiser.social", social)];
                if pulls.iter().all(Result::is_ok) && cognitive + social <= 4.0 {
                    faults.add(Invalid::Conflict {
                        field: "optimiser.cognitive".into(),
                        reason: format!(
                            "constriction is defined for cognitive + social above 4, here it is {}: \
                             use 2.05 for each, or kind = \"pso\"",
                            cognitive + social
                        ),
                    });
                }
                for pull in pulls {
                    faults.take(pull);
                }
            }
            Self::Ga {
                population,
                tournament,
                crossover_rate,
                crossover_eta,
                mutation_rate,
                mutation_scale,
                elite,
                ..
            } => {
                let enough = whole_in_range("optimiser.population", population, (2, MAX_POPULATION.into()), "");
                if faults.take(enough).is_some() {
                    faults.take(whole_in_range("optimiser.tournament", tournament, (1, population.into()), ""));
                    faults.take(whole_in_range("optimiser.elite", elite, (0, u64::from(population) - 1), ""));
                }
                faults.take(chance("optimiser.crossover_rate", crossover_rate));
                faults.take(in_range("optimiser.crossover_eta", crossover_eta, (0.0, 1000.0), ""));
                if let Some(rate) = mutation_rate {
                    faults.take(chance("optimiser.mutation_rate", rate));
                }
                faults.take(in_range("optimiser.mutation_scale", mutation_scale, (0.0, 1.0), ""));
            }
        }
        faults.end()
    }
}
