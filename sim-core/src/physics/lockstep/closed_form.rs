//! Tests of the engine against closed forms, in worlds that a rollout can't be requested for: with velocities, without
//! motors, on slopes.

use super::contact::{Corners, Surface};
use super::inertia::{Composite, Inertia};
use super::kinematics::{Motion, Spatial};
use super::lanes::{V3, all};
use super::model::Model;
use super::step::Stepper;
use super::terrain::Layer;
use super::tests::{at, gaits, physics, robot};
use super::uneven::Uneven;
use crate::base::math::Vector;
use crate::base::random::{Purpose, Stream};
use crate::base::simd::{Level, at_level};
use crate::model::{QUARTER_TURNS, Robot, RobotSpec, State};
use crate::physics::Physics;
use fearless_simd::prelude::*;

/// Mass, edge and length of an arm: a cube of 0.5 kg and edge 0.48 mu, its centre 0.25 mu from the axis.
const ARM: (f32, f32, f32) = (0.5, 0.48, 0.25);

fn arm_inertia() -> f32 {
    let (mass, edge, length) = ARM;
    mass * edge * edge / 6.0 + mass * length * length
}

/// Returns a robot with an arm that hangs down from the side of a heavy block on the ground. The arm's axis is along y.
fn swing() -> Robot {
    let (mass, edge, length) = ARM;
    let (half, own) = (edge / 2.0, mass * edge * edge / 6.0);
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
        hinge = {{ name = "axis", parent = "block", anchor = [1.8, 0.0, 1.0], axis = [0.0, 1.0, 0.0] }}
        mass = {mass}
        center_of_mass = [0.0, 0.0, -{length}]
        inertia = [{own}, {own}, {own}, 0.0, 0.0, 0.0]
        [[body.box]]
        center = [0.0, 0.0, -{length}]
        half = [{half}, {half}, {half}]
        "#
    );
    Robot::compile(&toml::from_str::<RobotSpec>(&text).unwrap()).unwrap()
}

/// World with one robot, independent of the kind of lanes.
pub(super) trait World {
    fn step(&mut self);
    /// Sets the joint targets, rad.
    fn tell(&mut self, targets: &[f32]);
    /// Sets the base's linear velocity.
    fn push(&mut self, velocity: Vector);
    /// Sets the base's angular velocity and the rates of the hinges.
    fn turn(&mut self, velocity: Vector, rates: &[f32]);
    fn place(&self) -> Vector;
    /// Returns the base's linear velocity.
    fn velocity(&self) -> Vector;
    fn angles(&self) -> Vec<f32>;
    /// Returns the kinetic energy.
    fn energy(&mut self) -> f32;
    /// Returns the linear momentum, and the moment of momentum about the base's origin.
    fn momenta(&mut self) -> (Vector, Vector);
    /// Returns the length of a step, s.
    fn dt(&self) -> f32;
}

fn world<'a>(model: &'a Model, start: &State) -> Box<dyn World + 'a> {
    at_level!(Level::new(), simd => in_lanes(simd, model, Corners::new(model), start))
}

/// Creates a world with blocks on the ground.
pub(super) fn world_on<'a>(model: &'a Model, layers: &'a [Layer], start: &State) -> Box<dyn World + 'a> {
    at_level!(Level::new(), simd => in_lanes(simd, model, Uneven::new(layers), start))
}

pub(super) fn seconds(world: &mut dyn World, time: f32) {
    for _ in 0..(time / world.dt()).round() as u32 {
        world.step();
    }
}

struct InLanes<'a, S: Simd, G: Surface<S>> {
    simd: S,
    model: &'a Model,
    stepper: Stepper<'a, S, G>,
    motion: Motion<S>,
    targets: Vec<S::f32s>,
}

fn in_lanes<'a, S: Simd, G: Surface<S> + 'a>(
    simd: S,
    model: &'a Model,
    ground: G,
    start: &State,
) -> Box<dyn World + 'a> {
    let targets = vec![all(simd, 0.0); model.hinges.len()];
    Box::new(InLanes { simd, model, stepper: Stepper::new(simd, model, ground), motion: at(simd, start), targets })
}

fn first<S: Simd>(v: V3<S>) -> Vector {
    Vector::new(v.x[0], v.y[0], v.z[0])
}

