//! The particle swarm in its constricted form: M. Clerc and J. Kennedy, *The particle swarm: explosion, stability, and
//! convergence in a multidimensional complex space*, IEEE Trans. Evol. Comp. 6(1), 2002.

use super::pso::{Coefficients, PARTICLES, Swarm};
use crate::base::error::Invalid;
use crate::base::registry::Component;
use crate::base::score::Direction;
use crate::base::settings::{Configurable, Setting, Settings};
use crate::genotype::{Rules, Space};
use crate::search::{GENERATIONS, Search, SearchKind};
use std::sync::Arc;

/// The swarm of [`super::Pso`] with v ← χ (v + φ₁ r₁ (…) + φ₂ r₂ (…)), where χ = 2 / |2 − φ − √(φ² − 4φ)| and φ = φ₁ +
/// φ₂ > 4.
pub struct Constriction;

/// Weight of a particle's own best, φ₁.
const COGNITIVE: Setting = Setting::real("cognitive", "", 2.05).within(0.0, 10.0);
/// Weight of the swarm's best, φ₂.
const SOCIAL: Setting = Setting::real("social", "", 2.05).within(0.0, 10.0);

impl Component for Constriction {
    fn name(&self) -> &'static str {
        "pso-constriction"
    }
}

impl Configurable for Constriction {
    fn settings(&self) -> &'static [Setting] {
        &[PARTICLES, GENERATIONS, COGNITIVE, SOCIAL]
    }
}

impl SearchKind for Constriction {
    fn population(&self, settings: &Settings) -> u32 {
        settings.whole(&PARTICLES)
    }

    fn conflicts(&self, settings: &Settings) -> Result<(), Invalid> {
        let phi = settings.real(&COGNITIVE) + settings.real(&SOCIAL);
        if settings.fits(&COGNITIVE) && settings.fits(&SOCIAL) && phi <= 4.0 {
            let reason = format!(
                "cognitive + social must be above 4, and here it is {phi}: use 2.05 for each, or kind = \
                 \"pso\""
            );
            return Err(Invalid::Conflict { field: "optimiser.cognitive".into(), reason });
        }
        Ok(())
    }

    fn build(
        &self,
        settings: &Settings,
        space: Space,
        _: Arc<dyn Rules>,
        direction: Direction,
        seed: u64,
    ) -> Box<dyn Search> {
        let coefficients = coefficients(settings.real(&COGNITIVE), settings.real(&SOCIAL));
        Box::new(Swarm::new(self.population(settings), coefficients, space, direction, seed))
    }
}

/// Returns the coefficients of Clerc and Kennedy, for φ₁ + φ₂ > 4.
fn coefficients(cognitive: f64, social: f64) -> Coefficients {
    let phi = cognitive + social;
    let constriction = 2.0 / (2.0 - phi - (phi * phi - 4.0 * phi).sqrt()).abs();
    Coefficients { constriction, inertia_weight: 1.0, cognitive, social }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constriction_factor_matches_published_value() {
        // Clerc and Kennedy: φ = 4.1 gives χ ≈ 0.7298.
        let c = coefficients(2.05, 2.05);
        assert!((c.constriction - 0.7298).abs() < 5e-5, "{}", c.constriction);
    }
}
