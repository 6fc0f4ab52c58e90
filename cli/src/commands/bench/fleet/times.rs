//! How long evaluations and workers last. All of it is drawn, and follows from seeds alone: whoever evaluates a candidate,
//! whenever and however often, takes the same time for it.

use sim_core::base::random::{Purpose, Stream};
use std::time::Duration;

/// Log-normal times of evaluations: rapier's spread so, since some robots fall over early and others rub all the way.
#[derive(Clone, Copy, Debug)]
pub struct Times {
    /// s; 0: none takes any.
    pub median: f64,
    /// Standard deviation of the logarithm.
    pub sigma: f64,
}

impl Times {
    /// That of a candidate of the job with this seed.
    pub fn of(&self, seed: u64, generation: u32, candidate: u32) -> Duration {
        let z = Stream::new(seed, Purpose::Sample, generation, candidate, 0).normal();
        Duration::from_secs_f64(self.median * (self.sigma * z).exp())
    }

    /// That of a range: its candidates are evaluated one after the other.
    pub fn of_range(&self, seed: u64, generation: u32, first: u32, count: u32) -> Duration {
        (first..first + count).map(|candidate| self.of(seed, generation, candidate)).sum()
    }
}

/// How long a worker lives in one of its lives: exponential, so that its age says nothing about its death.
pub fn lifetime(mean: Duration, seed: u64, worker: u32, life: u32) -> Duration {
    let survives = 1.0 - Stream::new(seed, Purpose::Sample, worker, life, 1).unit();
    mean.mul_f64(-survives.ln())
}

#[cfg(test)]
mod tests {
    use super::*;
    use sim_core::base::statistics::median;

    #[test]
    fn times_are_log_normal_and_the_same_for_whoever_asks() {
        let times = Times { median: 2.0, sigma: 0.5 };
        let drawn: Vec<f64> = (0..20_000).map(|i| times.of(7, i / 20, i % 20).as_secs_f64()).collect();
        assert!((median(&drawn).unwrap() - 2.0).abs() < 0.03);
        let mean = drawn.iter().sum::<f64>() / drawn.len() as f64;
        assert!((mean - 2.0 * (0.125f64).exp()).abs() < 0.04, "{mean}");
        assert_eq!(times.of(7, 3, 4), times.of(7, 3, 4));
        assert_ne!(times.of(7, 3, 4), times.of(8, 3, 4));
        let singly: Duration = (2..5).map(|candidate| times.of(7, 3, candidate)).sum();
        assert_eq!(times.of_range(7, 3, 2, 3), singly);
    }

    #[test]
    fn a_spread_of_nothing_and_a_median_of_nothing_are_what_they_say() {
        assert_eq!(Times { median: 1.5, sigma: 0.0 }.of(1, 2, 3), Duration::from_millis(1500));
        assert_eq!(Times { median: 0.0, sigma: 2.0 }.of(1, 2, 3), Duration::ZERO);
    }

    #[test]
    fn lives_last_as_long_as_said_on_the_average() {
        let mean = Duration::from_secs(100);
        let total: f64 = (0..20_000).map(|i| lifetime(mean, 1, i % 100, i / 100).as_secs_f64()).sum();
        assert!((total / 20_000.0 - 100.0).abs() < 2.0, "{total}");
    }
}
