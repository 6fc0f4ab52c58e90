//! The physics against closed forms, on worlds that a rollout can't be asked for: with velocities, without motors, with
//! the pivot held in place.

use super::*;
use crate::control::Targets;
use crate::robot::RobotSpec;
use rapier3d::dynamics::RigidBodyType;

/// A cube that holds a module by its back; `pose` turns the whole.
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

fn physics() -> Physics {
    Physics { steps_per_second: 240, substeps: 8, ..Physics::of_scale(crate::job::Scale::Paper) }
}

fn simulation<'a>(robot: &'a Robot, physics: &'a Physics, start: &State) -> Simulation<'a> {
    let targets = Targets::zero(robot.hinges.len(), 1.0);
    Simulation::new(robot, physics, &[], &Request { start, targets: &targets })
}

impl Simulation<'_> {
    fn hold_pivot(&mut self) {
        self.world.bodies[self.bodies[0]].set_body_type(RigidBodyType::Fixed, true);
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

/// z = z₀ − g t² / 2. Semi-implicit Euler falls g t h / 2 further, h the substep.
#[test]
fn a_robot_in_the_air_falls_freely() {
    let (robot, physics) = (swing("{}"), physics());
    let start = lifted(&robot, 50.0);
    let mut world = simulation(&robot, &physics, &start);
    world.steps(2.0);
    let fallen = start.pivot.translation.z - world.state().pivot.translation.z;
    let substep = 1.0 / (physics.steps_per_second * physics.substeps) as f32;
    let expected = 0.5 * physics.gravity * 4.0 + 0.5 * physics.gravity * 2.0 * substep;
    assert!((fallen - expected).abs() < 2e-3 * expected, "{fallen} against {expected}");
}

/// A sliding body stops after v² / (2 μ g). rapier's contacts hold a part of their friction against each other, so the
/// robot is braked 4 % less.
#[test]
fn a_sliding_robot_is_braked_by_friction() {
    let (robot, physics) = (swing("{}"), Physics { friction: 0.4, ..physics() });
    let mut world = simulation(&robot, &physics, &robot.neutral());
    world.steps(1.0);
    let from = world.state().pivot.translation.x;
    for handle in world.bodies.clone() {
        world.world.bodies[handle].set_linvel(Vector::new(3.0, 0.0, 0.0), true);
    }
    world.steps(2.0);
    let way = world.state().pivot.translation.x - from;
    let expected = 3.0 * 3.0 / (2.0 * 0.4 * physics.gravity);
    assert!((way - expected).abs() < 0.06 * expected, "{way} against {expected}");
}

/// Small swings of a physical pendulum take 2π √(I / (m g d)) (1 + θ² / 16).
#[test]
fn an_unpowered_hinge_swings_with_the_period_of_a_pendulum() {
    // Turned so that the arm hangs straight down and its hinge is horizontal.
    let robot = swing("{ rotation = [0, 90, 0] }");
    let physics = Physics { stiffness: 0.0, damping: 0.0, max_torque: 0.0, ..physics() };
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
    assert!((period - expected).abs() < 0.01 * expected, "{period} s against {expected} s");
}

/// Without load and far from its target, a motor turns its joint at torque / inertia.
#[test]
fn a_motor_at_its_limit_gives_its_torque_and_no_more() {
    let robot = swing("{}");
    let physics = Physics { gravity: 0.0, stiffness: 1e5, damping: 0.0, max_torque: 0.1, ..physics() };
    let start = lifted(&robot, 20.0);
    let mut world = simulation(&robot, &physics, &start);
    world.hold_pivot();
    world.set_targets(&[1.5]);
    world.steps(0.5);
    let (mass, edge, arm) = (0.5f32, 0.48f32, 0.25f32);
    let inertia = mass * edge * edge / 6.0 + mass * arm * arm;
    let expected = 0.5 * 0.1 / inertia * 0.25;
    let angle = world.state().joints[0];
    assert!((angle - expected).abs() < 0.01 * expected, "{angle} rad against {expected} rad");
}

/// A joint pressed against its limit stays there.
#[test]
fn a_joint_stops_at_its_limit() {
    let robot = swing("{}");
    let physics = Physics { gravity: 0.0, ..physics() };
    let mut world = simulation(&robot, &physics, &lifted(&robot, 20.0));
    world.hold_pivot();
    world.set_targets(&[2.5]);
    world.steps(3.0);
    let angle = world.state().joints[0];
    assert!((angle - JOINT_LIMIT).abs() < 0.05, "{angle} rad");
}
