//! Streams of random numbers, one for each random decision.
//!
//! The key of a stream is (seed, purpose, generation, candidate, repeat). Nothing depends on time, threads, workers or
//! the order in which results arrive. Sampling from the raw words is part of this crate, so a release of a
//! random-number crate can't change results.

use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use sha2::{Digest, Sha256};

/// Purpose of a stream of random numbers. The numbers below are part of every result's identity: never reuse one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Purpose {
    /// Initial positions of an optimiser's candidates.
    InitialPosition = 1,
    /// Initial velocities of a swarm.
    InitialVelocity = 2,
    /// Random factors r₁ and r₂ of Eq. 1.
    SwarmUpdate = 3,
    /// Selection, crossover and mutation of a genetic algorithm.
    Breeding = 4,
    /// Random configurations q_rand of the planner in an evaluation of the search.
    Planner = 5,
    /// Random configurations q_rand of the planner when a finished job's candidates are scored again.
    Rescore = 6,
    /// Gaits drawn for tests and benchmarks.
    Sample = 7,
    /// Resamples of a bootstrap interval.
    Bootstrap = 8,
    /// Random configurations q_rand of the planner when the finish scores candidates on the reference setting.
    Reference = 9,
    /// Random configurations q_rand of the planner in a job that plans with given gaits.
    Plan = 10,
    /// Variations in a repeat of a simulated motion, such as friction and start; each quantity has its own stream.
    Vary = 11,
    /// Random configurations q_rand of the planner when a simulated plan is replanned.
    Replan = 12,
    /// Choice of the individuals that survive a generation of a genetic algorithm.
    Selection = 13,
    /// Random configurations of modules.
    Configuration = 16,
}

/// Stream of random numbers for one decision.
#[derive(Clone, Debug)]
pub struct Stream(ChaCha12Rng);

impl Stream {
    /// Returns the stream of one decision. `repeat` distinguishes several trees of one candidate.
    pub fn new(seed: u64, purpose: Purpose, generation: u32, candidate: u32, repeat: u32) -> Self {
        let mut key = Sha256::new();
        key.update(b"evogait stream 1");
        key.update(seed.to_le_bytes());
        key.update([purpose as u8]);
        key.update(generation.to_le_bytes());
        key.update(candidate.to_le_bytes());
        key.update(repeat.to_le_bytes());
        Self(ChaCha12Rng::from_seed(key.finalize().into()))
    }

    /// Returns a number uniform in [0, 1): the top 53 bits of a word.
    pub fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Returns a number uniform in [low, high).
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Returns a standard normal number, by Box–Muller. Only one of the pair is used, so that every draw takes the same
    /// number of words.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * libm::log(1.0 - self.unit())).sqrt();
        radius * libm::cos(2.0 * std::f64::consts::PI * self.unit())
    }

    /// Returns a whole number uniform in 0..n, without bias (Lemire's multiply and reject). `n` must not be 0.
    pub fn below(&mut self, n: u32) -> u32 {
        assert!(n > 0, "below(n) needs n > 0");
        let threshold = n.wrapping_neg() % n;
        loop {
            let product = u64::from(self.0.next_u32()) * u64::from(n);
            if product as u32 >= threshold {
                return (product >> 32) as u32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stream_depends_on_each_part_of_key() {
        let first = |mut s: Stream| s.unit().to_bits();
        let base = first(Stream::new(1, Purpose::Planner, 2, 3, 4));
        assert_eq!(base, first(Stream::new(1, Purpose::Planner, 2, 3, 4)));
        for other in [
            Stream::new(2, Purpose::Planner, 2, 3, 4),
            Stream::new(1, Purpose::Rescore, 2, 3, 4),
            Stream::new(1, Purpose::Planner, 3, 3, 4),
            Stream::new(1, Purpose::Planner, 2, 4, 4),
            Stream::new(1, Purpose::Planner, 2, 3, 5),
        ] {
            assert_ne!(base, first(other));
        }
    }

    #[test]
    fn samples_have_the_moments_of_their_distribution() {
        let mut s = Stream::new(7, Purpose::Sample, 0, 0, 0);
        let n = 100_000;
        let (mut mean_u, mut mean_n, mut var_n) = (0.0, 0.0, 0.0);
        let mut counts = [0u32; 7];
        for _ in 0..n {
            mean_u += s.uniform(2.0, 4.0) / f64::from(n);
            let z = s.normal();
            mean_n += z / f64::from(n);
            var_n += z * z / f64::from(n);
            counts[s.below(7) as usize] += 1;
        }
        assert!((mean_u - 3.0).abs() < 0.01);
        assert!(mean_n.abs() < 0.015 && (var_n - 1.0).abs() < 0.02);
        assert!(counts.iter().all(|c| c.abs_diff(n / 7) < 600));
    }
}
