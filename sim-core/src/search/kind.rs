//! Kinds of searches, and the `[optimiser]` table of a job, which selects one.

use super::real::{Constriction, Ga, Pso};
use super::sequence::SequenceGa;
use super::{Ask, Search};
use crate::base::error::{Faults, Invalid};
use crate::base::limits::MAX_GENERATIONS;
use crate::base::registry::{Registered, Registry};
use crate::base::score::Direction;
use crate::base::settings::{Configurable, Setting, Settings, Table};
use crate::genotype::{Gene, Length, NamedGene, Rules, Space};
use std::sync::Arc;

/// The built-in kinds of searches.
static SEARCHES: Registry<dyn SearchKind> = Registry::new(&[&Pso, &Constriction, &Ga, &SequenceGa]);

/// Number of generations that are scored. Every kind has this setting.
pub const GENERATIONS: Setting = Setting::whole("generations", 150).within(1.0, MAX_GENERATIONS as f64);

/// A kind of search, selected by `kind` in the `[optimiser]` table.
pub trait SearchKind: Configurable {
    /// Returns the kind of evaluation that the search needs.
    fn asks(&self) -> Ask {
        Ask::Set
    }

    /// Returns the number of candidates in generation 0. No later generation has more.
    fn population(&self, settings: &Settings) -> u32;

    /// Returns the number of candidates in the first `generations` generations together. By default all generations
    /// have equally many.
    fn evaluations(&self, settings: &Settings, generations: u32) -> u64 {
        u64::from(self.population(settings)) * u64::from(generations)
    }

    /// Rejects combinations of settings that can't work. Ranges are checked separately.
    fn conflicts(&self, _settings: &Settings) -> Result<(), Invalid> {
        Ok(())
    }

    /// Rejects a space that the kind can't search. By default it accepts only spaces of real vectors.
    fn takes(&self, space: &Space) -> Result<(), Invalid> {
        let choice = |named: &&NamedGene| matches!(named.gene, Gene::Choice { .. });
        let found = match (space.length, space.genes.iter().find(choice)) {
            (Length::Sequence { .. }, _) => "the genotypes of this job are sequences of segments".to_owned(),
            (Length::Fixed, Some(choice)) => format!("{} is a choice", choice.name),
            (Length::Fixed, None) => return Ok(()),
        };
        let reason = format!(
            "\"{}\" searches vectors of real numbers, and {found}: choose another kind, or another controller",
            self.name()
        );
        Err(Invalid::Conflict { field: "optimiser.kind".into(), reason })
    }

    /// Creates a search at generation 0. The settings were validated and the space was accepted by
    /// [`SearchKind::takes`]. All random numbers follow from `seed`. Searches of real vectors ignore the rules: they
    /// propose candidates that break them too.
    fn build(
        &self,
        settings: &Settings,
        space: Space,
        rules: Arc<dyn Rules>,
        direction: Direction,
        seed: u64,
    ) -> Box<dyn Search>;
}

impl Registered for dyn SearchKind {
    fn registry() -> &'static Registry<Self> {
        &SEARCHES
    }
}

/// The `[optimiser]` table: a kind of search and its settings. The defaults are the paper's if it states a value.
pub type OptimiserSpec = Table<dyn SearchKind>;

impl OptimiserSpec {
    /// Returns the revision of the search's algorithm.
    pub(crate) fn revision(&self) -> u32 {
        self.kind.0.revision()
    }

    /// Returns the number of candidates in generation 0. No later generation has more.
    pub fn population(&self) -> u32 {
        self.kind.0.population(&self.settings)
    }

    /// Returns the number of candidates in a generation.
    pub fn candidates(&self, generation: u32) -> u32 {
        let until = |generation| self.evaluations(generation);
        (until(generation.saturating_add(1)) - until(generation)) as u32
    }

    /// Returns the number of candidates in the first `generations` generations together.
    pub fn evaluations(&self, generations: u32) -> u64 {
        self.kind.0.evaluations(&self.settings, generations)
    }

    /// Rejects a space that the search can't use.
    pub fn takes(&self, space: &Space) -> Result<(), Invalid> {
        self.kind.0.takes(space)
    }

    /// Returns the number of generations that are scored.
    pub fn generations(&self) -> u32 {
        self.settings.whole(&GENERATIONS)
    }

    /// Rejects settings out of range, and combinations that can't work: a swarm that diverges, more elites than
    /// individuals. Also rejects a search that needs evaluations which no procedure offers.
    pub fn validate(&self) -> Result<(), Invalid> {
        let mut faults = Faults::default();
        if self.kind.0.asks() == Ask::Motion {
            let reason = format!(
                "\"{}\" needs evaluations of single motions, which evogait can't do yet: choose another kind",
                self.kind.0.name()
            );
            faults.add(Invalid::Conflict { field: "optimiser.kind".into(), reason });
        }
        faults.take(self.settings.check("optimiser"));
        faults.take(self.kind.0.conflicts(&self.settings));
        faults.end()
    }
}
