//! Robots, controllers, rollouts, planner, fitness and optimisers of evogait.
//!
//! Pure computation: no I/O, no clock, no threads of its own, no global random numbers. The same input gives the same
//! bits on every machine. Lengths are in map units (mu, one module length), times in s, angles in rad, masses in kg.

pub mod catalogue;
pub mod control;
pub mod encoding;
pub mod environment;
pub mod error;
pub mod evaluate;
pub mod finish;
pub mod fitness;
pub mod identity;
pub mod job;
pub mod limits;
pub mod lockstep;
pub mod math;
pub mod measure;
pub mod optimise;
pub mod plan;
pub mod procedure;
pub mod random;
pub mod report;
pub mod robot;
pub mod rollout;
pub mod score;
mod simd;
pub mod toml_file;

pub use rollout::engine_digests;
