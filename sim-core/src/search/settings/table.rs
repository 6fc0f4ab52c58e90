//! The table as it is read: the settings of all kinds side by side. An enum that is told apart by a field forgets where in
//! the file a value stood; this way a value of the wrong type is told with its line.

use super::OptimiserSpec;
use crate::base::error::only_settings_of;
use serde::Deserialize;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Table {
    kind: Kind,
    generations: Option<u32>,
    // Swarms.
    particles: Option<u32>,
    inertia_weight: Option<f64>,
    cognitive: Option<f64>,
    social: Option<f64>,
    // Genetic algorithms.
    population: Option<u32>,
    tournament: Option<u32>,
    crossover_rate: Option<f64>,
    crossover_eta: Option<f64>,
    mutation_rate: Option<f64>,
    mutation_scale: Option<f64>,
    elite: Option<u32>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Kind {
    Pso,
    PsoConstriction,
    Ga,
}

impl TryFrom<Table> for OptimiserSpec {
    type Error = String;

    fn try_from(table: Table) -> Result<Self, String> {
        const PSO: &str = "pso";
        const CONSTRICTION: &str = "pso-constriction";
        const GA: &str = "ga";
        let kind = match table.kind {
            Kind::Pso => PSO,
            Kind::PsoConstriction => CONSTRICTION,
            Kind::Ga => GA,
        };
        only_settings_of(
            kind,
            &[
                ("generations", table.generations.is_some(), &[PSO, CONSTRICTION, GA]),
                ("particles", table.particles.is_some(), &[PSO, CONSTRICTION]),
                ("inertia_weight", table.inertia_weight.is_some(), &[PSO]),
                ("cognitive", table.cognitive.is_some(), &[PSO, CONSTRICTION]),
                ("social", table.social.is_some(), &[PSO, CONSTRICTION]),
                ("population", table.population.is_some(), &[GA]),
                ("tournament", table.tournament.is_some(), &[GA]),
                ("crossover_rate", table.crossover_rate.is_some(), &[GA]),
                ("crossover_eta", table.crossover_eta.is_some(), &[GA]),
                ("mutation_rate", table.mutation_rate.is_some(), &[GA]),
                ("mutation_scale", table.mutation_scale.is_some(), &[GA]),
                ("elite", table.elite.is_some(), &[GA]),
            ],
        )?;
        let generations = table.generations.unwrap_or(150);
        Ok(match table.kind {
            Kind::Pso => Self::Pso {
                particles: table.particles.unwrap_or(20),
                generations,
                inertia_weight: table.inertia_weight.unwrap_or(0.1),
                cognitive: table.cognitive.unwrap_or(2.0),
                social: table.social.unwrap_or(2.0),
            },
            Kind::PsoConstriction => Self::PsoConstriction {
                particles: table.particles.unwrap_or(20),
                generations,
                cognitive: table.cognitive.unwrap_or(2.05),
                social: table.social.unwrap_or(2.05),
            },
            Kind::Ga => Self::Ga {
                population: table.population.unwrap_or(20),
                generations,
                tournament: table.tournament.unwrap_or(2),
                crossover_rate: table.crossover_rate.unwrap_or(0.9),
                crossover_eta: table.crossover_eta.unwrap_or(10.0),
                mutation_rate: table.mutation_rate,
                mutation_scale: table.mutation_scale.unwrap_or(0.1),
                elite: table.elite.unwrap_or(1),
            },
        })
    }
}
