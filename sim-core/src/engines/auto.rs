//! Choice of the engine that a job runs on.

use crate::base::error::Invalid;
use crate::engines::fidelity::{FidelityRow, FidelityTable};
use crate::model::Robot;
use crate::model::environment::Environment;
use crate::physics::lockstep;
use crate::physics::{EngineChoice, EngineKind, JointKind, Physics, PhysicsSpec, Unsupported};
use std::fmt;

/// Engine that a job runs on, with the reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chosen {
    /// Chosen engine.
    pub engine: EngineKind,
    /// Reason for the choice.
    pub why: Why,
}

/// Reason for the choice of a job's engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// The job names the engine. A job that was resolved before always names it.
    Asked,
    /// The shipped table shows sufficient fidelity of lockstep on this robot, at these steps a second and substeps.
    Measured((u32, u32)),
    /// The environment has terrain. The shipped table has no fidelity on stairs, and lockstep can't simulate other
    /// terrain.
    Terrain,
    /// The robot has capsules, which lockstep can't simulate.
    Capsules,
    /// The robot has D-shaped parts, which lockstep can't simulate.
    Prisms,
    /// The job has multibody joints, which only rapier has.
    Multibody,
    /// Gravity, friction, motors or steps differ from the defaults of the scale.
    OtherPhysics,
    /// The table has no row for the robot.
    Unmeasured,
    /// The table has rows for the robot, and none shows sufficient fidelity.
    Inexact,
}

impl fmt::Display for Chosen {
    /// Writes a phrase such as "auto: rapier, since there is terrain".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let why = match self.why {
            Why::Asked => return self.engine.fmt(f),
            Why::Measured(_) => "with measured fidelity on this robot",
            Why::Terrain => "since there is terrain",
            Why::Capsules => "since the robot has capsules",
            Why::Prisms => "since the robot has D-shaped parts",
            Why::Multibody => "since joints are multibody",
            Why::OtherPhysics => "since the physics differs from the scale's defaults",
            Why::Unmeasured => "since lockstep's fidelity on this robot is not measured",
            Why::Inexact => "since lockstep's fidelity on this robot is too low",
        };
        write!(f, "auto: {}, {why}", self.engine)
    }
}

/// Returns the engine that a job names, or chooses one by the fidelity table. Refuses the lockstep engine where it
/// can't simulate the job.
pub(crate) fn choose(
    spec: &PhysicsSpec,
    robot: &Robot,
    environment: &Environment,
    known: &FidelityTable,
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
        (EngineChoice::Auto, None) if !environment.is_flat() => {
            Ok(Chosen { engine: EngineKind::Rapier, why: Why::Terrain })
        }
        (EngineChoice::Auto, None) => Ok(by_fidelity(spec, robot, known)),
    }
}

/// Returns the reason that excludes the lockstep engine, as a value and as text.
fn obstacle(spec: &PhysicsSpec, robot: &Robot, environment: &Environment) -> Option<(Why, String)> {
    match lockstep::supports(robot, &environment.terrain) {
        Err(reason) => {
            let why = match reason {
                Unsupported::Terrain => Why::Terrain,
                Unsupported::Prisms => Why::Prisms,
                _ => Why::Capsules,
            };
            Some((why, reason.to_string()))
        }
        Ok(()) if spec.joints == JointKind::Multibody => {
            Some((Why::Multibody, "only rapier supports physics.joints = \"multibody\"".to_owned()))
        }
        Ok(()) => None,
    }
}

/// Returns lockstep where its fidelity is sufficient: for this robot, with the scale's default physics, at measured
/// steps. Otherwise returns rapier.
fn by_fidelity(spec: &PhysicsSpec, robot: &Robot, known: &FidelityTable) -> Chosen {
    let rapier = |why| Chosen { engine: EngineKind::Rapier, why };
    let rows = known.of(robot, spec.scale);
    let fits = |(steps_per_second, substeps): (u32, u32)| {
        let own = Physics { steps_per_second, substeps, ..Physics::of(EngineKind::Lockstep, spec.scale) };
        // Values out of range are refused later, by field.
        Physics::resolve(EngineKind::Lockstep, &with_steps(spec, (steps_per_second, substeps))).ok() == Some(own)
    };
    let own = Physics::of(EngineKind::Lockstep, spec.scale);
    if rows.is_empty() {
        let fits = fits((own.steps_per_second, own.substeps));
        return rapier(if fits { Why::Unmeasured } else { Why::OtherPhysics });
    }
    let fitting: Vec<&FidelityRow> = rows.into_iter().filter(|row| fits(row.setting())).collect();
    match fitting.iter().find(|row| row.stands()) {
        Some(row) => Chosen { engine: EngineKind::Lockstep, why: Why::Measured(row.setting()) },
        None if fitting.is_empty() => rapier(Why::OtherPhysics),
        None => rapier(Why::Inexact),
    }
}

