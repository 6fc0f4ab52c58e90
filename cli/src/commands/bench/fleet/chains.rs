//! Overhead of generations: the time that their slowest chain did not need.
//!
//! The chain of a generation belongs to the range that ends last. It is the time from the begin of the generation until
//! a slot was free for that range, because other tasks occupied the slots, and the evaluations of the range. The rest
//! of the time from seal to seal is overhead: transmitting, storing, sealing, assigning, and repeating the tasks of
//! crashed workers.

use std::collections::HashMap;
use std::time::{Duration, Instant};

/// Busy period of a slot: the evaluation of one range.
#[derive(Clone, Copy, Debug)]
pub struct Spell {
    /// Begin of the idle time of the slot before this range.
    pub free_since: Instant,
    /// Begin of the evaluation.
    pub begun: Instant,
    /// End of the evaluation.
    pub ended: Instant,
}

/// Sealed generation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sealed {
    /// Time at which the watcher received the seal.
    pub at: Instant,
    /// Time since the previous seal, s.
    pub took: f64,
    /// Part of `took` that the slowest chain did not need, s. May be slightly negative: a worker can receive tasks of
    /// the next generation before the watcher receives the seal.
    pub overhead: f64,
}

/// Chains of the generations that are not sealed yet, by the seeds of their jobs, and the sealed generations.
#[derive(Debug, Default)]
pub struct Chains {
    last: HashMap<(u64, u32), Spell>,
    seals: HashMap<u64, (u32, Instant)>,
    sealed: Vec<Sealed>,
}

impl Chains {
    /// Records the evaluation of a range.
    pub fn done(&mut self, seed: u64, generation: u32, spell: Spell) {
        // A copy that ends after the seal does not count.
        if self.seals.get(&seed).is_some_and(|(sealed, _)| generation <= *sealed) {
            return;
        }
        let last = self.last.entry((seed, generation)).or_insert(spell);
        if spell.ended > last.ended {
            *last = spell;
        }
    }

    /// Records the seal of a generation.
    pub fn seal(&mut self, seed: u64, generation: u32, at: Instant) {
        let last = self.last.remove(&(seed, generation));
        if let (Some((_, before)), Some(last)) = (self.seals.insert(seed, (generation, at)), last) {
            let waited = last.free_since.saturating_duration_since(before);
            let needed = waited + last.ended.saturating_duration_since(last.begun);
            let took = at.saturating_duration_since(before);
            self.sealed.push(Sealed { at, took: took.as_secs_f64(), overhead: signed(took, needed) });
        }
    }

    /// Returns the generations sealed in a time span, without the first of each job.
    pub fn sealed(&self, from: Instant, to: Instant) -> Vec<Sealed> {
        self.sealed.iter().filter(|s| (from..to).contains(&s.at)).copied().collect()
    }
}

/// Returns a − b, s.
fn signed(a: Duration, b: Duration) -> f64 {
    a.as_secs_f64() - b.as_secs_f64()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Clock(Instant);

    impl Clock {
        fn at(&self, ms: u64) -> Instant {
            self.0 + Duration::from_millis(ms)
        }

        fn spell(&self, free_since: u64, begun: u64, ended: u64) -> Spell {
            Spell { free_since: self.at(free_since), begun: self.at(begun), ended: self.at(ended) }
        }
    }

    fn overheads(chains: &Chains, clock: &Clock) -> Vec<f64> {
        chains.sealed(clock.at(0), clock.at(1_000_000)).iter().map(|s| (1e3 * s.overhead).round()).collect()
    }

    #[test]
    fn overhead_excludes_busy_slot_wait_and_evaluation() {
        let clock = Clock(Instant::now());
        let mut chains = Chains::default();
        chains.seal(1, 0, clock.at(1000));
        // Idle slots: 5 ms until the range begins, 7 ms until the seal.
        chains.done(1, 1, clock.spell(900, 1005, 2000));
        chains.done(1, 1, clock.spell(900, 1004, 3005));
        chains.seal(1, 1, clock.at(3012));
        // A slot with other tasks until 4000 ms: 2 ms until the range begins, 3 ms until the seal.
        chains.done(1, 2, clock.spell(4000, 4002, 5002));
        chains.seal(1, 2, clock.at(5005));
        assert_eq!(overheads(&chains, &clock), [11.0, 5.0]);
        let took: Vec<f64> = chains.sealed(clock.at(0), clock.at(9000)).iter().map(|s| s.took).collect();
        assert!((took[0] - 2.012).abs() < 1e-9 && (took[1] - 1.993).abs() < 1e-9, "{took:?}");
    }

    #[test]
    fn repeated_range_is_overhead_and_late_copy_is_ignored() {
        let clock = Clock(Instant::now());
        let mut chains = Chains::default();
        chains.seal(1, 0, clock.at(0));
        // The first worker crashed. At 5000 ms the range is assigned to a worker that was idle since the begin.
        chains.done(1, 1, clock.spell(0, 5000, 6000));
        chains.seal(1, 1, clock.at(6000));
        chains.done(1, 1, clock.spell(0, 5000, 7000));
        chains.done(1, 2, clock.spell(6000, 6000, 8000));
        chains.seal(1, 2, clock.at(8000));
        assert_eq!(overheads(&chains, &clock), [5000.0, 0.0]);
        assert_eq!(chains.last.len(), 0, "sealed generations leave no entries");
    }

    #[test]
    fn jobs_are_separate_and_first_seal_only_starts_timing() {
        let clock = Clock(Instant::now());
        let mut chains = Chains::default();
        for seed in [1, 2] {
            chains.done(seed, 0, clock.spell(0, 0, 100));
            chains.seal(seed, 0, clock.at(100 * seed));
        }
        assert_eq!(overheads(&chains, &clock), [0.0; 0]);
        chains.done(1, 1, clock.spell(100, 100, 300));
        chains.done(2, 1, clock.spell(200, 210, 300));
        chains.seal(2, 1, clock.at(310));
        assert_eq!(overheads(&chains, &clock), [20.0]);
        assert_eq!(chains.sealed(clock.at(0), clock.at(310)), []);
    }
}
