//! The parts of a job that its tables name: robot, environment, engine, physics and finish.

use super::tables::JobKind;
use super::{Finish, JobSpec, Reference};
use crate::base::error::{Faults, Invalid};
use crate::engines::fidelity::FidelityTable;
use crate::engines::{Chosen, Why, auto};
use crate::model::environment::Environment;
use crate::model::{Robot, RobotSpec, catalogue};
use crate::physics::{EngineKind, Physics};

/// Resolved parts of a job.
pub(super) struct Parts {
    pub robot_spec: RobotSpec,
    pub robot: Robot,
    pub environment: Environment,
    pub engine: Chosen,
    pub physics: Physics,
    pub finish: Option<Finish>,
}

impl Parts {
    /// Resolves the parts. Writes the steps that the fidelity table gives into `spec.physics`.
    ///
    /// # Errors
    /// If a part is invalid, or `faults` has a fault already.
    pub fn resolve(spec: &mut JobSpec, mut faults: Faults) -> Result<Self, Invalid> {
        let finish = match JobKind::of(spec) {
            JobKind::Evolve => faults.take(spec.finish.clone().unwrap_or_default().resolve(spec.physics.scale)),
            JobKind::Plan | JobKind::Simulate => Some(None),
        };
        let robot_spec = faults.take(resolve_robot(spec));
        let environment = faults.take(resolve_environment(&spec.environment));
        let robot = robot_spec.as_ref().and_then(|robot_spec| faults.take(Robot::compile(robot_spec)));
        let chosen = match (&robot, &environment) {
            (Some(robot), Some(environment)) => {
                faults.take(auto::choose(&spec.physics, robot, environment, FidelityTable::shipped()))
            }
            _ => None,
        };
        if let Some(Why::Measured(setting)) = chosen.map(|chosen| chosen.why) {
            spec.physics = auto::with_steps(&spec.physics, setting);
        }
        // Ranges of physics are the same for both engines.
        let engine_kind = chosen.map_or(EngineKind::Rapier, |chosen| chosen.engine);
        let physics = faults.take(Physics::resolve(engine_kind, &spec.physics));
        faults.end()?;
        let (Some(robot_spec), Some(environment), Some(robot), Some(engine), Some(physics), Some(finish)) =
            (robot_spec, environment, robot, chosen, physics, finish)
        else {
            unreachable!("a missing part has left a fault")
        };
        Ok(Self { robot_spec, robot, environment, engine, physics, finish })
    }
}

fn resolve_robot(spec: &JobSpec) -> Result<RobotSpec, Invalid> {
    let mut robot: RobotSpec = match &spec.robot {
        Reference::Inline(robot) => (**robot).clone(),
        Reference::Named(name) => toml::from_str(shipped("robot", catalogue::robots(), name)?)?,
    };
    if let Some(variant) = &spec.variant {
        robot = robot.variant(variant)?;
    }
    robot.variants.clear();
    Ok(robot)
}

fn resolve_environment(reference: &Reference<Environment>) -> Result<Environment, Invalid> {
    let environment: Environment = match reference {
        Reference::Inline(environment) => (**environment).clone(),
        Reference::Named(name) => toml::from_str(shipped("environment", catalogue::environments(), name)?)?,
    };
    environment.validate()?;
    Ok(environment)
}

fn shipped(field: &str, entries: &'static [catalogue::Entry], name: &str) -> Result<&'static str, Invalid> {
    catalogue::find(entries, name).map(|e| e.toml).ok_or_else(|| Invalid::Unknown {
        field: field.to_owned(),
        value: name.to_owned(),
        known: entries.iter().map(|e| e.name.to_owned()).collect(),
    })
}
