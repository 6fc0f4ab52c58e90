//! Ideal efficiency: the same drawn times on the same slots, with tasks assigned at no cost to workers that never
//! crash.
//!
//! It is a list schedule with the rules of the coordinator: a free slot never waits while a job has a pending task; the
//! job with the least slot time so far is next; a generation begins when the previous one is complete.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};
use std::ops::Range;
use std::time::Duration;

/// Size of a schedule.
#[derive(Clone, Copy, Debug)]
pub struct FleetSize {
    /// Slots of all workers together.
    pub slots: u64,
    /// Number of jobs, all of one size.
    pub jobs: u32,
    /// Candidates of each generation.
    pub population: u32,
}

impl FleetSize {
    /// Returns the share of the slots that are busy while all jobs are at the beginning of a generation.
    pub fn fill(&self) -> f64 {
        let candidates = f64::from(self.jobs) * f64::from(self.population);
        (candidates / self.slots as f64).min(1.0)
    }
}

#[derive(Clone, Copy, Default)]
struct Job {
    generation: u32,
    /// Candidates of the generation that are assigned, and that are done.
    handed: u32,
    done: u32,
    /// Slot time of the job so far.
    given: Duration,
}

/// Returns the busy share of the slots' time in a window, if all jobs begin at time 0.
/// `time(job, generation, candidate)` is the time of an evaluation and must be more than zero.
pub fn efficiency(setting: FleetSize, window: Range<Duration>, time: impl Fn(u32, u32, u32) -> Duration) -> f64 {
    let FleetSize { slots, jobs, population } = setting;
    let mut all = vec![Job::default(); jobs as usize];
    let mut waiting: BTreeSet<(Duration, u32)> = (0..jobs).map(|job| (Duration::ZERO, job)).collect();
    let mut running: BinaryHeap<Reverse<(Duration, u32)>> = BinaryHeap::new();
    let (mut now, mut busy) = (Duration::ZERO, Duration::ZERO);
    while now < window.end {
        while (running.len() as u64) < slots
            && let Some((_, number)) = waiting.pop_first()
        {
            let job = &mut all[number as usize];
            let takes = time(number, job.generation, job.handed);
            (job.handed, job.given) = (job.handed + 1, job.given + takes);
            if job.handed < population {
                waiting.insert((job.given, number));
            }
            busy += (now + takes).min(window.end).saturating_sub(now.max(window.start));
            running.push(Reverse((now + takes, number)));
        }
        let Some(Reverse((at, number))) = running.pop() else { break };
        now = at;
        let job = &mut all[number as usize];
        job.done += 1;
        if job.done == population {
            *job = Job { generation: job.generation + 1, given: job.given, ..Job::default() };
            waiting.insert((job.given, number));
        }
    }
    busy.as_secs_f64() / ((window.end - window.start).as_secs_f64() * slots as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn s(seconds: u64) -> Duration {
        Duration::from_secs(seconds)
    }

    fn of(slots: u64, jobs: u32, population: u32, time: impl Fn(u32, u32, u32) -> Duration) -> f64 {
        efficiency(FleetSize { slots, jobs, population }, s(100)..s(1100), time)
    }

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-9
    }

    #[test]
    fn equal_times_fill_one_slot_per_candidate() {
        for (slots, jobs, population, share) in
            [(40, 1, 20, 0.5), (20, 1, 20, 1.0), (10, 1, 20, 1.0), (1000, 20, 20, 0.4)]
        {
            assert!(near(of(slots, jobs, population, |_, _, _| s(1)), share), "{slots} {jobs} {population}");
            assert!(near(FleetSize { slots, jobs, population }.fill(), share));
        }
        // Twelve slots need two turns for twenty candidates.
        assert!(near(of(12, 1, 20, |_, _, _| s(1)), 20.0 / 24.0));
    }

    #[test]
    fn other_jobs_fill_slots_that_wait_for_slowest_candidate() {
        let slow_last = |_, _, candidate| if candidate == 3 { s(4) } else { s(1) };
        // One job alone: seven seconds of evaluations in four times four seconds of slots.
        assert!(near(of(4, 1, 4, slow_last), 7.0 / 16.0));
        // Eight such jobs keep the slots busy all the time.
        assert!(of(4, 8, 4, slow_last) > 0.999);
    }

    #[test]
    fn efficiency_grows_with_jobs_and_stays_below_one() {
        let times = super::super::times::Times { median: 1.0, sigma: 0.5 };
        let shares: Vec<f64> =
            [1, 2, 5, 10, 20].map(|jobs| of(100, jobs, 20, |j, g, c| times.of(u64::from(j), g, c))).to_vec();
        assert!(
            shares.windows(2).all(|w| w[0] < w[1] + 1e-3) && shares.iter().all(|s| (0.0..=1.0).contains(s)),
            "{shares:?}"
        );
        // The mean of twenty times divided by their maximum, over the slots that the job can use.
        assert!((0.35..0.55).contains(&(shares[0] * 5.0)), "{shares:?}");
        assert!(shares[4] > 0.99, "{shares:?}");
    }

    #[test]
    fn no_jobs_give_zero_efficiency() {
        assert_eq!(of(10, 0, 20, |_, _, _| s(1)), 0.0);
    }
}
