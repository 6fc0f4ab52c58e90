//! Delays between attempts.

use std::hash::{BuildHasher as _, RandomState};
use std::time::Duration;

const FIRST: Duration = Duration::from_millis(100);
const MOST: Duration = Duration::from_secs(5);

/// Exponential backoff between attempts to reach a coordinator. The bound of a wait doubles from 0.1 s up to 5 s, and
/// the wait is random between half the bound and the bound, so that many workers do not reconnect to a restarted
/// coordinator at the same time.
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
    /// Creates a backoff that starts with the shortest wait.
    pub fn new() -> Self {
        Self { next: FIRST, random: RandomState::new(), tries: 0 }
    }

    /// Resets the wait to the shortest, after a success.
    pub fn reset(&mut self) {
        self.next = FIRST;
    }

    /// Returns the next wait, random between half the current bound and the bound.
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
    fn waits_double_up_to_maximum_and_reset() {
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
