//! Subject of a measurement: a robot on flat ground or in an environment. It is made into a job, so that it is checked
//! and settled like any other job.

use crate::setting::PhysicsSetting;
use sim_core::base::error::Invalid;
use sim_core::job::{JobSpec, Reference};
use sim_core::model::RobotSpec;
use sim_core::model::environment::Environment;
use sim_core::physics::Scale;
use sim_core::problem::Job;

/// Template of a subject's job, with the evolution that gaits are taken from. A subject replaces robot and environment.
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
/// Duration of a gait in evolutions, s: long enough to find gaits that move, at less than half the cost.
const EVOLVED_DURATION: f64 = 4.0;
/// Greatest number of evolutions of a subject.
const MOST_EVOLUTIONS: u64 = 1000;

/// Robot and environment to measure.
#[derive(Clone, Debug)]
pub struct Subject {
    /// Robot to measure.
    pub robot: RobotSpec,
    /// Name of the robot's variant, if any.
    pub variant: Option<String>,
    /// Environment of the robot; `None` for flat ground.
    pub environment: Option<Environment>,
    /// Scale of gravity and motors.
    pub scale: Scale,
}

impl Subject {
    /// Returns the job with gaits of `duration` s. Its start is settled with `setting`.
    ///
    /// # Errors
    /// If the job is invalid or the robot does not settle.
    pub fn job(&self, setting: PhysicsSetting, duration: f64, seed: u64) -> Result<Job, Invalid> {
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

    /// Returns jobs of short evolutions with `setting` and consecutive seeds from `seed` on, for
    /// [`crate::gaits::evolved`].
    ///
    /// # Errors
    /// If the first job is invalid or its robot does not settle.
    pub fn evolutions(&self, setting: PhysicsSetting, seed: u64) -> Result<impl Iterator<Item = Job>, Invalid> {
        let first = self.job(setting, EVOLVED_DURATION, seed)?;
        // The first job was checked, and the seed does not affect a job's validity.
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
        let setting = PhysicsSetting::own(EngineKind::Lockstep, Scale::Paper);
        let jobs: Vec<Job> = subject.evolutions(setting, 7).unwrap().take(3).collect();
        for (seed, job) in (7..).zip(&jobs) {
            assert_eq!((job.spec().seed, PhysicsSetting::of(job)), (seed, setting));
            assert_eq!(JobSpec { seed: 7, ..job.spec().clone() }, *jobs[0].spec());
        }
    }
}
