//! Archive of a search: its best distinct genotypes, from which the finish chooses the winner, and its global bests,
//! which the finish audits.

use crate::base::score::Direction;
use crate::search::Scored;

/// Most global bests that are kept. If there are more, a new one replaces the newest.
pub const MAX_BESTS: usize = 1000;

/// The best distinct genotypes of a search, best first, and all of its global bests.
///
/// Genotypes are distinguished by their bits. A genotype that was scored several times (an elite of a genetic
/// algorithm) counts with its best score, the earliest of equal ones. Genotypes with equal scores are ordered by
/// generation and candidate. The content does not depend on the order in which candidates of one generation are added.
#[derive(Clone, Debug, PartialEq)]
pub struct Archive {
    direction: Direction,
    capacity: usize,
    entries: Vec<Scored>,
    bests: Vec<Scored>,
}

impl Archive {
    /// Creates an empty archive for up to `capacity` genotypes.
    pub fn new(direction: Direction, capacity: u32) -> Self {
        Self { direction, capacity: capacity as usize, entries: Vec::new(), bests: Vec::new() }
    }

    /// Restores an archive from stored [`Archive::entries`] and [`Archive::bests`].
    pub fn restore(direction: Direction, capacity: u32, entries: Vec<Scored>, bests: Vec<Scored>) -> Self {
        let mut archive = Self { bests, ..Self::new(direction, capacity) };
        entries.into_iter().for_each(|entry| archive.keep(entry));
        archive
    }

    /// Adds the successful candidates of a generation. NaN scores are skipped.
    pub fn generation(&mut self, candidates: impl IntoIterator<Item = Scored>) {
        let mut best: Option<Scored> = None;
        for scored in candidates.into_iter().filter(|s| !s.score.is_nan()) {
            if best.as_ref().is_none_or(|b| self.before(&scored, b)) {
                best = Some(scored.clone());
            }
            self.keep(scored);
        }
        if let Some(best) = best
            && self.direction.better(Some(best.score), self.bests.last().map(|b| b.score))
        {
            self.bests.truncate(MAX_BESTS - 1);
            self.bests.push(best);
        }
    }

    /// Returns the best genotypes, best first.
    pub fn entries(&self) -> &[Scored] {
        &self.entries
    }

    /// Returns the global bests in order of generation; each is strictly better than the one before.
    pub fn bests(&self) -> &[Scored] {
        &self.bests
    }

    fn keep(&mut self, scored: Scored) {
        if let Some(at) = self.entries.iter().position(|e| same_genotype(e, &scored)) {
            if !self.before(&scored, &self.entries[at]) {
                return;
            }
            self.entries.remove(at);
        }
        let at = self.entries.partition_point(|e| self.before(e, &scored));
        self.entries.insert(at, scored);
        self.entries.truncate(self.capacity);
    }

    /// Returns true if `a` ranks before `b`: it has the better score, or an equal one earlier.
    fn before(&self, a: &Scored, b: &Scored) -> bool {
        if a.score == b.score {
            (a.generation, a.candidate) < (b.generation, b.candidate)
        } else {
            self.direction.better(Some(a.score), Some(b.score))
        }
    }
}

fn same_genotype(a: &Scored, b: &Scored) -> bool {
    a.genotype.same_bits(&b.genotype)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Generates few scores and few genotypes, so that ties and repeats are common.
    fn search() -> impl Strategy<Value = Vec<Vec<Scored>>> {
        let candidate =
            (0u8..6, 0u8..9).prop_map(|(score, genotype)| (f64::from(score) - 3.0, f64::from(genotype) - 1.0));
        prop::collection::vec(prop::collection::vec(candidate, 1..6), 0..8).prop_map(|generations| {
            let scored = |(g, c, &(score, gene)): (usize, usize, &(f64, f64))| Scored {
                generation: g as u32,
                candidate: c as u32,
                score,
                genotype: vec![gene * 0.0, gene].into(),
            };
            let generation = |(g, candidates): (usize, &Vec<_>)| {
                candidates.iter().enumerate().map(|(c, it)| scored((g, c, it))).collect()
            };
            generations.iter().enumerate().map(generation).collect()
        })
    }

    /// Returns the best distinct genotypes of everything that was scored, best first.
    fn oracle(direction: Direction, capacity: usize, search: &[Vec<Scored>]) -> Vec<Scored> {
        let mut all: Vec<Scored> = search.iter().flatten().cloned().collect();
        // The sort is stable: of equal scores the earlier stays first.
        all.sort_by(|a, b| match direction {
            Direction::Maximise => b.score.total_cmp(&a.score),
            Direction::Minimise => a.score.total_cmp(&b.score),
        });
        let mut distinct: Vec<Scored> = Vec::new();
        for scored in all {
            if !distinct.iter().any(|d| same_genotype(d, &scored)) {
                distinct.push(scored);
            }
        }
        distinct.truncate(capacity);
        distinct
    }

    proptest! {
        #[test]
        fn archive_holds_best_distinct_genotypes(
            search in search(), capacity in 1u32..8, maximise in any::<bool>(), crash in 0usize..8, backwards in any::<bool>(),
        ) {
            let direction = if maximise { Direction::Maximise } else { Direction::Minimise };
            let mut archive = Archive::new(direction, capacity);
            for (i, generation) in search.iter().enumerate() {
                let mut generation = generation.clone();
                if backwards {
                    generation.reverse();
                }
                archive.generation(generation);
                if i == crash {
                    let (entries, bests) = (archive.entries().to_vec(), archive.bests().to_vec());
                    archive = Archive::restore(direction, capacity, entries, bests);
                }
            }
            prop_assert_eq!(archive.entries(), oracle(direction, capacity as usize, &search));

            // The best of all is the newest global best; each global best was better than all candidates before it.
            prop_assert_eq!(archive.bests().last(), archive.entries().first());
            for best in archive.bests() {
                let until: Vec<_> = search[..=best.generation as usize].to_vec();
                prop_assert_eq!(oracle(direction, 1, &until), std::slice::from_ref(best));
            }
            let firsts = (0..search.len()).filter_map(|g| oracle(direction, 1, &search[..=g]).pop());
            let mut expected: Vec<Scored> = firsts.collect();
            expected.dedup();
            prop_assert_eq!(archive.bests(), expected);
        }
    }

    #[test]
    fn minus_zero_is_distinct_genotype_and_nan_is_skipped() {
        let scored = |candidate, score, gene| Scored { generation: 0, candidate, score, genotype: vec![gene].into() };
        let mut archive = Archive::new(Direction::Maximise, 9);
        archive.generation([scored(0, 1.0, 0.0), scored(1, 1.0, -0.0), scored(2, f64::NAN, 5.0)]);
        assert_eq!(archive.entries().iter().map(|e| e.candidate).collect::<Vec<_>>(), [0, 1]);
        assert_eq!(archive.bests().len(), 1);
    }

    #[test]
    fn bests_are_limited_and_keep_the_newest() {
        let mut archive = Archive::new(Direction::Minimise, 1);
        for generation in 0..2000 {
            let score = -f64::from(generation);
            archive.generation([Scored { generation, candidate: 0, score, genotype: vec![score].into() }]);
        }
        assert_eq!(archive.bests().len(), MAX_BESTS);
        assert_eq!((archive.bests()[0].generation, archive.bests()[MAX_BESTS - 1].generation), (0, 1999));
        assert_eq!(archive.entries()[0].generation, 1999);
    }
}
