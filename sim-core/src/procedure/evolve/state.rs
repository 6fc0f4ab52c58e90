//! Stored state of an evolution between two rounds.

use super::{Evolve, Examined, check};
use crate::base::encoding::{self, Bytes};
use crate::base::score::Counts;
use crate::problem::Checked;
use crate::procedure::{BadState, Procedure as _};
use crate::search::Scored;
use crate::search::archive::{Archive, MAX_BESTS};
use serde::{Deserialize, Serialize};

/// First byte of a stored state.
const FORMAT: u8 = 0xD1;

#[derive(Serialize, Deserialize)]
struct Saved {
    optimiser: Bytes,
    entries: Vec<Scored>,
    bests: Vec<Scored>,
    counts: Counts,
    failed: u64,
    examined: Option<Vec<Examined>>,
}

impl Evolve {
    /// Returns the state between two rounds.
    pub(super) fn state(&self) -> Vec<u8> {
        encoding::encode(
            FORMAT,
            &Saved {
                optimiser: Bytes(self.optimiser.save()),
                entries: self.archive.entries().to_vec(),
                bests: self.archive.bests().to_vec(),
                counts: self.counts,
                failed: self.failed,
                examined: self.examined.clone(),
            },
        )
    }

    /// Restores an evolution from a saved state.
    pub fn load(job: &Checked, saved: &[u8]) -> Result<Self, BadState> {
        let saved: Saved = encoding::decode(FORMAT, saved).map_err(|e| BadState(e.to_string()))?;
        let mut evolve = Self::new(job);
        evolve.optimiser.restore(&saved.optimiser.0).map_err(|e| BadState(e.0))?;
        let (generation, generations) = (evolve.optimiser.generation(), evolve.generations());
        if generation > generations {
            return Err(BadState(format!("it is at generation {generation}, but the job has {generations}")));
        }
        evolve.archive = archive(&evolve, saved.entries, saved.bests)?;
        let evaluations = evolve.evaluations();
        if saved.failed > evaluations {
            return Err(BadState(format!("it counts {} failed of {evaluations} evaluations", saved.failed)));
        }
        if (saved.failed == evaluations) != evolve.best().is_none() {
            return Err(BadState(
                "it has a best although all evaluations failed, or no best although some succeeded".to_owned(),
            ));
        }
        (evolve.counts, evolve.failed) = (saved.counts, saved.failed);
        evolve.examined = saved.examined;
        check_answers(&evolve)?;
        evolve.work = evolve.next_work().ok_or_else(|| BadState("the search is over without a best".to_owned()))?;
        if evolve.round().tasks == 0 {
            return Err(BadState("it is at a round without tasks".to_owned()));
        }
        Ok(evolve)
    }
}

/// Restores the archive, if its entries are possible for a search of this job.
fn archive(evolve: &Evolve, entries: Vec<Scored>, bests: Vec<Scored>) -> Result<Archive, BadState> {
    let (plan, job) = (&evolve.plan, &evolve.job);
    let generation = evolve.optimiser.generation();
    let fits = |scored: &Scored| {
        scored.generation < generation
            && scored.candidate < job.optimiser_spec().candidates(scored.generation)
            && check::in_range(job, Some(scored.score)).is_ok()
            && job.space().check(&scored.genotype).is_ok()
    };
    if let Some(odd) = entries.iter().chain(&bests).find(|scored| !fits(scored)) {
        return Err(BadState(format!(
            "candidate {} of generation {} in its archive does not fit this job",
            odd.candidate, odd.generation
        )));
    }
    let rises = bests.windows(2).all(|pair| plan.direction.better(Some(pair[1].score), Some(pair[0].score)));
    if bests.len() > MAX_BESTS || !rises {
        return Err(BadState("each of its global bests must be better than the one before".to_owned()));
    }
    let restored = Archive::restore(plan.direction, plan.archive, entries.clone(), bests);
    if restored.entries() != entries {
        return Err(BadState("its archive is too long or not in order".to_owned()));
    }
    Ok(restored)
}

/// Rejects answers before the end of the search, and answers that do not match the finishing round's examinations.
fn check_answers(evolve: &Evolve) -> Result<(), BadState> {
    let Some(answers) = &evolve.examined else { return Ok(()) };
    let over = evolve.optimiser.generation() == evolve.generations();
    let asked = evolve.found().filter(|_| over).map(|found| evolve.plan.finishing(&found));
    let Some(asked) = asked else {
        return Err(BadState("it has answers before the search is over".to_owned()));
    };
    let fits = asked.len() == answers.len()
        && asked.iter().zip(answers).all(|(examination, answer)| {
            answer.scores.len() == check::scores_of(&evolve.job, examination.question)
                && answer.scores.iter().all(|&score| check::in_range(&evolve.job, score).is_ok())
        });
    if fits { Ok(()) } else { Err(BadState("its answers do not match the examinations".to_owned())) }
}
