//! Times of evaluations and lifetimes of workers. They are drawn and depend on seeds alone: the evaluation of a
//! candidate takes the same time on every worker and in every repetition.

use sim_core::base::random::{Purpose, Stream};
use std::time::Duration;

/// Log-normal times of evaluations. Rapier's times have this spread, since some robots fall over early and others slide
/// all the time.
#[derive(Clone, Copy, Debug)]
pub struct Times {
    /// Median, s; with 0 evaluations take no time.
    pub median: f64,
    /// Standard deviation of the logarithm.
    pub sigma: f64,
}

impl Times {
    /// Returns the time of a candidate of the job with this seed.
    pub fn of(&self, seed: u64, generation: u32, candidate: u32) -> Duration {
        let z = Stream::new(seed, Purpose::Sample, generation, candidate, 0).normal();
        Duration::from_secs_f64(self.median * (self.sigma * z).exp())
    }

    /// Returns the time of a range. Its candidates are evaluated one after the other.
    pub fn of_range(&self, seed: u64, generation: u32, first: u32, count: u32) -> Duration {
        (first..first + count).map(|candidate| self.of(seed, generation, candidate)).sum()
    }
}

/// Returns the lifetime of a worker in one of its lives: exponential, so the probability of a crash does not depend on
/// its age.
pub fn lifetime(mean: Duration, seed: u64, worker: u32, life: u32) -> Duration {
    let survives = 1.0 - Stream::new(seed, Purpose::Sample, worker, life, 1).unit();
    mean.mul_f64(-survives.ln())
}

#[cfg(test)]
mod tests {
    use super::*;
    use sim_core::base::statistics::median;

    #[test]
    fn times_are_log_normal_and_depend_on_seed_only() {
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
    fn zero_sigma_gives_median_and_zero_median_gives_zero() {
        assert_eq!(Times { median: 1.5, sigma: 0.0 }.of(1, 2, 3), Duration::from_millis(1500));
        assert_eq!(Times { median: 0.0, sigma: 2.0 }.of(1, 2, 3), Duration::ZERO);
    }

    #[test]
    fn lifetimes_have_the_given_mean() {
        let mean = Duration::from_secs(100);
        let total: f64 = (0..20_000).map(|i| lifetime(mean, 1, i % 100, i / 100).as_secs_f64()).sum();
        assert!((total / 20_000.0 - 100.0).abs() < 2.0, "{total}");
    }
}