impl<S: Simd, G: Surface<S>> World for InLanes<'_, S, G> {
    fn step(&mut self) {
        self.stepper.place(&self.motion);
        self.stepper.step(&mut self.motion, &self.targets);
    }

    fn tell(&mut self, targets: &[f32]) {
        self.targets = targets.iter().map(|t| all(self.simd, *t)).collect();
    }

    fn push(&mut self, velocity: Vector) {
        self.motion.velocity.base.l = V3::all(self.simd, velocity);
    }

    fn turn(&mut self, velocity: Vector, rates: &[f32]) {
        self.motion.velocity.base.a = V3::all(self.simd, velocity);
        self.motion.velocity.rates = rates.iter().map(|r| all(self.simd, *r)).collect();
    }

    fn place(&self) -> Vector {
        first(self.motion.position)
    }

    fn velocity(&self) -> Vector {
        first(self.motion.velocity.base.l)
    }

    fn angles(&self) -> Vec<f32> {
        self.motion.angles.iter().map(|a| a[0]).collect()
    }

    fn energy(&mut self) -> f32 {
        self.stepper.place(&self.motion);
        self.stepper.measure(&self.motion);
        self.stepper.energy[0]
    }

    fn momenta(&mut self) -> (Vector, Vector) {
        self.stepper.place(&self.motion);
        let mut motions = vec![Spatial::zero(self.simd); self.model.bodies.len()];
        self.stepper.frames.velocities(self.model, &self.motion.velocity, &mut motions);
        let mut sum = Spatial::zero(self.simd);
        for (b, link) in self.model.bodies.iter().enumerate() {
            sum = sum.add(Inertia::of_body(self.simd, link, &self.stepper.frames, b).times(motions[b]));
        }
        (first(sum.l), first(sum.a))
    }

    fn dt(&self) -> f32 {
        self.model.dt
    }
}

fn tilted(model: &mut Model, gravity: f32, angle: f32) {
    model.gravity = gravity * Vector::new(libm::sinf(angle), 0.0, -libm::cosf(angle));
}

fn lifted(robot: &Robot, height: f32) -> State {
    let mut start = robot.neutral();
    start.pivot.translation.z += height;
    start
}

/// The period of small swings of a physical pendulum is 2π √(I / (m g d)) (1 + θ² / 16).
#[test]
fn unpowered_hinge_swings_with_pendulum_period() {
    let robot = swing();
    let physics = Physics { stiffness: 0.0, damping: 0.0, max_torque: 0.0, ..physics() };
    let model = Model::new(&robot, &physics);
    let mut start = robot.neutral();
    start.joints[0] = 0.2;
    let mut world = world(&model, &start);
    let (mass, _, length) = ARM;
    let small = std::f32::consts::TAU * (arm_inertia() / (mass * physics.gravity * length)).sqrt();
    let expected = small * (1.0 + 0.2 * 0.2 / 16.0);
    let mut crossings = Vec::new();
    let mut before = start.joints[0];
    for step in 1..=(20.0 * expected / model.dt) as u32 {
        world.step();
        let angle = world.angles()[0];
        if before < 0.0 && angle >= 0.0 {
            crossings.push((step as f32 - angle / (angle - before)) * model.dt);
        }
        before = angle;
    }
    let turns = crossings.len() - 1;
    let period = (crossings[turns] - crossings[0]) / turns as f32;
    assert!((period - expected).abs() < 0.01 * expected, "{period} s against {expected} s");
}

/// Without load and far from its target, a motor accelerates its joint by torque / inertia.
#[test]
fn motor_at_limit_gives_its_torque() {
    let robot = swing();
    let physics = Physics { gravity: 0.0, stiffness: 1e5, damping: 0.0, max_torque: 0.1, ..physics() };
    let model = Model::new(&robot, &physics);
    let mut world = world(&model, &lifted(&robot, 20.0));
    world.tell(&[1.5]);
    seconds(&mut *world, 0.5);
    let expected = 0.5 * 0.1 / arm_inertia() * 0.25;
    let angle = world.angles()[0];
    // The first step already moves the joint: half a step more than the parabola, 1 % of it. The block moves a little
    // too.
    assert!((angle - expected).abs() < 0.02 * expected, "{angle} rad against {expected} rad");
}

