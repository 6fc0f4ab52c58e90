//! Rate limiter for log lines that unauthenticated peers can cause.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Shortest time between two log lines.
const PAUSE: Duration = Duration::from_secs(1);

/// Rate limiter: at most one log line per second.
#[derive(Debug, Default)]
pub(crate) struct LogLimit(Mutex<(Option<Instant>, u64)>);

impl LogLimit {
    /// Returns the number of suppressed log lines since the last one, or `None` if this line must be suppressed, too.
    pub fn now(&self) -> Option<u64> {
        self.at(Instant::now())
    }

    fn at(&self, now: Instant) -> Option<u64> {
        let mut state = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if state.0.is_some_and(|last| now < last + PAUSE) {
            state.1 += 1;
            return None;
        }
        state.0 = Some(now);
        Some(std::mem::take(&mut state.1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn suppressed_log_lines_are_counted() {
        let (limit, start) = (LogLimit::default(), Instant::now());
        assert_eq!(limit.at(start), Some(0));
        assert_eq!(limit.at(start), None);
        assert_eq!(limit.at(start + PAUSE / 2), None);
        assert_eq!(limit.at(start + PAUSE), Some(2));
        assert_eq!(limit.at(start + 3 * PAUSE), Some(0));
    }
}
