//! Kinds of searches, and the `[optimiser]` table of a job that chooses one.

use super::real::{Constriction, Ga, Pso};
use super::{Ask, Search};
use crate::base::error::{Faults, Invalid};
use crate::base::limits::MAX_GENERATIONS;
use crate::base::registry::{Registered, Registry};
use crate::base::score::Direction;
use crate::base::settings::{Configurable, Setting, Settings, Table};
use crate::genotype::{Gene, Length, NamedGene, Space};

/// The searches there are.
static SEARCHES: Registry<dyn SearchKind> = Registry::new(&[&Pso, &Constriction, &Ga]);

/// Generations that are scored. Every kind has this setting.
pub const GENERATIONS: Setting = Setting::whole("generations", 150).within(1.0, MAX_GENERATIONS as f64);

/// A kind of search, chosen by `kind` in the `[optimiser]` table.
pub trait SearchKind: Configurable {
    /// Returns the kind of evaluation that it needs.
    fn asks(&self) -> Ask {
        Ask::Set
    }

    /// Candidates of a generation.
    fn population(&self, settings: &Settings) -> u32;

    /// Refuses settings that can't stand together. Their ranges are checked beside it.
    fn conflicts(&self, _settings: &Settings) -> Result<(), Invalid> {
        Ok(())
    }

    /// Refuses a space that it can't search in: by default every space except that of real vectors.
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

    /// A search at generation 0, with settings that were accepted, in a space that it takes. All its randomness
    /// follows from `seed`.
    fn build(&self, settings: &Settings, space: Space, direction: Direction, seed: u64) -> Box<dyn Search>;
}

impl Registered for dyn SearchKind {
    fn registry() -> &'static Registry<Self> {
        &SEARCHES
    }
}

/// The `[optimiser]` table: a search and its settings. The defaults are the paper's where it states one.
pub type OptimiserSpec = Table<dyn SearchKind>;

impl OptimiserSpec {
    /// Revision of how candidates are searched for.
    pub(crate) fn revision(&self) -> u32 {
        self.kind.0.revision()
    }

    /// Candidates of a generation.
    pub fn population(&self) -> u32 {
        self.kind.0.population(&self.settings)
    }

    /// Refuses a space that the search can't search in.
    pub fn takes(&self, space: &Space) -> Result<(), Invalid> {
        self.kind.0.takes(space)
    }

    /// Generations that are scored.
    pub fn generations(&self) -> u32 {
        self.settings.whole(&GENERATIONS)
    }

    /// Refuses settings out of range, and combinations that can't work: swarms that diverge, more elites than
    /// individuals. Refuses a search that needs evaluations which no procedure does.
    pub fn validate(&self) -> Result<(), Invalid> {
        let mut faults = Faults::default();
        if self.kind.0.asks() == Ask::Motion {
            let reason = format!(
                "\"{}\" asks for evaluations of single motions, which evogait can't do yet: choose another kind",
                self.kind.0.name()
            );
            faults.add(Invalid::Conflict { field: "optimiser.kind".into(), reason });
        }
        faults.take(self.settings.check("optimiser"));
        faults.take(self.kind.0.conflicts(&self.settings));
        faults.end()
    }
}
