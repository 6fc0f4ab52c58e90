//! Subject of a measurement: a robot on flat ground or in an environment, as a job, so that it is checked and settled
//! like any other.

use crate::setting::Setting;
use sim_core::base::error::Invalid;
use sim_core::job::{JobSpec, Reference};
use sim_core::model::RobotSpec;
use sim_core::model::environment::Environment;
use sim_core::physics::Scale;
use sim_core::problem::Job;

/// All that a job needs and a subject does not have: the evolution that gaits are taken from.
const FRAME: &str = r#"
name = "bench"
robot = "quadropod"
environment = "empty"
[gaits]
count = 2
[planner]
iterations = 40
[fitness]
kind = "coverage"
cell = 1.0
[optimiser]
kind = "ga"
population = 17
generations = 8
"#;
/// Evolutions last gaits of so many s: enough to find what moves, at less than half the cost.
const EVOLVED_DURATION: f64 = 4.0;
/// More evolutions than this are not begun.
const MOST_EVOLUTIONS: u64 = 1000;

/// A robot and its surroundings.
#[derive(Clone, Debug)]
pub struct Subject {
    /// The robot.
    pub robot: RobotSpec,
    /// Name of the robot's variant, if any.
    pub variant: Option<String>,
    /// The environment; `None`: flat ground.
    pub environment: Option<Environment>,
    /// Gravity and motors.
    pub scale: Scale,
}

impl Subject {
    /// The job with gaits of `duration` s; its start is the one settled with `setting`.
    ///
    /// # Errors
    /// If the job is invalid or the robot does not settle.
    pub fn job(&self, setting: Setting, duration: f64, seed: u64) -> Result<Job, Invalid> {
        let mut spec: JobSpec = toml::from_str(FRAME)?;
        spec.robot = Reference::Inline(Box::new(self.robot.clone()));
        if let Some(environment) = &self.environment {
            spec.environment = Reference::Inline(Box::new(environment.clone()));
        }
        spec.variant.clone_from(&self.variant);
        spec.seed = seed;
        spec.physics.scale = self.scale;
        setting.write(&mut spec.physics);
        Job::new(spec.lasting(duration))
    }

    /// Jobs of short evolutions with `setting`, with the seeds from `seed` on: for [`crate::gaits::evolved`].
    ///
    /// # Errors
    /// If the first job is refused.
    pub fn evolutions(&self, setting: Setting, seed: u64) -> Result<impl Iterator<Item = Job>, Invalid> {
        let first = self.job(setting, EVOLVED_DURATION, seed)?;
        // The first was checked; other seeds change nothing that could be refused.
        let again = move |run: u64| self.job(setting, EVOLVED_DURATION, (seed + run) & i64::MAX as u64).ok();
        Ok(std::iter::once(first).chain((1..MOST_EVOLUTIONS).map_while(again)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sim_core::model::catalogue;
    use sim_core::physics::EngineKind;

    #[test]
    fn evolutions_differ_in_their_seeds_only() {
        let robot = toml::from_str(catalogue::robots()[0].toml).unwrap();
        let subject = Subject { robot, variant: None, environment: None, scale: Scale::Paper };
        let setting = Setting::own(EngineKind::Lockstep, Scale::Paper);
        let jobs: Vec<Job> = subject.evolutions(setting, 7).unwrap().take(3).collect();
        for (seed, job) in (7..).zip(&jobs) {
            assert_eq!((job.spec().seed, Setting::of(job)), (seed, setting));
            assert_eq!(JobSpec { seed: 7, ..job.spec().clone() }, *jobs[0].spec());
        }
    }
}
