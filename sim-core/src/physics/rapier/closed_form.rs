//! Tests of the physics against closed forms, with both kinds of joint, in worlds that a rollout can't be requested
//! for: with velocities, without motors, with a fixed pivot.

use super::*;
use crate::model::{QUARTER_TURNS, RobotSpec};
use crate::physics::{JointKind, Targets};
use rapier3d::dynamics::RigidBodyType;

/// Returns a cube that holds a module by its back; `pose` turns the whole robot.
fn swing(pose: &str) -> Robot {
    let text = format!(
        r#"
        name = "swing"
        pivot = "base"
        [[module]]
        name = "base"
        kind = "block"
        pose = {pose}
        [[module]]
        name = "arm"
        kind = "cosmo"
        attach = {{ to = "base", port = "front" }}
        "#
    );
    Robot::compile(&toml::from_str::<RobotSpec>(&text).unwrap()).unwrap()
}

/// Kinds of joint; every test runs with both.
const KINDS: [JointKind; 2] = [JointKind::Impulse, JointKind::Multibody];

fn physics(joints: JointKind) -> Physics {
    Physics { steps_per_second: 240, substeps: 8, joints, ..Physics::of_scale(crate::physics::Scale::Paper) }
}

fn simulation<'a>(robot: &'a Robot, physics: &'a Physics, start: &State) -> Simulation<'a> {
    let motion = Motion::standing(robot.hinges.len(), 1.0);
    Simulation::new(robot, physics, &[], &Request { start, motion: &motion })
}

impl Simulation<'_> {
    fn hold_pivot(&mut self) {
        self.world.bodies[self.bodies[0]].set_body_type(RigidBodyType::Fixed, true);
    }

    /// Sets the velocity of the whole robot, mu/s.
    fn push(&mut self, velocity: Vector) {
        for handle in self.bodies.clone() {
            self.world.bodies[handle].set_linvel(velocity, true);
        }
        // A multibody has its own velocities, first those of its free pivot.
        if let Joints::Multibody(handles) = &self.joints {
            let (multibody, _) = self.world.multibody_joints.get_mut(handles[0]).unwrap();
            multibody.generalized_velocity_mut().rows_mut(0, 3).copy_from_slice(&velocity.to_array());
        }
    }

    /// Turns the whole robot about the pivot's z, rad/s.
    fn turn(&mut self, speed: f32) {
        let pivot = self.world.bodies[self.bodies[0]].translation();
        for handle in self.bodies.clone() {
            let body = &mut self.world.bodies[handle];
            let turn = Vector::new(0.0, 0.0, speed);
            body.set_linvel(turn.cross(body.center_of_mass() - pivot), true);
            body.set_angvel(turn, true);
        }
        if let Joints::Multibody(handles) = &self.joints {
            let (multibody, _) = self.world.multibody_joints.get_mut(handles[0]).unwrap();
            multibody.generalized_velocity_mut()[5] = speed;
        }
    }

    fn steps(&mut self, seconds: f32) {
        for _ in 0..(seconds * self.physics.steps_per_second as f32).round() as u32 {
            self.world.step();
        }
    }
}

fn lifted(robot: &Robot, height: f32) -> State {
    let mut start = robot.neutral();
    start.pivot.translation.z += height;
    start
}

/// z = z₀ − g t² / 2. Semi-implicit Euler falls g t h / 2 further; h is the substep.
#[test]
fn robot_in_air_falls_freely() {
    for joints in KINDS {
        let (robot, physics) = (swing("{}"), physics(joints));
        let start = lifted(&robot, 50.0);
        let mut world = simulation(&robot, &physics, &start);
        world.steps(2.0);
        let fallen = start.pivot.translation.z - world.state().pivot.translation.z;
        let substep = 1.0 / (physics.steps_per_second * physics.substeps) as f32;
        let expected = 0.5 * physics.gravity * 4.0 + 0.5 * physics.gravity * 2.0 * substep;
        assert!((fallen - expected).abs() < 2e-3 * expected, "{joints:?}: {fallen} against {expected}");
    }
}

