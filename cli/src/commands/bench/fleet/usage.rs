//! How long slots were busy: an integral over all of them, exact at any moment, and what of it did not count.

use std::time::{Duration, Instant};

/// Slot time so far.
#[derive(Debug)]
pub struct Usage {
    busy: u32,
    since: Instant,
    /// Of all slots, up to `since`.
    spent: Duration,
    /// Beyond what was drawn (a machine that wakes too late), or for what came to nothing.
    wasted: Duration,
}

impl Usage {
    /// Nobody is busy.
    pub fn new(now: Instant) -> Self {
        Self { busy: 0, since: now, spent: Duration::ZERO, wasted: Duration::ZERO }
    }

    /// A slot begins.
    pub fn begin(&mut self, now: Instant) {
        self.advance(now);
        self.busy += 1;
    }

    /// A slot ends, after a time of which so much did not count.
    pub fn end(&mut self, now: Instant, wasted: Duration) {
        self.advance(now);
        self.busy -= 1;
        self.wasted += wasted;
    }

    /// s of slot time that counted so far. What runs counts until it turns out not to.
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
    fn slot_time_is_the_sum_over_slots_cut_where_it_is_read() {
        let begun = Instant::now();
        let at = |ms: u64| begun + Duration::from_millis(ms);
        let mut usage = Usage::new(begun);
        usage.begin(at(1000));
        usage.begin(at(2000));
        assert_eq!(usage.useful(at(2500)), 2.0);
        usage.end(at(3000), Duration::ZERO);
        assert_eq!(usage.useful(at(4000)), 4.0);
        // It was told to take 2.9 s: what it took more is not the fleet's merit.
        usage.end(at(5000), Duration::from_millis(100));
        assert_eq!(usage.useful(at(9000)), 4.9);
    }

    #[test]
    fn what_came_to_nothing_is_taken_back() {
        let begun = Instant::now();
        let at = |s: u64| begun + Duration::from_secs(s);
        let mut usage = Usage::new(begun);
        usage.begin(at(0));
        assert_eq!(usage.useful(at(3)), 3.0);
        usage.end(at(4), Duration::from_secs(4));
        assert_eq!(usage.useful(at(5)), 0.0);
    }

    #[test]
    fn threads_that_tell_of_moments_out_of_order_lose_nothing() {
        let begun = Instant::now();
        let mut usage = Usage::new(begun);
        usage.begin(begun + Duration::from_secs(2));
        usage.begin(begun + Duration::from_secs(1));
        assert_eq!(usage.useful(begun + Duration::from_secs(3)), 2.0);
    }
}