#[test]
fn joint_stops_at_limit_in_both_directions() {
    let robot = swing();
    let physics = Physics { gravity: 0.0, ..physics() };
    let model = Model::new(&robot, &physics);
    for side in [2.5, -2.5] {
        let mut world = world(&model, &lifted(&robot, 20.0));
        world.tell(&[side]);
        let mut farthest = 0.0_f32;
        for _ in 0..600 {
            world.step();
            farthest = farthest.max(world.angles()[0].abs());
        }
        let angle = world.angles()[0].abs();
        assert!((angle - QUARTER_TURNS[1]).abs() < 0.05, "{angle} rad");
        assert!(farthest < QUARTER_TURNS[1] + 0.1, "{farthest} rad on the way");
    }
}

/// No external force acts on a robot in free flight, so its momenta are constant. Without motors its energy is constant
/// too.
#[test]
fn free_flight_keeps_momenta_and_energy() {
    for name in ["quadropod", "lizard"] {
        let robot = robot(name);
        let physics = Physics { gravity: 0.0, stiffness: 0.0, damping: 0.0, max_torque: 0.0, ..physics() };
        let model = Model::new(&robot, &physics);
        let mass: f32 = model.bodies.iter().map(|b| b.mass).sum();
        let mut stream = Stream::new(5, Purpose::Sample, 0, 0, 0);
        let mut draw = |spread: f64| stream.uniform(-spread, spread) as f32;
        let mut world = world(&model, &lifted(&robot, 20.0));
        let rates: Vec<f32> = model.hinges.iter().map(|_| draw(0.5)).collect();
        world.turn(Vector::new(draw(0.5), draw(0.5), draw(0.5)), &rates);
        // The whole robot gets a velocity that stops its centre of mass. Then moments do not depend on the point they
        // are about.
        let (linear, _) = world.momenta();
        world.push(-linear / mass);
        let (_, before) = world.momenta();
        let energy = world.energy();
        seconds(&mut *world, 2.0);
        let (linear, after) = world.momenta();
        let drift = world.energy() / energy - 1.0;
        assert!(linear.length() < 0.01 * before.length(), "{name}: linear momentum {linear}");
        assert!((after - before).length() < 0.02 * before.length(), "{name}: moment {before}, then {after}");
        assert!(drift.abs() < 0.03, "{name}: energy changes by {drift}");
    }
}

#[test]
fn sliding_robot_brakes_by_friction_in_every_direction() {
    let robot = robot("quadropod");
    let model = Model::new(&robot, &physics());
    for (x, y) in [(3.0, 0.0), (0.0, -3.0), (2.0, 2.0)] {
        let mut world = world(&model, &robot.neutral());
        seconds(&mut *world, 1.0);
        world.push(Vector::new(x, y, 0.0));
        let speed = |world: &dyn World| world.velocity().truncate().length();
        seconds(&mut *world, 0.05);
        let before = speed(&*world);
        seconds(&mut *world, 0.2);
        let deceleration = (before - speed(&*world)) / 0.2;
        let expected = model.friction * -model.gravity.z;
        assert!((deceleration - expected).abs() < 0.02 * expected, "{deceleration} against {expected}");
    }
}

/// On a slope below the friction angle a robot stays, apart from the creep of regularised friction. At the share s of
/// the friction limit the creep is v_s · s / √(1 − s²).
#[test]
fn robot_creeps_on_gentle_slope_by_regularised_friction() {
    let robot = robot("quadropod");
    let mut model = Model::new(&robot, &physics());
    for share in [0.3_f32, 0.5, 0.8] {
        let angle = libm::atanf(share * model.friction);
        tilted(&mut model, 9.81, angle);
        let mut world = world(&model, &robot.neutral());
        seconds(&mut *world, 2.0);
        let from = world.place();
        seconds(&mut *world, 2.0);
        let speed = (world.place() - from).length() / 2.0;
        let expected = model.contact.slip * share / (1.0 - share * share).sqrt();
        assert!((speed - expected).abs() < 0.1 * expected + 1e-4, "at {share}: {speed} mu/s against {expected}");
    }
}