/// A sliding body stops after v² / (2 μ g). In rapier, contacts use a part of their friction against each other, so the
/// robot is braked 4 % less.
#[test]
fn sliding_robot_is_braked_by_friction() {
    for joints in KINDS {
        let (robot, physics) = (swing("{}"), Physics { friction: 0.4, ..physics(joints) });
        let mut world = simulation(&robot, &physics, &robot.neutral());
        world.steps(1.0);
        let from = world.state().pivot.translation.x;
        world.push(Vector::new(3.0, 0.0, 0.0));
        world.steps(2.0);
        let way = world.state().pivot.translation.x - from;
        let expected = 3.0 * 3.0 / (2.0 * 0.4 * physics.gravity);
        assert!((way - expected).abs() < 0.06 * expected, "{joints:?}: {way} against {expected}");
    }
}

/// The period of small swings of a physical pendulum is 2π √(I / (m g d)) (1 + θ² / 16).
#[test]
fn unpowered_hinge_swings_with_pendulum_period() {
    for joints in KINDS {
        // Turned so that the arm hangs straight down and its hinge is horizontal.
        let robot = swing("{ rotation = [0, 90, 0] }");
        let physics = Physics { stiffness: 0.0, damping: 0.0, max_torque: 0.0, ..physics(joints) };
        let mut start = lifted(&robot, 20.0);
        start.joints[0] = 0.2;
        let mut world = simulation(&robot, &physics, &start);
        world.hold_pivot();
        // The swinging cube: 0.5 kg, edge 0.48 mu, centre 0.25 mu from the axis.
        let (mass, edge, arm) = (0.5f32, 0.48f32, 0.25f32);
        let inertia = mass * edge * edge / 6.0 + mass * arm * arm;
        let small = std::f32::consts::TAU * (inertia / (mass * physics.gravity * arm)).sqrt();
        let expected = small * (1.0 + 0.2 * 0.2 / 16.0);
        let dt = 1.0 / physics.steps_per_second as f32;
        let mut crossings = Vec::new();
        let mut before = start.joints[0];
        for step in 1..=(20.0 * expected / dt) as u32 {
            world.world.step();
            let angle = world.state().joints[0];
            if before < 0.0 && angle >= 0.0 {
                crossings.push((step as f32 - angle / (angle - before)) * dt);
            }
            before = angle;
        }
        let turns = crossings.len() - 1;
        let period = (crossings[turns] - crossings[0]) / turns as f32;
        assert!((period - expected).abs() < 0.01 * expected, "{joints:?}: {period} s against {expected} s");
    }
}

/// Without load and far from its target, a motor accelerates its joint by torque / inertia.
#[test]
fn motor_at_limit_gives_its_torque() {
    for joints in KINDS {
        let robot = swing("{}");
        let physics = Physics { gravity: 0.0, stiffness: 1e5, damping: 0.0, max_torque: 0.1, ..physics(joints) };
        let start = lifted(&robot, 20.0);
        let mut world = simulation(&robot, &physics, &start);
        world.hold_pivot();
        world.set_targets(&[1.5]);
        world.steps(0.5);
        let (mass, edge, arm) = (0.5f32, 0.48f32, 0.25f32);
        let inertia = mass * edge * edge / 6.0 + mass * arm * arm;
        let expected = 0.5 * 0.1 / inertia * 0.25;
        let angle = world.state().joints[0];
        assert!((angle - expected).abs() < 0.01 * expected, "{joints:?}: {angle} rad against {expected} rad");
    }
}

