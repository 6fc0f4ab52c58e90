//! Subject of physics measurements: a robot on flat ground or in an environment. It is a job, so it is checked and
//! settled like any other.

use crate::arguments;
use crate::error::Error;
use crate::load;
use serde::Serialize;
use sim_core::genotype::Genotype;
use sim_core::model::environment::Environment;
use sim_core::physics::{EngineKind, Motion, lockstep};
use sim_core::problem::Job;
use study::gaits;
use study::setting::PhysicsSetting;
use study::subject::Subject;

/// Reads a subject's robot and puts it on flat ground or into an environment. Also returns the robot's name for errors.
pub fn read(subject: &arguments::Subject, environment: Option<Environment>) -> Result<(Subject, String), Error> {
    let load::RobotFile { spec: robot, label, .. } = load::robot(&subject.robot, None)?;
    let (variant, scale) = (subject.variant.clone(), subject.scale.into());
    Ok((Subject { robot, variant, environment, scale }, label))
}

/// Returns a subject as a job with gaits of `duration` s, on flat ground if there is no environment. The start is
/// settled with `setting`.
pub fn job(
    subject: &arguments::Subject,
    environment: Option<Environment>,
    setting: PhysicsSetting,
    duration: f64,
    seed: u64,
) -> Result<Job, Error> {
    let (subject, file) = read(subject, environment)?;
    subject.job(setting, duration, seed).map_err(|source| Error::Invalid { file, source })
}

/// Returns the default setting of an engine at the subject's scale.
pub fn own(subject: &arguments::Subject, engine: EngineKind) -> PhysicsSetting {
    PhysicsSetting::own(engine, subject.scale.into())
}

/// Fails if a setting's engine can't simulate the job's robot or terrain.
pub fn supported(settings: &[PhysicsSetting], job: &Job) -> Result<(), Error> {
    let lockstep = settings.iter().find(|s| s.engine == EngineKind::Lockstep);
    match (lockstep, lockstep::supports(job.robot(), &job.environment().terrain)) {
        (Some(setting), Err(why)) => {
            Err(Error::Usage { message: format!("setting {setting} can't simulate this job: {why}") })
        }
        _ => Ok(()),
    }
}

/// Fails if a gait of `duration` s is not a whole number of steps with one of the settings.
pub fn check(settings: &[PhysicsSetting], duration: f64) -> Result<(), Error> {
    match settings.iter().find(|s| !s.divides(duration)) {
        None => Ok(()),
        Some(setting) => Err(Error::Usage {
            message: format!(
                "setting {setting} does not fit gaits of {duration} s: the duration must be a whole number of steps of 1/{} s; choose \
                 another --duration",
                setting.steps_per_second
            ),
        }),
    }
}

/// Compiles gaits to motions of the job's duration. Fails for gaits that the controller can't execute.
pub fn compiled(job: &Job, gaits: &[Genotype]) -> Result<Vec<Motion>, Error> {
    gaits::compiled(job, gaits)
        .map_err(|e| Error::Usage { message: format!("a gait of this controller can't be measured: {e}") })
}

/// Machine and build that speeds depend on.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    /// Cores that this process may use.
    pub cores: u32,
    /// Operating system and architecture.
    pub system: String,
    /// Build profile, "release" or "dev". Physics is optimised in both, other code in "release" only.
    pub build: &'static str,
}

impl Machine {
    /// Returns the description of this machine.
    pub fn here() -> Self {
        let build = if cfg!(debug_assertions) { "dev" } else { "release" };
        let system = format!("{} {}", std::env::consts::OS, std::env::consts::ARCH);
        Self { cores: arguments::cores(), system, build }
    }

    /// Returns the description as a line of text.
    pub fn line(&self) -> String {
        format!("{}, {} cores, {} build", self.system, self.cores, self.build)
    }
}