/// On a steep slope a robot slides with the acceleration g (sin − μ cos).
#[test]
fn robot_slides_down_steep_slope_by_friction() {
    let robot = robot("quadropod");
    let mut model = Model::new(&robot, &physics());
    let angle = libm::atanf(1.3 * model.friction);
    tilted(&mut model, 9.81, angle);
    let mut world = world(&model, &robot.neutral());
    seconds(&mut *world, 0.5);
    let from = world.velocity().x;
    seconds(&mut *world, 0.5);
    let acceleration = (world.velocity().x - from) / 0.5;
    let expected = 9.81 * (libm::sinf(angle) - model.friction * libm::cosf(angle));
    assert!((acceleration - expected).abs() < 0.05 * expected, "{acceleration} mu/s² against {expected} mu/s²");
}

/// Friction at a contact is at most μ times the ground's normal force there. The normal force is that of the previous
/// linearisation, so friction exceeds its cone a little: by 8.7, 2.5 and 2.1 % of the greatest friction, with one, two
/// and three linearisations.
#[test]
fn contact_friction_stays_near_its_cone() {
    for (iterations, most) in [(1, 0.1), (2, 0.03), (3, 0.025)] {
        let beyond = at_level!(Level::new(), simd => beyond_the_cone(simd, iterations));
        assert!(beyond < most, "{iterations} linearisations: friction exceeds its limit by a share of {beyond}");
    }
}

/// Returns the friction beyond its limit as a share of the limit, over all contacts of ten gaits.
fn beyond_the_cone<S: Simd>(simd: S, iterations: u32) -> f32 {
    let robot = robot("quadropod");
    let model = Model::new(&robot, &Physics { substeps: iterations, ..physics() });
    let (mut limit, mut beyond) = (0.0, 0.0);
    for table in gaits(&robot, 10, 5.0) {
        let mut stepper = Stepper::new(simd, &model, Corners::new(&model));
        let mut motion = at(simd, &robot.neutral());
        let mut row = vec![0.0; model.hinges.len()];
        for step in 1..=1000 {
            table.targets().at(f64::from(step) * f64::from(model.dt), &mut row);
            let targets: Vec<_> = row.iter().map(|t| all(simd, *t)).collect();
            stepper.place(&motion);
            stepper.step(&mut motion, &targets);
            for (carried, held) in stepper.corner_forces(&motion.velocity) {
                limit += model.friction * carried;
                beyond += (held - model.friction * carried).max(0.0);
            }
        }
    }
    beyond / limit
}

/// A load on the back of another body sinks in until the contact's spring carries its weight.
#[test]
fn body_rests_on_top_of_other_body() {
    let text = r#"
        name = "stack"
        pivot = "block"
        [[body]]
        name = "block"
        mass = 4.0
        inertia = [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
        [[body.box]]
        half = [1.0, 0.5, 0.5]
        [[body]]
        name = "link"
        hinge = { name = "shoulder", parent = "block", anchor = [-1.3, 0.0, 0.5], axis = [0.0, 1.0, 0.0] }
        mass = 0.1
        inertia = [0.01, 0.01, 0.01, 0.0, 0.0, 0.0]
        [[body]]
        name = "load"
        hinge = { name = "wrist", parent = "link", anchor = [0.0, 0.0, 0.0], axis = [0.0, 1.0, 0.0] }
        mass = 1.0
        center_of_mass = [1.3, 0.0, 0.3]
        inertia = [0.1, 0.1, 0.1, 0.0, 0.0, 0.0]
        [[body.box]]
        center = [1.3, 0.0, 0.3]
        half = [0.25, 0.25, 0.25]
        "#;
    let robot = Robot::compile(&toml::from_str::<RobotSpec>(text).unwrap()).unwrap();
    // Both hinges are loose and share one axis. The load turns down onto the block, with which it shares no hinge.
    let physics = Physics { stiffness: 0.0, damping: 0.01, max_torque: 0.0, ..physics() };
    let model = Model::new(&robot, &physics);
    let mut start = robot.neutral();
    start.joints[1] = -0.02;
    let mut world = world(&model, &start);
    seconds(&mut *world, 4.0);
    let energy = world.energy();
    let poses = robot.body_poses(&State::new(start.pivot, world.angles()));
    let load = poses[2] * Vector::new(1.3, 0.0, 0.3) - poses[0].translation;
    let top = 0.5 + 0.25;
    assert!(energy < 1e-3, "the robot has {energy} kg·mu²/s² left");
    assert!(load.z > top - 0.02 && load.z < top + 0.02, "the load's centre is {} mu above the block's", load.z);
}