/// A joint pressed against its limit stays there.
#[test]
fn joint_stops_at_limit() {
    for joints in KINDS {
        let robot = swing("{}");
        let physics = Physics { gravity: 0.0, ..physics(joints) };
        let mut world = simulation(&robot, &physics, &lifted(&robot, 20.0));
        world.hold_pivot();
        world.set_targets(&[2.5]);
        world.steps(3.0);
        let angle = world.state().joints[0];
        assert!((angle - QUARTER_TURNS[1]).abs() < 0.05, "{joints:?}: {angle} rad");
    }
}

/// A robot is placed in the world at its start, joint angles included, and the same state is read back.
#[test]
fn robot_starts_in_given_configuration() {
    for joints in KINDS {
        let entry = &crate::model::catalogue::robots()[0];
        let robot = Robot::compile(&toml::from_str::<RobotSpec>(entry.toml).unwrap()).unwrap();
        let physics = physics(joints);
        let mut start = lifted(&robot, 5.0);
        for (i, angle) in start.joints.iter_mut().enumerate() {
            *angle = 0.1 * i as f32 - 0.3;
        }
        let world = simulation(&robot, &physics, &start);
        let state = world.state();
        assert_eq!(state.pivot, start.pivot);
        for (read, given) in state.joints.iter().zip(&start.joints) {
            assert!((read - given).abs() < 1e-6, "{joints:?}: {read} rad against {given} rad");
        }
        for (body, pose) in world.bodies.iter().zip(robot.body_poses(&start)) {
            let stands = world.world.bodies[*body].position();
            assert!((stands.translation - pose.translation).length() < 1e-5, "{joints:?}");
            assert!(crate::base::math::angle_between(stands.rotation, pose.rotation) < 1e-5, "{joints:?}");
        }
    }
}

/// A robot in the air is not braked: with its joints held it keeps turning. The default damping of multibodies would
/// also act on the free pivot, and stop it.
#[test]
fn free_robot_keeps_turning() {
    for joints in KINDS {
        let (robot, physics) = (swing("{}"), Physics { gravity: 0.0, ..physics(joints) });
        let mut world = simulation(&robot, &physics, &lifted(&robot, 20.0));
        // The turn is about z, which is the axis of the arm's hinge or lies across it. So the motor has only the
        // centrifugal load.
        world.turn(1.0);
        world.steps(1.0);
        let turned = crate::base::math::heading(world.state().pivot.rotation);
        assert!((turned - 1.0).abs() < 0.02, "{joints:?}: {turned} rad");
    }
}

/// Both kinds of joint solve the same equations: finely stepped, a robot ends at the same place with either.
#[test]
fn joint_kinds_agree_in_fine_steps() {
    let entry = &crate::model::catalogue::robots()[0];
    let robot = Robot::compile(&toml::from_str::<RobotSpec>(entry.toml).unwrap()).unwrap();
    let joints = robot.hinges.len();
    // In the air, because contacts multiply every difference.
    let start = lifted(&robot, 50.0);
    let ramp = |i: usize| (0..=100).map(move |t| (0.1 + 0.05 * i as f64) * (f64::from(t) / 50.0 - 1.0)).collect();
    let motion = Motion::from(Targets::new(&(0..joints).map(ramp).collect::<Vec<_>>(), 0.5));
    let end = |joints: JointKind| {
        let physics = Physics { steps_per_second: 480, substeps: 16, joints, ..physics(joints) };
        let request = Request { start: &start, motion: &motion };
        RapierEngine.run(&robot, &physics, &[], &[request]).swap_remove(0).end
    };
    let (impulse, multibody) = (end(JointKind::Impulse), end(JointKind::Multibody));
    let apart = (impulse.pivot.translation - multibody.pivot.translation).length();
    assert!(apart < 2e-3, "{apart} mu");
    let turned = crate::base::math::angle_between(impulse.pivot.rotation, multibody.pivot.rotation);
    assert!(turned < 2e-3, "{turned} rad");
    for (a, b) in impulse.joints.iter().zip(&multibody.joints) {
        assert!((a - b).abs() < 2e-3, "{a} rad against {b} rad");
    }
}
