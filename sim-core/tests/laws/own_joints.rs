//! Tests of joints with own limits, speed and torque: closed forms, on every engine and kind of joint.

use sim_core::engines::engine;
use sim_core::model::{Robot, RobotSpec};
use sim_core::physics::{EngineKind, JointKind, Outcome, Physics, Request, Scale, TICK, Targets};

/// Mass of the arm, a cube of edge 0.48 mu, kg.
const MASS: f32 = 0.5;
/// Distance of the arm's centre from the axis, mu.
const LENGTH: f32 = 0.25;

/// An arm that hangs down from the side of a heavy block on the ground, with its axis along y. `own`: further keys of
/// its hinge.
fn swing(own: &str) -> Robot {
    let inertia = MASS * 0.48 * 0.48 / 6.0;
    let text = format!(
        r#"
        name = "swing"
        pivot = "block"
        [[body]]
        name = "block"
        mass = 100.0
        inertia = [150.0, 150.0, 150.0, 0.0, 0.0, 0.0]
        [[body.box]]
        half = [1.5, 1.5, 1.5]
        [[body]]
        name = "arm"
        hinge = {{ name = "axis", parent = "block", anchor = [1.8, 0.0, 1.0], axis = [0.0, 1.0, 0.0]{own} }}
        mass = {MASS}
        center_of_mass = [0.0, 0.0, -{LENGTH}]
        inertia = [{inertia}, {inertia}, {inertia}, 0.0, 0.0, 0.0]
        [[body.box]]
        center = [0.0, 0.0, -{LENGTH}]
        half = [0.24, 0.24, 0.24]
        "#
    );
    Robot::compile(&toml::from_str::<RobotSpec>(&text).unwrap()).unwrap()
}

fn engines() -> [(EngineKind, Physics); 3] {
    let rapier = |joints| Physics { joints, ..Physics::of(EngineKind::Rapier, Scale::Paper) };
    [
        (EngineKind::Rapier, rapier(JointKind::Impulse)),
        (EngineKind::Rapier, rapier(JointKind::Multibody)),
        (EngineKind::Lockstep, Physics::of(EngineKind::Lockstep, Scale::Paper)),
    ]
}

/// Returns the joint's angle after the motion, rad. The motion starts at rest at the angle `from`.
fn reached(kind: EngineKind, physics: &Physics, robot: &Robot, from: f32, targets: &Targets) -> f32 {
    let mut start = robot.neutral();
    start.joints[0] = from;
    let motion = &targets.clone().into();
    let rollout = engine(kind).run(robot, physics, &[], &[Request { start: &start, motion }]).swap_remove(0);
    assert_eq!(rollout.outcome, Outcome::Completed, "{kind:?}");
    rollout.end.joints[0]
}

fn constant(target: f64) -> Targets {
    Targets::new(&[vec![target; Targets::ticks(2.0)]], 2.0)
}

#[test]
fn joint_driven_beyond_its_limits_stops_at_them() {
    let robot = swing(", limits = [-0.3, 0.5]");
    for (kind, physics) in engines() {
        for (target, expected) in [(-2.5, -0.3), (2.5, 0.5)] {
            let angle = reached(kind, &physics, &robot, 0.0, &constant(target));
            assert!((angle - expected).abs() < 0.05, "{kind:?} {:?}: {angle} rad", physics.joints);
        }
    }
}

/// A motor that is too weak to lift the arm holds it at the angle θ where m g d sin θ equals its torque. The job's
/// motor lifts the arm to the target.
#[test]
fn weak_joint_stalls_where_load_equals_torque() {
    for (kind, physics) in engines() {
        let stalled = 0.5;
        let torque = MASS * physics.gravity * LENGTH * libm::sinf(stalled);
        let angle = reached(kind, &physics, &swing(&format!(", torque = {torque}")), stalled, &constant(1.4));
        assert!((angle - stalled).abs() < 0.03, "{kind:?} {:?}: {angle} rad", physics.joints);
        let angle = reached(kind, &physics, &swing(""), stalled, &constant(1.4));
        assert!((angle - 1.4).abs() < 0.06, "{kind:?} {:?}: {angle} rad", physics.joints);
    }
}

/// At 0.8 rad/s a step of 1 rad takes 1.25 s. Until then the angle is speed times time.
#[test]
fn greatest_speed_turns_step_into_ramp() {
    let robot = swing(", speed = 0.8");
    for (kind, physics) in engines() {
        for (duration, expected) in [(0.5, 0.4), (1.0, 0.8), (1.25, 1.0), (2.0, 1.0)] {
            let signal: Vec<f64> = (0..Targets::ticks(duration)).map(|t| f64::from(t > 0)).collect();
            let targets = Targets::new(&[signal], duration).within(&robot.hinges, None);
            let angle = reached(kind, &physics, &robot, 0.0, &targets);
            assert!((angle - expected).abs() < 0.06, "{kind:?} {:?} at {duration} s: {angle} rad", physics.joints);
        }
    }
}

#[test]
fn targets_within_limits_keep_their_bits() {
    let robot = swing(", limits = [-1.0, 1.0], speed = 10.0");
    let signal: Vec<f64> = (0..Targets::ticks(2.0)).map(|t| 0.9 * libm::sin(4.0 * TICK * t as f64)).collect();
    let free = Targets::new(&[signal], 2.0);
    assert_eq!(free.clone().within(&robot.hinges, None), free);
    assert_ne!(free.clone().within(&swing(", limits = [-1.0, 0.8]").hinges, None), free);
    assert_ne!(free.clone().within(&swing(", speed = 3.0").hinges, None), free);
}
