//! How many candidates go into a range. Only speed depends on it, never a result.

/// A range should take at least this long, s: below, the round trip costs more than the work.
const LEAST: f64 = 0.02;
/// A range should take at most this long, s: beyond, losing a worker costs too much and other jobs wait too long for a slot.
const MOST: f64 = 5.0;
/// A slot gets a second range in advance only while ranges are shorter than this, s: what waits behind a long range
/// might have gone to a slot that falls idle.
const PREFETCH_BELOW: f64 = 1.0;

/// The size of the next range of `pending` candidates for `slots` slots. `cost` is the measured time of an evaluation in
/// s, `most` the hard limit.
///
/// Guided self-scheduling: a fixed share of what is left, so ranges get smaller towards the end of a generation and all
/// slots end at about the same time. About three ranges a slot while nothing is measured, two afterwards.
pub(super) fn range_size(pending: u32, slots: u32, cost: Option<f64>, most: u32) -> u32 {
    let share = |ranges_a_slot: u32| pending.div_ceil((slots * ranges_a_slot).max(1));
    let size = match cost {
        None => pending / (slots * 3).max(1),
        Some(cost) => {
            let cost = cost.max(1e-6);
            let least = (LEAST / cost).ceil().min(f64::from(u32::MAX)) as u32;
            let longest = (MOST / cost).floor().min(f64::from(u32::MAX)) as u32;
            share(2).min(longest).max(least)
        }
    };
    size.clamp(1, most.max(1))
}

/// Whether a busy slot may get a range of this size in advance.
pub(super) fn may_prefetch(size: u32, cost: Option<f64>) -> bool {
    cost.is_some_and(|cost| cost * f64::from(size) < PREFETCH_BELOW)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twenty_candidates_on_two_slots_start_as_two_to_three_ranges_a_slot() {
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
    fn ranges_shrink_towards_the_end_and_never_vanish() {
        let sizes: Vec<u32> = (1..=100).map(|left| range_size(left, 8, Some(1.0), 1000)).collect();
        assert!(sizes.windows(2).all(|w| w[0] <= w[1]) && sizes[0] == 1, "{sizes:?}");
    }

    #[test]
    fn fast_evaluations_come_in_large_ranges_slow_ones_alone() {
        assert_eq!(range_size(20, 1000, Some(0.001), 1000), 20);
        assert_eq!(range_size(10_000, 1, Some(60.0), 1000), 1);
        assert_eq!(range_size(10_000, 1, Some(1e-9), 64), 64);
        assert!(may_prefetch(10, Some(0.01)) && !may_prefetch(1, Some(5.0)) && !may_prefetch(1, None));
    }
}
