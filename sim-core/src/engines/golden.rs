//! The golden rollout of a recorded robot and gait. With it an engine's digest follows from the engine alone, not from
//! a robot file, a controller or a random stream.

use super::engine;
use crate::model::Robot;
use crate::physics::{EngineKind, JointKind, Motion, Physics, Request, Scale, TICK, Targets};

/// Recorded robot: a body with four legs of two modules, eight hinges.
const ROBOT: &str = include_str!("golden/robot.toml");
/// Recorded joint targets, rad: one line per tick, one column per joint.
const TARGETS: &str = include_str!("golden/targets.txt");

/// Simulates the recorded gait, 2 s, with every kind of joint that the engine has. Returns the bits of the pivot's pose
/// and the joint angles at the end.
pub(super) fn golden_rollout(kind: EngineKind) -> Vec<u32> {
    let (robot, motion) = recorded();
    let start = robot.neutral();
    let request = Request { start: &start, motion: &motion };
    let bits = |joints: JointKind| {
        let physics = Physics { joints, ..Physics::of(kind, Scale::Paper) };
        let end = engine(kind).run(&robot, &physics, &[], &[request]).swap_remove(0).end;
        let (p, q) = (end.pivot.translation, end.pivot.rotation);
        [p.x, p.y, p.z, q.x, q.y, q.z, q.w].into_iter().chain(end.joints).map(f32::to_bits).collect::<Vec<_>>()
    };
    match kind {
        EngineKind::Rapier => [JointKind::Impulse, JointKind::Multibody].map(bits).concat(),
        EngineKind::Lockstep => bits(JointKind::default()),
    }
}

/// Returns the recorded robot and gait.
fn recorded() -> (Robot, Motion) {
    let spec = toml::from_str(ROBOT).expect("the recorded robot is valid");
    let robot = Robot::compile(&spec).expect("the recorded robot is valid");
    let mut signals = vec![Vec::new(); robot.hinges.len()];
    for line in TARGETS.lines() {
        for (signal, angle) in signals.iter_mut().zip(line.split(' ')) {
            signal.push(f64::from(angle.parse::<f32>().expect("the recorded targets are numbers")));
        }
    }
    let duration = TICK * (signals[0].len() - 1) as f64;
    let targets = Targets::new(&signals, duration).within(&robot.hinges, None);
    (robot, targets.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recorded_gait_moves_every_joint_for_2_s() {
        let (robot, motion) = recorded();
        let targets = motion.targets();
        assert_eq!((robot.hinges.len(), targets.joints(), targets.duration()), (8, 8, 2.0));
        let (mut first, mut last) = ([0.0; 8], [0.0; 8]);
        targets.at(0.0, &mut first);
        targets.at(2.0, &mut last);
        assert!(first.iter().zip(&last).all(|(a, b)| a != b), "{first:?} {last:?}");
    }
}
