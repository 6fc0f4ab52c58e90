//! Delays between attempts.

use std::hash::{BuildHasher as _, RandomState};
use std::time::Duration;

const FIRST: Duration = Duration::from_millis(100);
const MOST: Duration = Duration::from_secs(5);

/// Waits between tries to reach a coordinator: from 0.05 s on, twice as long each time up to 5 s, with jitter, so that a
/// thousand workers do not knock at a restarted coordinator in the same moment.
#[derive(Clone, Debug)]
pub struct Backoff {
    next: Duration,
    random: RandomState,
    tries: u64,
}

impl Default for Backoff {
    fn default() -> Self {
        Self::new()
    }
}

impl Backoff {
    /// A backoff before the first attempt.
    pub fn new() -> Self {
        Self { next: FIRST, random: RandomState::new(), tries: 0 }
    }

    /// It worked: the next failure starts over.
    pub fn reset(&mut self) {
        self.next = FIRST;
    }

    /// The next wait: half of it for sure, half by chance.
    pub fn next_wait(&mut self) -> Duration {
        self.tries += 1;
        let share = self.random.hash_one(self.tries) as f64 / u64::MAX as f64;
        let wait = self.next.mul_f64(0.5 + 0.5 * share);
        self.next = (self.next * 2).min(MOST);
        wait
    }

    /// Waits for the next attempt.
    pub async fn wait(&mut self) {
        tokio::time::sleep(self.next_wait()).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_double_up_to_a_bound_and_start_over() {
        let mut backoff = Backoff::new();
        let mut full = FIRST;
        for _ in 0..20 {
            let wait = backoff.next_wait();
            assert!(wait >= full / 2 && wait <= full, "{wait:?} of {full:?}");
            full = (full * 2).min(MOST);
        }
        assert_eq!(full, MOST);
        backoff.reset();
        assert!(backoff.next_wait() <= FIRST);
    }
}