/// Returns the table with these steps a second and substeps where it has none of its own.
pub(crate) fn with_steps(spec: &PhysicsSpec, (steps_per_second, substeps): (u32, u32)) -> PhysicsSpec {
    PhysicsSpec {
        steps_per_second: spec.steps_per_second.or(Some(steps_per_second)),
        substeps: spec.substeps.or(Some(substeps)),
        ..spec.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engines::fidelity::Agreement;
    use crate::model::catalogue;
    use crate::physics::Scale;

    fn robot(toml: &str) -> Robot {
        Robot::compile(&toml::from_str(toml).unwrap()).unwrap()
    }

    fn quadropod() -> Robot {
        robot(catalogue::robots()[0].toml)
    }

    fn environment(name: &str) -> Environment {
        Environment::from_toml(catalogue::find(catalogue::environments(), name).unwrap().toml).unwrap()
    }

    /// Returns a table with one robot, at both scales.
    fn knows(robot: &Robot, spearman: f64) -> FidelityTable {
        let agreement = Agreement { gaits: 100, spearman, ceiling: 1.0 };
        let row = |scale| {
            let own = Physics::of(EngineKind::Lockstep, scale);
            FidelityRow {
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
        FidelityTable { rows: [Scale::Paper, Scale::Real].map(row).to_vec() }
    }

    fn physics(text: &str) -> PhysicsSpec {
        toml::from_str(text).unwrap()
    }

    #[test]
    fn auto_chooses_lockstep_only_with_measured_fidelity() {
        let robot = quadropod();
        let known = knows(&robot, 0.99);
        let chosen = |text: &str| choose(&physics(text), &robot, &environment("column"), &known).unwrap();
        let real = Physics::of(EngineKind::Lockstep, Scale::Real);
        let real = (real.steps_per_second, real.substeps);
        for (text, setting) in [
            ("", (200, 2)),
            ("scale = \"real\"", real),
            ("friction = 0.8", (200, 2)),
            ("steps_per_second = 200\nsubsteps = 2", (200, 2)),
        ] {
            assert_eq!(chosen(text), Chosen { engine: EngineKind::Lockstep, why: Why::Measured(setting) }, "{text}");
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
        let rapier = |robot: &Robot, environment: &str, known: &FidelityTable| {
            let chosen =
                choose(&PhysicsSpec::default(), robot, &super::tests::environment(environment), known).unwrap();
            assert_eq!(chosen.engine, EngineKind::Rapier);
            chosen.why
        };
        assert_eq!(rapier(&robot, "stairs", &known), Why::Terrain);
        assert_eq!(rapier(&robot, "empty", &FidelityTable::default()), Why::Unmeasured);
        assert_eq!(rapier(&robot, "empty", &knows(&robot, 0.9)), Why::Inexact);
        let round = with_capsules();
        assert_eq!(rapier(&round, "empty", &knows(&round, 0.99)), Why::Capsules);
    }

    #[test]
    fn auto_chooses_fastest_setting_with_sufficient_fidelity() {
        let robot = quadropod();
        let mut known = knows(&robot, 0.9);
        let fine = Agreement { gaits: 100, spearman: 0.99, ceiling: 1.0 };
        known.rows.extend([800, 400].map(|steps_per_second| FidelityRow {
            steps_per_second,
            random: fine,
            evolved: fine,
            ..known.rows[0].clone()
        }));
        let chosen = |text: &str| choose(&physics(text), &robot, &environment("empty"), &known).unwrap().why;
        assert_eq!(chosen(""), Why::Measured((400, 2)));
        assert_eq!(chosen("steps_per_second = 800"), Why::Measured((800, 2)));
        assert_eq!(chosen("steps_per_second = 200"), Why::Inexact);
        assert_eq!(chosen("steps_per_second = 1600"), Why::OtherPhysics);
    }

    fn with_capsules() -> Robot {
        let mut robot = quadropod();
        let ends = [crate::base::math::Vector::ZERO, crate::base::math::Vector::X];
        robot.bodies[1].capsules.push(crate::model::CollisionCapsule { ends, radius: 0.1 });
        robot
    }

    #[test]
    fn unsupported_lockstep_job_is_refused_by_field() {
        let mut pillar = environment("stairs");
        pillar.terrain[0].size[1] = 1.0;
        let refused = |robot: &Robot, environment: &Environment, more: &str| {
            let spec = physics(&format!("engine = \"lockstep\"\n{more}"));
            choose(&spec, robot, environment, &FidelityTable::default()).unwrap_err().to_string()
        };
        for (said, reason) in [
            (refused(&quadropod(), &pillar, ""), "stairs only"),
            (refused(&with_capsules(), &environment("empty"), ""), "the robot has capsules"),
            (refused(&quadropod(), &environment("empty"), "joints = \"multibody\""), "physics.joints = \"multibody\""),
        ] {
            assert!(said.starts_with("physics.engine: \"lockstep\" can't run this job: "), "{said}");
            assert!(said.contains(reason) && said.ends_with("use \"rapier\" or \"auto\""), "{said}");
        }
    }

    #[test]
    fn named_engine_is_used_without_fidelity_row() {
        let robot = quadropod();
        for engine in [EngineKind::Rapier, EngineKind::Lockstep] {
            let spec = PhysicsSpec { engine: engine.into(), ..PhysicsSpec::default() };
            for (known, name) in [
                (FidelityTable::default(), "empty"),
                (knows(&robot, 0.99), "empty"),
                (FidelityTable::default(), "stairs"),
            ] {
                let chosen = choose(&spec, &robot, &environment(name), &known).unwrap();
                assert_eq!((chosen.engine, chosen.why), (engine, Why::Asked));
                assert_eq!(chosen.to_string(), engine.name());
            }
        }
    }

    #[test]
    fn choice_is_displayed_with_short_reason() {
        let said = |engine, why| Chosen { engine, why }.to_string();
        assert_eq!(
            said(EngineKind::Lockstep, Why::Measured((200, 2))),
            "auto: lockstep, with measured fidelity on this robot"
        );
        assert_eq!(said(EngineKind::Rapier, Why::Terrain), "auto: rapier, since there is terrain");
    }
}
