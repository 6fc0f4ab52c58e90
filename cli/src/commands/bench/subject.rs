//! What physics is measured on: a robot on flat ground or in an environment, as a job, so that it is checked and settled
//! like any other.

use crate::arguments;
use crate::error::Error;
use crate::load;
use serde::Serialize;
use sim_core::genotype::Genotype;
use sim_core::model::environment::Environment;
use sim_core::physics::{EngineKind, Motion, lockstep};
use sim_core::problem::Job;
use study::gaits;
use study::setting::Setting;
use study::subject::Subject;

/// Reads a subject's robot and puts it on flat ground or into an environment; also returns the robot's name for errors.
pub fn read(subject: &arguments::Subject, environment: Option<Environment>) -> Result<(Subject, String), Error> {
    let load::RobotFile { spec: robot, label, .. } = load::robot(&subject.robot, None)?;
    let (variant, scale) = (subject.variant.clone(), subject.scale.into());
    Ok((Subject { robot, variant, environment, scale }, label))
}

/// A subject as a job with gaits of `duration` s, on flat ground unless there is an environment; its start is the one
/// settled with `setting`.
pub fn job(
    subject: &arguments::Subject,
    environment: Option<Environment>,
    setting: Setting,
    duration: f64,
    seed: u64,
) -> Result<Job, Error> {
    let (subject, file) = read(subject, environment)?;
    subject.job(setting, duration, seed).map_err(|source| Error::Invalid { file, source })
}

/// The scale's own setting on an engine.
pub fn own(subject: &arguments::Subject, engine: EngineKind) -> Setting {
    Setting::own(engine, subject.scale.into())
}

/// Refuses settings of an engine that can't simulate the job's robot or terrain.
pub fn supported(settings: &[Setting], job: &Job) -> Result<(), Error> {
    let lockstep = settings.iter().find(|s| s.engine == EngineKind::Lockstep);
    match (lockstep, lockstep::supports(job.robot(), &job.environment().terrain)) {
        (Some(setting), Err(why)) => Err(Error::Usage { message: format!("{setting} is not possible: {why}") }),
        _ => Ok(()),
    }
}

/// Refuses settings with which a gait of so many s is no whole number of steps.
pub fn check(settings: &[Setting], duration: f64) -> Result<(), Error> {
    match settings.iter().find(|s| !s.divides(duration)) {
        None => Ok(()),
        Some(setting) => Err(Error::Usage {
            message: format!(
                "{setting} does not fit gaits of {duration} s: that is no whole number of {} steps a second; choose \
                 another --duration",
                setting.steps_per_second
            ),
        }),
    }
}

/// Compiles gaits to motions of the job's duration. Refuses gaits that the controller can't execute.
pub fn compiled(job: &Job, gaits: &[Genotype]) -> Result<Vec<Motion>, Error> {
    gaits::compiled(job, gaits)
        .map_err(|e| Error::Usage { message: format!("not every gait of this controller can be measured: {e}") })
}

/// What numbers of speed depend on.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    /// Cores that this process may use.
    pub cores: u32,
    /// Operating system and architecture.
    pub system: String,
    /// "release" or "dev"; physics is optimised in both, the rest in the first only.
    pub build: &'static str,
}

impl Machine {
    /// This one.
    pub fn here() -> Self {
        let build = if cfg!(debug_assertions) { "dev" } else { "release" };
        let system = format!("{} {}", std::env::consts::OS, std::env::consts::ARCH);
        Self { cores: arguments::cores(), system, build }
    }

    /// In a line, for people.
    pub fn line(&self) -> String {
        format!("{}, {} cores, {} build", self.system, self.cores, self.build)
    }
}
