//! What generations take beyond what their slowest chain needs.
//!
//! The chain of a generation is what its last range needed: the time from the generation's begin until a slot was free for
//! it, which other work had, and the evaluations of that range. All else from seal to seal is overhead: telling, storing,
//! sealing, handing out, and doing again what died with a worker.

use std::collections::HashMap;
use std::time::{Duration, Instant};

/// A range that was evaluated.
#[derive(Clone, Copy, Debug)]
pub struct Spell {
    /// Since when its slot had nothing to do.
    pub free_since: Instant,
    /// When it began.
    pub begun: Instant,
    /// When it ended.
    pub ended: Instant,
}

/// A generation that was sealed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sealed {
    /// When that was told.
    pub at: Instant,
    /// s since the seal before it.
    pub took: f64,
    /// s of this that the slowest chain did not need. May be a little less than nothing: a worker can be told of work before
    /// the watcher is told of the seal.
    pub overhead: f64,
}

/// Those of the generations at hand, by the seeds of their jobs.
#[derive(Debug, Default)]
pub struct Chains {
    last: HashMap<(u64, u32), Spell>,
    seals: HashMap<u64, (u32, Instant)>,
    sealed: Vec<Sealed>,
}

impl Chains {
    /// A range of a generation is done.
    pub fn done(&mut self, seed: u64, generation: u32, spell: Spell) {
        // A copy that ends after the seal belongs to nothing.
        if self.seals.get(&seed).is_some_and(|(sealed, _)| generation <= *sealed) {
            return;
        }
        let last = self.last.entry((seed, generation)).or_insert(spell);
        if spell.ended > last.ended {
            *last = spell;
        }
    }

    /// A generation was sealed.
    pub fn seal(&mut self, seed: u64, generation: u32, at: Instant) {
        let last = self.last.remove(&(seed, generation));
        if let (Some((_, before)), Some(last)) = (self.seals.insert(seed, (generation, at)), last) {
            let waited = last.free_since.saturating_duration_since(before);
            let needed = waited + last.ended.saturating_duration_since(last.begun);
            let took = at.saturating_duration_since(before);
            self.sealed.push(Sealed { at, took: took.as_secs_f64(), overhead: signed(took, needed) });
        }
    }

    /// Those sealed in a stretch of time, but for the first of each job.
    pub fn sealed(&self, from: Instant, to: Instant) -> Vec<Sealed> {
        self.sealed.iter().filter(|s| (from..to).contains(&s.at)).copied().collect()
    }
}

/// a − b, s.
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
    fn what_is_neither_waiting_for_a_busy_slot_nor_evaluating_is_overhead() {
        let clock = Clock(Instant::now());
        let mut chains = Chains::default();
        chains.seal(1, 0, clock.at(1000));
        // Idle slots: 5 ms until it begins, 7 until it is sealed.
        chains.done(1, 1, clock.spell(900, 1005, 2000));
        chains.done(1, 1, clock.spell(900, 1004, 3005));
        chains.seal(1, 1, clock.at(3012));
        // A slot that had other work until 4000: 2 ms until it begins, 3 until it is sealed.
        chains.done(1, 2, clock.spell(4000, 4002, 5002));
        chains.seal(1, 2, clock.at(5005));
        assert_eq!(overheads(&chains, &clock), [11.0, 5.0]);
        let took: Vec<f64> = chains.sealed(clock.at(0), clock.at(9000)).iter().map(|s| s.took).collect();
        assert!((took[0] - 2.012).abs() < 1e-9 && (took[1] - 1.993).abs() < 1e-9, "{took:?}");
    }

    #[test]
    fn what_died_and_is_done_again_is_overhead_and_a_late_copy_is_nothing() {
        let clock = Clock(Instant::now());
        let mut chains = Chains::default();
        chains.seal(1, 0, clock.at(0));
        // Its first worker died; given to one that had been idle all the time, at 5000.
        chains.done(1, 1, clock.spell(0, 5000, 6000));
        chains.seal(1, 1, clock.at(6000));
        chains.done(1, 1, clock.spell(0, 5000, 7000));
        chains.done(1, 2, clock.spell(6000, 6000, 8000));
        chains.seal(1, 2, clock.at(8000));
        assert_eq!(overheads(&chains, &clock), [5000.0, 0.0]);
        assert_eq!(chains.last.len(), 0, "nothing is kept of what is over");
    }

    #[test]
    fn jobs_are_told_apart_and_the_first_seal_is_only_a_begin() {
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
