//! Which engine a job runs on.

use super::{EngineChoice, EngineKind, JointKind, PhysicsSpec};
use crate::environment::Environment;
use crate::error::Invalid;
use crate::lockstep::{self, Unsupported};
use crate::measure::known::{Known, Verdict};
use crate::robot::Robot;
use crate::rollout::Physics;
use std::fmt;

/// The engine that a job runs on, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chosen {
    /// The engine.
    pub engine: EngineKind,
    /// Why this one.
    pub why: Why,
}

/// Why a job runs on its engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// The job says so; a job that was resolved before always does.
    Asked,
    /// Lockstep's fidelity on this robot is in the table that ships, and stands.
    Measured,
    /// There is terrain.
    Terrain,
    /// The robot has capsules.
    Capsules,
    /// The job asks for multibody joints.
    Multibody,
    /// Gravity, friction, motors or steps are not the scale's own.
    OtherPhysics,
    /// The table does not know the robot.
    Unmeasured,
    /// The table knows that lockstep is not good enough for it.
    Inexact,
}

impl fmt::Display for Chosen {
    /// Such as "auto: rapier, since there is terrain".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let why = match self.why {
            Why::Asked => return self.engine.fmt(f),
            Why::Measured => "whose fidelity on this robot is measured",
            Why::Terrain => "since there is terrain",
            Why::Capsules => "since the robot has capsules",
            Why::Multibody => "since joints are multibody",
            Why::OtherPhysics => "since the physics is not the scale's own",
            Why::Unmeasured => "since lockstep's fidelity on this robot is not measured",
            Why::Inexact => "since lockstep's fidelity on this robot falls short",
        };
        write!(f, "auto: {}, {why}", self.engine)
    }
}

/// Settles on the engine that a job asks for, or chooses one by what is known. Refuses the lockstep engine where it does
/// not serve.
pub(super) fn choose(
    spec: &PhysicsSpec,
    robot: &Robot,
    environment: &Environment,
    known: &Known,
) -> Result<Chosen, Invalid> {
    let obstacle = obstacle(spec, robot, environment);
    let asked = |engine| Chosen { engine, why: Why::Asked };
    match (spec.engine, obstacle) {
        (EngineChoice::Rapier, _) => Ok(asked(EngineKind::Rapier)),
        (EngineChoice::Lockstep, None) => Ok(asked(EngineKind::Lockstep)),
        (EngineChoice::Lockstep, Some((_, reason))) => Err(Invalid::Conflict {
            field: "physics.engine".into(),
            reason: format!("\"lockstep\" can't run this job: {reason}; use \"rapier\" or \"auto\""),
        }),
        (EngineChoice::Auto, Some((why, _))) => Ok(Chosen { engine: EngineKind::Rapier, why }),
        (EngineChoice::Auto, None) => Ok(by_fidelity(spec, robot, known)),
    }
}

/// What rules the lockstep engine out, for `auto` and in words.
fn obstacle(spec: &PhysicsSpec, robot: &Robot, environment: &Environment) -> Option<(Why, String)> {
    match lockstep::supports(robot, &environment.terrain) {
        Err(reason @ Unsupported::Terrain) => Some((Why::Terrain, reason.to_string())),
        Err(reason @ Unsupported::Capsules) => Some((Why::Capsules, reason.to_string())),
        Ok(()) if spec.joints == JointKind::Multibody => {
            Some((Why::Multibody, "physics.joints = \"multibody\" is a kind of joint of rapier's".to_owned()))
        }
        Ok(()) => None,
    }
}

