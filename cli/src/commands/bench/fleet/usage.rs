//! Busy time of slots: an integral over all slots, exact at any time, and the part of it that does not count.

use std::time::{Duration, Instant};

/// Slot time so far.
#[derive(Debug)]
pub struct Usage {
    busy: u32,
    since: Instant,
    /// Busy time of all slots, up to `since`.
    spent: Duration,
    /// Busy time beyond the drawn times (the machine woke a task too late), and of evaluations that were lost.
    wasted: Duration,
}

impl Usage {
    /// Creates the integral with no slot busy.
    pub fn new(now: Instant) -> Self {
        Self { busy: 0, since: now, spent: Duration::ZERO, wasted: Duration::ZERO }
    }

    /// Records that a slot begins.
    pub fn begin(&mut self, now: Instant) {
        self.advance(now);
        self.busy += 1;
    }

    /// Records that a slot ends. `wasted` of its time did not count.
    pub fn end(&mut self, now: Instant, wasted: Duration) {
        self.advance(now);
        self.busy -= 1;
        self.wasted += wasted;
    }

    /// Returns the slot time that counted so far, s. Running evaluations count until they turn out to be wasted.
    pub fn useful(&mut self, now: Instant) -> f64 {
        self.advance(now);
        self.spent.as_secs_f64() - self.wasted.as_secs_f64()
    }

    fn advance(&mut self, now: Instant) {
        let now = now.max(self.since);
        self.spent += (now - self.since) * self.busy;
        self.since = now;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn useful_slot_time_includes_running_evaluations() {
        let begun = Instant::now();
        let at = |ms: u64| begun + Duration::from_millis(ms);
        let mut usage = Usage::new(begun);
        usage.begin(at(1000));
        usage.begin(at(2000));
        assert_eq!(usage.useful(at(2500)), 2.0);
        usage.end(at(3000), Duration::ZERO);
        assert_eq!(usage.useful(at(4000)), 4.0);
        // The drawn time was 2.9 s: the 0.1 s beyond it does not count.
        usage.end(at(5000), Duration::from_millis(100));
        assert_eq!(usage.useful(at(9000)), 4.9);
    }

    #[test]
    fn time_of_lost_evaluation_is_subtracted() {
        let begun = Instant::now();
        let at = |s: u64| begun + Duration::from_secs(s);
        let mut usage = Usage::new(begun);
        usage.begin(at(0));
        assert_eq!(usage.useful(at(3)), 3.0);
        usage.end(at(4), Duration::from_secs(4));
        assert_eq!(usage.useful(at(5)), 0.0);
    }

    #[test]
    fn out_of_order_begin_times_lose_no_slot_time() {
        let begun = Instant::now();
        let mut usage = Usage::new(begun);
        usage.begin(begun + Duration::from_secs(2));
        usage.begin(begun + Duration::from_secs(1));
        assert_eq!(usage.useful(begun + Duration::from_secs(3)), 2.0);
    }
}
