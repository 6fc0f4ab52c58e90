//! How long to wait before trying again: twice as long each time, with jitter, so that a thousand workers do not knock
//! at a restarted coordinator in the same moment.

use std::hash::{BuildHasher as _, RandomState};
use std::time::Duration;

const FIRST: Duration = Duration::from_millis(100);
const MOST: Duration = Duration::from_secs(5);

#[derive(Clone, Debug)]
pub(crate) struct Backoff {
    next: Duration,
    random: RandomState,
    tries: u64,
}

impl Backoff {
    pub fn new() -> Self {
        Self { next: FIRST, random: RandomState::new(), tries: 0 }
    }

    /// It worked: the next failure starts over.
    pub fn reset(&mut self) {
        self.next = FIRST;
    }

    /// The next wait: half of it for sure, half by chance.
    pub fn next(&mut self) -> Duration {
        self.tries += 1;
        let share = self.random.hash_one(self.tries) as f64 / u64::MAX as f64;
        let wait = self.next.mul_f64(0.5 + 0.5 * share);
        self.next = (self.next * 2).min(MOST);
        wait
    }

    pub async fn wait(&mut self) {
        tokio::time::sleep(self.next()).await;
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
            let wait = backoff.next();
            assert!(wait >= full / 2 && wait <= full, "{wait:?} of {full:?}");
            full = (full * 2).min(MOST);
        }
        assert_eq!(full, MOST);
        backoff.reset();
        assert!(backoff.next() <= FIRST);
    }
}
