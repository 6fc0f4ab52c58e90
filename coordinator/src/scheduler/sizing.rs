//! Number of tasks in a range. It changes only the speed, never a result.

/// Shortest time that a range should take, s. Below it, the round trip costs more than the work.
const LEAST: f64 = 0.02;
/// Longest time that a range should take, s. Above it, the loss of a worker costs too much, and other jobs wait too
/// long for a slot.
const MOST: f64 = 5.0;
/// Longest range, s, for which a slot gets a second range in advance. Behind a longer range, the second one might start
/// sooner on another slot.
const PREFETCH_BELOW: f64 = 1.0;

/// Inputs for the size of a range.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cut {
    /// Number of tasks of the round.
    pub all: u32,
    /// Number of pending tasks.
    pub pending: u32,
    /// Number of slots that may run them.
    pub slots: u32,
    /// Measured time of a task, s.
    pub cost: Option<f64>,
    /// Number of tasks that take as long together as one alone.
    pub at_once: u32,
    /// Largest allowed size of a range.
    pub most: u32,
}

/// Returns the size of the next range.
///
/// Uses guided self-scheduling: a fixed share of the remaining tasks. So ranges get smaller towards the end of a round,
/// and all slots end at about the same time. About three ranges per slot before the first measurement, two afterwards.
///
/// An engine that simulates several tasks at once (lanes) gets all of a slot's tasks in one range, and at least enough
/// tasks to fill its lanes.
pub(super) fn range_size(cut: Cut) -> u32 {
    let Cut { all, pending, slots, cost, at_once, most } = cut;
    let share = |ranges_a_slot: u32| pending.div_ceil((slots * ranges_a_slot).max(1));
    let cost = cost.map(|cost| cost.max(1e-6));
    let size = match cost {
        _ if at_once > 1 => {
            let share = all.div_ceil(slots.max(1)).max(at_once);
            cost.map_or(share, |cost| share.min(at_most(cost)))
        }
        None => pending / (slots * 3).max(1),
        Some(cost) => {
            let least = (LEAST / cost).ceil().min(f64::from(u32::MAX)) as u32;
            share(2).min(at_most(cost)).max(least)
        }
    };
    size.clamp(1, most.max(1))
}

/// Returns the number of tasks of this cost, s, that fit into the longest range.
fn at_most(cost: f64) -> u32 {
    (MOST / cost).floor().min(f64::from(u32::MAX)) as u32
}

/// Returns the largest size of a range, without regard to a slot's share; one task before the first measurement.
pub(super) fn longest(cost: Option<f64>) -> u32 {
    cost.map_or(1, |cost| at_most(cost.max(1e-6)).max(1))
}

/// Returns true if a busy slot may get a range of this size in advance.
pub(super) fn may_prefetch(size: u32, cost: Option<f64>) -> bool {
    cost.is_some_and(|cost| cost * f64::from(size) < PREFETCH_BELOW)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range_size(pending: u32, slots: u32, cost: Option<f64>, most: u32) -> u32 {
        super::range_size(Cut { all: pending, pending, slots, cost, at_once: 1, most })
    }

    #[test]
    fn lanes_engine_gets_one_range_per_slot() {
        let sizes = |all: u32, slots: u32, cost: Option<f64>| {
            let (mut pending, mut sizes) = (all, Vec::new());
            while pending > 0 {
                let size = super::range_size(Cut { all, pending, slots, cost, at_once: 5, most: 1000 }).min(pending);
                sizes.push(size);
                pending -= size;
            }
            sizes
        };
        assert_eq!(sizes(20, 2, None), [10, 10]);
        assert_eq!(sizes(20, 2, Some(0.02)), [10, 10]);
        assert_eq!(sizes(20, 3, Some(0.02)), [7, 7, 6]);
        // One task alone would take as long as five.
        assert_eq!(sizes(20, 100, Some(0.02)), [5, 5, 5, 5]);
        // A range still takes only a few seconds.
        assert_eq!(sizes(20, 1, Some(1.0)), [5, 5, 5, 5]);
        assert_eq!(sizes(3, 1, Some(100.0)), [1, 1, 1]);
    }

    #[test]
    fn unmeasured_round_gets_about_three_ranges_per_slot() {
        let mut left = 20;
        let mut ranges = 0;
        while left > 0 {
            left -= range_size(left, 2, None, 1000).min(left);
            ranges += 1;
        }
        assert_eq!(range_size(20, 2, None, 1000), 3);
        assert!(ranges >= 4, "{ranges}");
    }

    #[test]
    fn range_size_shrinks_to_one_at_round_end() {
        let sizes: Vec<u32> = (1..=100).map(|left| range_size(left, 8, Some(1.0), 1000)).collect();
        assert!(sizes.windows(2).all(|w| w[0] <= w[1]) && sizes[0] == 1, "{sizes:?}");
    }

    #[test]
    fn fast_tasks_get_large_ranges_slow_ones_single() {
        assert_eq!(range_size(20, 1000, Some(0.001), 1000), 20);
        assert_eq!(range_size(10_000, 1, Some(60.0), 1000), 1);
        assert_eq!(range_size(10_000, 1, Some(1e-9), 64), 64);
        assert!(may_prefetch(10, Some(0.01)) && !may_prefetch(1, Some(5.0)) && !may_prefetch(1, None));
    }
}
