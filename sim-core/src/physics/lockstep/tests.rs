//! Tests of the engine: equal bits, the mass matrix, contact between bodies.

use super::inertia::Composite;
use super::kinematics::{self, Frames, Spatial, Velocity};
use super::lanes::{Lanes, V3, all};
use super::model::Model;
use super::{Level, run_at};
use crate::base::random::{Purpose, Stream};
use crate::base::simd::{at_level, levels};
use crate::control::{Controller, Hopf, Run};
use crate::model::{Robot, State};
use crate::physics::{Motion, Outcome, Physics, Request, Rollout, Scale, Targets};
use fearless_simd::prelude::*;

pub(super) fn robot(name: &str) -> Robot {
    let entry = crate::model::catalogue::robots().iter().find(|r| r.name == name).unwrap();
    Robot::compile(&toml::from_str(entry.toml).unwrap()).unwrap()
}

pub(super) fn physics() -> Physics {
    Physics { steps_per_second: 200, substeps: 2, ..Physics::of_scale(Scale::Paper) }
}

pub(super) fn gaits(robot: &Robot, count: u32, duration: f64) -> Vec<Motion> {
    let gait = |c: u32| {
        let mut stream = Stream::new(0, Purpose::Sample, 0, c, 0);
        let mut parameters = Vec::new();
        for _ in 0..robot.hinges.len() {
            parameters.extend(Hopf.parameters().iter().map(|p| stream.uniform(p.bounds.0, p.bounds.1)));
        }
        Hopf.compile(&Run::new(robot, duration), &parameters).unwrap()
    };
    (0..count).map(gait).collect()
}

fn run(robot: &Robot, physics: &Physics, start: &State, tables: &[Motion]) -> Vec<Rollout> {
    let requests: Vec<Request<'_>> = tables.iter().map(|motion| Request { start, motion }).collect();
    run_at(Level::new(), robot, physics, &[], &requests)
}

/// Asserts equality of the text, which distinguishes zeros of different sign.
fn assert_same_bits(a: &[Rollout], b: &[Rollout], what: &str) {
    assert_eq!(format!("{a:?}"), format!("{b:?}"), "{what}");
}

#[test]
fn every_instruction_set_gives_the_same_bits() {
    for name in ["quadropod", "lizard"] {
        let robot = robot(name);
        let (start, tables) = (robot.neutral(), gaits(&robot, 3, 1.0));
        let requests: Vec<Request<'_>> = tables.iter().map(|motion| Request { start: &start, motion }).collect();
        let runs: Vec<Vec<Rollout>> =
            levels().into_iter().map(|level| run_at(level, &robot, &physics(), &[], &requests)).collect();
        for other in &runs[1..] {
            assert_same_bits(&runs[0], other, name);
        }
    }
}

#[test]
fn order_and_size_of_batch_change_no_bit() {
    let robot = robot("quadropod");
    let start = robot.neutral();
    let mut tables = gaits(&robot, 20, 2.0);
    tables.extend(gaits(&robot, 3, 1.0));
    let together = run(&robot, &physics(), &start, &tables);
    for (i, table) in tables.iter().enumerate() {
        let alone = run(&robot, &physics(), &start, std::slice::from_ref(table));
        assert_same_bits(&together[i..=i], &alone, "alone");
    }
    let reversed: Vec<Motion> = tables.iter().rev().cloned().collect();
    let mut back = run(&robot, &physics(), &start, &reversed);
    back.reverse();
    assert_same_bits(&together, &back, "in the other order");
}

#[test]
fn unstable_lane_is_reported_and_changes_no_other() {
    let robot = robot("quadropod");
    let start = robot.neutral();
    let tables = gaits(&robot, 4, 1.0);
    let sound = run(&robot, &physics(), &start, &tables);
    let mut broken = start.clone();
    broken.joints[0] = f32::NAN;
    let starts = [&start, &broken, &start, &start];
    let requests: Vec<Request<'_>> =
        starts.iter().zip(&tables).map(|(&start, motion)| Request { start, motion }).collect();
    let mixed = run_at(Level::new(), &robot, &physics(), &[], &requests);
    assert!(matches!(mixed[1].outcome, Outcome::Unstable { .. }));
    for i in [0, 2, 3] {
        assert_same_bits(&sound[i..=i], &mixed[i..=i], "beside a broken lane");
    }
}

#[test]
fn centre_of_mass_falls_freely_with_moving_legs() {
    let robot = robot("quadropod");
    let physics = physics();
    let mut start = robot.neutral();
    start.pivot.translation.z += 50.0;
    let tables = gaits(&robot, 2, 1.0);
    let center = |state: &State| {
        let poses = robot.body_poses(state);
        let mut sum = crate::base::math::Vector::ZERO;
        for (body, pose) in robot.bodies.iter().zip(&poses) {
            sum += *pose * body.center_of_mass * body.mass;
        }
        sum / robot.bodies.iter().map(|b| b.mass).sum::<f32>()
    };
    for rollout in run(&robot, &physics, &start, &tables) {
        let (n, dt) = (physics.steps(1.0) as f32, 1.0 / physics.steps_per_second as f32);
        let moved = center(&rollout.end) - center(&start);
        let fall = -0.5 * physics.gravity * dt * dt * n * (n + 1.0);
        assert!((moved.z - fall).abs() < 0.03, "{moved} against {fall}");
        assert!(moved.x.abs() < 0.03 && moved.y.abs() < 0.03, "{moved}");
        assert!(rollout.end.joints.iter().any(|a| a.abs() > 0.1), "the legs do not move");
    }
}