/// Lockstep where it is known to be good: for this robot, on the scale's own physics.
fn by_fidelity(spec: &PhysicsSpec, robot: &Robot, known: &Known) -> Chosen {
    let own = Physics::of(EngineKind::Lockstep, spec.scale);
    // A table that is out of range is refused later on, by field.
    if Physics::resolve(EngineKind::Lockstep, spec).ok() != Some(own) {
        return Chosen { engine: EngineKind::Rapier, why: Why::OtherPhysics };
    }
    let (engine, why) = match known.verdict(robot, spec.scale) {
        Verdict::Stands => (EngineKind::Lockstep, Why::Measured),
        Verdict::Falls => (EngineKind::Rapier, Why::Inexact),
        Verdict::Unknown => (EngineKind::Rapier, Why::Unmeasured),
    };
    Chosen { engine, why }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue;
    use crate::job::Scale;
    use crate::measure::known::{Agreement, Row};

    fn robot(toml: &str) -> Robot {
        Robot::compile(&toml::from_str(toml).unwrap()).unwrap()
    }

    fn quadropod() -> Robot {
        robot(catalogue::robots()[0].toml)
    }

    fn environment(name: &str) -> Environment {
        Environment::from_toml(catalogue::find(catalogue::environments(), name).unwrap().toml).unwrap()
    }

    /// A table that knows one robot, at both scales.
    fn knows(robot: &Robot, spearman: f64) -> Known {
        let agreement = Agreement { gaits: 100, spearman, ceiling: 1.0 };
        let row = |scale| {
            let own = Physics::of(EngineKind::Lockstep, scale);
            Row {
                robot: "r".into(),
                variant: "none".into(),
                mechanics: robot.mechanics(),
                scale,
                revision: lockstep::REVISION,
                steps_per_second: own.steps_per_second,
                substeps: own.substeps,
                reference: String::new(),
                random: agreement,
                evolved: agreement,
            }
        };
        Known { rows: [Scale::Paper, Scale::Real].map(row).to_vec() }
    }

    fn physics(text: &str) -> PhysicsSpec {
        toml::from_str(text).unwrap()
    }

    #[test]
    fn auto_is_lockstep_for_a_measured_robot_on_its_scale_s_own_physics_and_rapier_for_any_other() {
        let robot = quadropod();
        let known = knows(&robot, 0.99);
        let chosen = |text: &str| choose(&physics(text), &robot, &environment("column"), &known).unwrap();
        for text in ["", "scale = \"real\"", "friction = 0.8", "steps_per_second = 200\nsubsteps = 2"] {
            assert_eq!(chosen(text), Chosen { engine: EngineKind::Lockstep, why: Why::Measured }, "{text}");
        }
        for (text, why) in [
            ("friction = 0.7", Why::OtherPhysics),
            ("gravity = 1.62", Why::OtherPhysics),
            ("stiffness = 300.0", Why::OtherPhysics),
            ("damping = 21.0", Why::OtherPhysics),
            ("max_torque = 61.0", Why::OtherPhysics),
            ("substeps = 3", Why::OtherPhysics),
            ("steps_per_second = 30", Why::OtherPhysics),
            ("friction = -1.0", Why::OtherPhysics),
            ("joints = \"multibody\"", Why::Multibody),
        ] {
            assert_eq!(chosen(text), Chosen { engine: EngineKind::Rapier, why }, "{text}");
        }
        let rapier = |robot: &Robot, environment: &str, known: &Known| {
            let chosen =
                choose(&PhysicsSpec::default(), robot, &super::tests::environment(environment), known).unwrap();
            assert_eq!(chosen.engine, EngineKind::Rapier);
            chosen.why
        };
        assert_eq!(rapier(&robot, "stairs", &known), Why::Terrain);
        assert_eq!(rapier(&robot, "empty", &Known::default()), Why::Unmeasured);
        assert_eq!(rapier(&robot, "empty", &knows(&robot, 0.9)), Why::Inexact);
        let round = with_capsules();
        assert_eq!(rapier(&round, "empty", &knows(&round, 0.99)), Why::Capsules);
    }

    fn with_capsules() -> Robot {
        let mut robot = quadropod();
        let ends = [crate::math::Vector::ZERO, crate::math::Vector::X];
        robot.bodies[1].capsules.push(crate::robot::CollisionCapsule { ends, radius: 0.1 });
        robot
    }

    #[test]
    fn lockstep_is_refused_by_field_and_reason_where_it_does_not_serve() {
        let refused = |robot: &Robot, environment: &str, more: &str| {
            let spec = physics(&format!("engine = \"lockstep\"\n{more}"));
            let environment = super::tests::environment(environment);
            choose(&spec, robot, &environment, &Known::default()).unwrap_err().to_string()
        };
        for (said, reason) in [
            (refused(&quadropod(), "stairs", ""), "there is terrain"),
            (refused(&with_capsules(), "empty", ""), "the robot has capsules"),
            (refused(&quadropod(), "empty", "joints = \"multibody\""), "physics.joints = \"multibody\""),
        ] {
            assert!(said.starts_with("physics.engine: \"lockstep\" can't run this job: "), "{said}");
            assert!(said.contains(reason) && said.ends_with("use \"rapier\" or \"auto\""), "{said}");
        }
    }

    #[test]
    fn a_job_that_names_its_engine_gets_it_whatever_is_known() {
        let robot = quadropod();
        for engine in [EngineKind::Rapier, EngineKind::Lockstep] {
            let spec = PhysicsSpec { engine: engine.into(), ..PhysicsSpec::default() };
            for known in [Known::default(), knows(&robot, 0.99)] {
                let chosen = choose(&spec, &robot, &environment("empty"), &known).unwrap();
                assert_eq!((chosen.engine, chosen.why), (engine, Why::Asked));
                assert_eq!(chosen.to_string(), engine.name());
            }
        }
    }

    #[test]
    fn the_reason_is_a_short_phrase() {
        let said = |engine, why| Chosen { engine, why }.to_string();
        assert_eq!(
            said(EngineKind::Lockstep, Why::Measured),
            "auto: lockstep, whose fidelity on this robot is measured"
        );
        assert_eq!(said(EngineKind::Rapier, Why::Terrain), "auto: rapier, since there is terrain");
    }
}
