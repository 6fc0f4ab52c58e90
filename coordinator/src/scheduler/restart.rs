//! A job is done again from one of its generations on: as a new job that takes over what was sealed before.
//!
//! Only scores are taken over. Optimiser and archive follow from them, so the result has the bits of an undisturbed run.

use super::job::ActiveJob;
use super::sealed::Sealed;
use crate::record::Origin;
use crate::store::{SealedGeneration, Write};
use sim_core::base::score::Counts;

/// What a job takes over from the one that it does again.
#[derive(Clone, Debug)]
pub struct Carried {
    /// That job, and how many of its generations.
    pub origin: Origin,
    /// These, by number; each has the job's population.
    pub generations: Vec<SealedGeneration>,
}

impl ActiveJob {
    /// Brings a new job to where the generations it takes over end.
    pub(super) fn take_over(&mut self, carried: Carried) -> Write {
        let Carried { origin, generations } = carried;
        for (number, generation) in (0..).zip(generations) {
            let counts = generation.statistics.counts.map(Counts::from).unwrap_or_default();
            let sealed =
                Sealed { number, finders: Vec::new(), scores: generation.scores, genomes: Some(self.genomes().into()) };
            self.fold_generation(sealed, counts);
        }
        // Whoever asks has seen to it that there is a best if the search is over.
        self.next_round();
        let write =
            Write::Carry { from: origin.job.clone(), to: self.record.id.clone(), generations: origin.generations };
        self.record.restarted_from = Some(origin);
        write
    }
}