#[test]
fn robot_at_rest_does_not_move() {
    for name in ["quadropod", "lizard", "l-shape", "h-shape", "t-shape"] {
        let robot = robot(name);
        let start = robot.neutral();
        let rollout = run(&robot, &physics(), &start, &[Motion::standing(robot.hinges.len(), 5.0)]).remove(0);
        let moved = rollout.end.pivot.translation - start.pivot.translation;
        assert!(moved.length() < 0.005, "{name} moved by {moved}");
        assert!(rollout.end_speed < 1e-3, "{name} at {} mu/s", rollout.end_speed);
    }
}

#[test]
fn velocity_solved_from_momentum_is_the_original() {
    for name in ["quadropod", "lizard", "h-shape"] {
        at_level!(Level::new(), simd => momentum(simd, name));
    }
}

/// In free space, without motors, gravity and initial speed, an impulse J gives M v = J. So solving for the momentum of
/// a random motion, computed body by body, must give that motion.
fn momentum<S: Simd>(simd: S, name: &str) {
    let robot = robot(name);
    let model = Model::new(&robot, &physics());
    let mut stream = Stream::new(3, Purpose::Sample, 0, 0, 0);
    let mut draw = |spread: f64| {
        let mut lanes = all(simd, 0.0);
        for lane in 0..Lanes::<S>::LEN {
            lanes[lane] = stream.uniform(-spread, spread) as f32;
        }
        lanes
    };
    let mut motion = at(simd, &robot.neutral());
    for angle in &mut motion.angles {
        *angle = draw(1.2);
    }
    let mut vector = |spread| V3 { x: draw(spread), y: draw(spread), z: draw(spread) };
    let base = Spatial { a: vector(1.0), l: vector(1.0) };
    let rates: Vec<Lanes<S>> = (0..model.hinges.len()).map(|_| vector(1.0).x).collect();
    let velocity = Velocity { base, rates };

    let mut frames = Frames::new(simd, &model);
    frames.update(simd, &model, &motion);
    let mut motions = vec![Spatial::zero(simd); model.bodies.len()];
    frames.velocities(&model, &velocity, &mut motions);
    let mut inertias: Vec<_> =
        (0..model.bodies.len()).map(|b| super::inertia::Inertia::of_body(simd, &model.bodies[b], &frames, b)).collect();
    let mut carried: Vec<Spatial<S>> = inertias.iter().zip(&motions).map(|(i, v)| i.times(*v)).collect();
    let mut right = velocity.clone();
    for i in (0..model.hinges.len()).rev() {
        let wrench = carried[i + 1];
        right.rates[i] = frames.hinges[i].dot(wrench);
        let parent = model.hinges[i].parent;
        carried[parent] = carried[parent].add(wrench);
    }
    right.base = carried[0];
    let mut system = super::factor::System::new(simd, &model);
    system.assemble(simd, &model, &frames, &mut inertias);
    system.solve(simd, &model, &mut right);
    let close = |a: Lanes<S>, b: Lanes<S>| {
        for lane in 0..Lanes::<S>::LEN {
            assert!((a[lane] - b[lane]).abs() < 2e-3, "{}: {} against {}", name, a[lane], b[lane]);
        }
    };
    for (a, b) in right.rates.iter().zip(&velocity.rates) {
        close(*a, *b);
    }
    for (a, b) in [(right.base.a, base.a), (right.base.l, base.l)] {
        close(a.x, b.x);
        close(a.y, b.y);
        close(a.z, b.z);
    }
}

#[test]
fn legs_pressed_against_each_other_do_not_pass_through() {
    // All joints turn to one end, so parts of the lizard meet.
    let robot = robot("lizard");
    let start = robot.neutral();
    for side in [1.5, -1.5] {
        let signals = vec![vec![side; Targets::ticks(3.0)]; robot.hinges.len()];
        let rollout = run(&robot, &physics(), &start, &[Targets::new(&signals, 3.0).into()]).remove(0);
        assert_eq!(rollout.outcome, Outcome::Completed);
        let poses = robot.body_poses(&rollout.end);
        let mut deepest = 0.0_f32;
        for (a, first) in robot.bodies.iter().enumerate() {
            for (b, second) in robot.bodies.iter().enumerate().skip(a + 1) {
                let joined = robot.hinges.iter().enumerate().any(|(i, h)| i + 1 == b && h.parent == a);
                for (p, q) in first.boxes.iter().flat_map(|p| second.boxes.iter().map(move |q| (p, q))) {
                    let contact = rapier3d::parry::query::contact(
                        &(poses[a] * p.pose),
                        &rapier3d::parry::shape::Cuboid::new(p.half),
                        &(poses[b] * q.pose),
                        &rapier3d::parry::shape::Cuboid::new(q.half),
                        0.0,
                    );
                    if !joined && let Ok(Some(contact)) = contact {
                        deepest = deepest.max(-contact.dist);
                    }
                }
            }
        }
        assert!(deepest < 0.05, "bodies overlap by {deepest} mu");
    }
}

/// Returns a motion at rest, the same in all lanes.
pub(super) fn at<S: Simd>(simd: S, state: &State) -> kinematics::Motion<S> {
    let r = state.pivot.rotation;
    kinematics::Motion {
        position: V3::all(simd, state.pivot.translation),
        rotation: [all(simd, r.x), all(simd, r.y), all(simd, r.z), all(simd, r.w)],
        angles: state.joints.iter().map(|a| all(simd, *a)).collect(),
        velocity: Velocity { base: Spatial::zero(simd), rates: state.joints.iter().map(|_| all(simd, 0.0)).collect() },
    }
}
