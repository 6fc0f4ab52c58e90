//! A job: one optimisation, from its file to everything an evaluation needs.

mod spec;

pub use spec::*;

use crate::environment::Environment;
use crate::error::Invalid;
use crate::identity::Digest;
use crate::optimise::{Bounds, Optimiser};
use crate::robot::RobotSpec;
use crate::score::Direction;

/// A resolved, validated job with its robot compiled.
#[derive(Clone, Debug)]
pub struct Job {
    spec: JobSpec,
}

impl Job {
    /// Reads a self-contained job: one whose robot and environment are written out or ship with evogait.
    /// Settings that are not given get their defaults, so that [`Job::to_toml`] tells all of them.
    pub fn from_toml(_text: &str) -> Result<Job, Invalid> {
        todo!()
    }

    /// Resolves and validates a job whose robot and environment are written out or ship with evogait.
    pub fn new(_spec: JobSpec) -> Result<Job, Invalid> {
        todo!()
    }

    /// The resolved job as a file: self-contained, every setting written out. `Job::from_toml(job.to_toml())` gives a
    /// job with the same digest.
    pub fn to_toml(&self) -> String {
        todo!()
    }

    /// The job digest: resolved job, robot, environment, optimiser and engine; not the name or description.
    pub fn digest(&self) -> Digest {
        todo!()
    }

    /// The digest of the engine that the job runs on, as this build has it. A worker must offer the same.
    pub fn engine_digest(&self) -> Digest {
        todo!()
    }

    /// The resolved job as written.
    pub fn spec(&self) -> &JobSpec {
        &self.spec
    }

    /// The resolved robot file.
    pub fn robot_spec(&self) -> &RobotSpec {
        todo!()
    }

    /// The environment.
    pub fn environment(&self) -> &Environment {
        todo!()
    }

    /// The box of genomes.
    pub fn bounds(&self) -> &Bounds {
        todo!()
    }

    /// Names of the genome's parameters, such as `gait1.hip-front.omega1`, in order.
    pub fn parameter_names(&self) -> Vec<String> {
        todo!()
    }

    /// Whether larger or smaller scores are better.
    pub fn direction(&self) -> Direction {
        todo!()
    }

    /// Name and unit of the score, such as ("coverage", "%").
    pub fn score_label(&self) -> (&'static str, &'static str) {
        todo!()
    }

    /// A fresh optimiser at generation 0.
    pub fn optimiser(&self) -> Box<dyn Optimiser> {
        todo!()
    }

    /// Most rollouts one evaluation can take; with reuse it takes far fewer.
    pub fn most_rollouts(&self) -> u64 {
        todo!()
    }
}
