//! Settling of a robot on the setting of its rollouts, or on a quiet setting.

use super::engine;
use crate::model::{Robot, State};
use crate::physics::{EngineKind, JointKind, Physics, Unsettled, lockstep, settle_still, settle_until};
use std::fmt;

/// Steps a second and substeps of the quiet setting on the lockstep engine.
const QUIET_LOCKSTEP: (u32, u32) = (600, 2);
/// Steps a second and substeps of the quiet setting on rapier with multibody joints, for robots with capsules.
const QUIET_MULTIBODY: (u32, u32) = (240, 4);

/// Start of a robot at rest, and the setting on which it was found.
#[derive(Clone, Debug, PartialEq)]
pub struct Settled {
    /// The start on flat ground, in the canonical frame (x = y = 0, heading 0).
    pub state: State,
    /// Quiet setting on which the start was found; `None` if it was found on the setting of the rollouts.
    pub quiet: Option<Quiet>,
}

/// Setting on which a robot is settled if it trembles on the setting of its rollouts. There the impulses that hold a
/// joint together overshoot in every step, while MuJoCo and reduced coordinates hold the same robot still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quiet {
    /// Engine of the quiet setting.
    pub engine: EngineKind,
    /// Quiet setting of the engine.
    pub physics: Physics,
    /// Speed at which the robot trembles on the setting of its rollouts, mu/s.
    pub trembling: f32,
}

impl Quiet {
    /// Returns the quiet setting of a robot that trembles at `trembling` mu/s on the setting of its rollouts.
    pub fn of(robot: &Robot, physics: &Physics, trembling: f32) -> Self {
        let lockstep = lockstep::supports(robot, &[]).is_ok();
        let (engine, joints, steps) = match lockstep {
            true => (EngineKind::Lockstep, JointKind::Impulse, QUIET_LOCKSTEP),
            false => (EngineKind::Rapier, JointKind::Multibody, QUIET_MULTIBODY),
        };
        let physics = Physics { steps_per_second: steps.0, substeps: steps.1, joints, ..*physics };
        Self { engine, physics, trembling }
    }
}

impl fmt::Display for Quiet {
    /// Writes a phrase such as "on lockstep, 600 steps a second, 2 substeps: on the job's own setting the robot keeps
    /// trembling at 0.08 mu/s".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let joints = if self.engine == EngineKind::Rapier { " with multibody joints" } else { "" };
        write!(
            f,
            "on {}{joints}, {} steps a second, {} substeps: \
             on the job's own setting the robot keeps trembling at {:.2} mu/s",
            self.engine, self.physics.steps_per_second, self.physics.substeps, self.trembling
        )
    }
}

/// Settles a robot on the setting of its rollouts, or on a quiet setting if the robot trembles there.
///
/// # Errors
/// If the simulation is unstable, or the robot comes to rest on neither setting.
pub fn settle_quietly(kind: EngineKind, robot: &Robot, physics: &Physics) -> Result<Settled, Unsettled> {
    settle_quietly_until(kind, robot, physics, &|| false)
}

/// Settles a robot as [`settle_quietly`] does. Returns [`Unsettled::Stopped`] once `stop` returns true.
pub fn settle_quietly_until(
    kind: EngineKind,
    robot: &Robot,
    physics: &Physics,
    stop: &dyn Fn() -> bool,
) -> Result<Settled, Unsettled> {
    match settle_until(engine(kind), robot, physics, stop) {
        Ok(state) => Ok(Settled { state, quiet: None }),
        Err(Unsettled::Moving { speed, .. }) => {
            let quiet = Quiet::of(robot, physics, speed);
            let state = settle_still(engine(quiet.engine), robot, &quiet.physics, stop)?;
            Ok(Settled { state, quiet: Some(quiet) })
        }
        Err(broken) => Err(broken),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exchange;
    use crate::physics::Scale;

    /// A block has an arm at its upper edge. Only damping holds the arm, so it sinks for half a minute.
    #[test]
    fn slowly_turning_joint_is_not_at_rest() {
        let xml = r#"<mujoco model="arm"><worldbody><body name="root" pos="0 0 2"><freejoint/>
            <geom type="box" size="0.5 0.5 1" mass="9"/>
            <body name="a" pos="0.5 0 0.9"><joint name="j" axis="0 1 0" range="-90 90"/>
            <geom type="box" size="1 0.1 0.1" pos="1.1 0 0" mass="1"/></body></body></worldbody></mujoco>"#;
        let robot = Robot::compile(&exchange::read(xml).unwrap().robot).unwrap();
        for damping in [150.0, 200.0, 300.0] {
            let physics = Physics { stiffness: 0.0, damping, ..Physics::of_scale(Scale::Paper) };
            let quiet = Quiet::of(&robot, &physics, 0.0);
            let found = settle_still(engine(quiet.engine), &robot, &quiet.physics, &|| false);
            assert!(matches!(found, Err(Unsettled::Moving { .. })), "{damping}: {found:?}");
        }
        let physics = Physics::of_scale(Scale::Paper);
        let quiet = Quiet::of(&robot, &physics, 0.0);
        settle_still(engine(quiet.engine), &robot, &quiet.physics, &|| false).unwrap();
    }
}
