//! Detection of stuck slots: those that finish no batch of rollouts for a given time.

use std::collections::BTreeMap;
use std::time::Duration;

/// Number of checks without progress after which a slot is stuck.
pub(crate) const LOOKS: u32 = 10;

/// Detector of stuck slots. It counts checks instead of seconds, so that slots are not stuck when the process continues
/// after an hour of suspension.
#[derive(Debug, Default)]
pub(crate) struct Watchdog {
    /// Per assignment: its progress, and the number of checks since it last changed.
    seen: BTreeMap<u64, (u64, u32)>,
}

impl Watchdog {
    /// Returns the time between two checks that finds a slot without progress for `stuck_after`.
    pub fn period(stuck_after: Duration) -> Duration {
        stuck_after / LOOKS
    }

    /// Checks the progress of all computing assignments, given as (assignment, progress); returns the stuck ones.
    pub fn look(&mut self, computing: impl IntoIterator<Item = (u64, u64)>) -> Vec<u64> {
        let mut now = BTreeMap::new();
        for (id, progress) in computing {
            let looks = match self.seen.get(&id) {
                Some((before, looks)) if *before == progress => looks + 1,
                _ => 0,
            };
            now.insert(id, (progress, looks));
        }
        self.seen = now;
        self.seen.iter().filter(|(_, (_, looks))| *looks >= LOOKS).map(|(id, _)| *id).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_work_without_progress_is_stuck() {
        const NONE: [u64; 0] = [];
        let mut watchdog = Watchdog::default();
        for look in 0..LOOKS {
            let slow = u64::from(look / (LOOKS - 1));
            assert_eq!(watchdog.look([(1, 5), (2, u64::from(look)), (3, slow)]), NONE);
        }
        assert_eq!(watchdog.look([(1, 5), (2, 100), (3, 1)]), [1]);
        // The count restarts for an id that was absent from a check.
        assert_eq!(watchdog.look([(2, 101)]), NONE);
        assert_eq!(watchdog.look([(1, 5), (2, 102)]), NONE);
    }
}
