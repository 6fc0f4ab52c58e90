//! Tests of contact with stairs.

use super::closed_form::{seconds, world_on};
use super::general::General;
use super::inertia::{Composite, Inertia};
use super::kinematics::Spatial;
use super::lanes::{V3, all};
use super::model::Model;
use super::terrain::layers;
use super::tests::{gaits, physics, robot};
use super::{Level, run_at};
use crate::base::math::{Vector, about_z};
use crate::base::simd::{at_level, levels};
use crate::model::environment::{Block, Environment};
use crate::model::{Robot, RobotSpec, State};
use crate::physics::{Motion, Outcome, Request};
use fearless_simd::prelude::*;

fn stairs() -> Vec<Block> {
    let entry = crate::model::catalogue::find(crate::model::catalogue::environments(), "stairs").unwrap();
    Environment::from_toml(entry.toml).unwrap().terrain
}

/// Returns a brick of 4 kg, 2 mu long, 1 mu wide and high. A robot needs a hinge, so the brick contains a light rotor.
fn brick() -> Robot {
    let text = r#"
        name = "brick"
        pivot = "brick"
        [[body]]
        name = "brick"
        mass = 4.0
        inertia = [0.67, 1.67, 1.67, 0.0, 0.0, 0.0]
        [[body.box]]
        half = [1.0, 0.5, 0.5]
        [[body]]
        name = "rotor"
        hinge = { name = "axis", parent = "brick", anchor = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }
        mass = 0.01
        inertia = [0.001, 0.001, 0.001, 0.0, 0.0, 0.0]
        "#;
    Robot::compile(&toml::from_str::<RobotSpec>(text).unwrap()).unwrap()
}

fn placed(robot: &Robot, at: Vector, yaw: f64) -> State {
    let mut start = robot.neutral();
    start.pivot.rotation = about_z(yaw);
    start.pivot.translation = at;
    start
}

#[test]
fn distant_blocks_change_no_motion() {
    for name in ["quadropod", "lizard"] {
        let robot = robot(name);
        let (start, tables) = (robot.neutral(), gaits(&robot, 4, 2.0));
        let requests: Vec<Request<'_>> = tables.iter().map(|motion| Request { start: &start, motion }).collect();
        let far = [Block { center: [100.0, 0.0], size: [1.0, 1.0], base: 0.0, top: 1.0, yaw: 0.0 }];
        let run = |terrain: &[Block]| run_at(Level::new(), &robot, &physics(), terrain, &requests);
        for (flat, blocks) in run(&[]).iter().zip(run(&far)) {
            let apart = (flat.end.pivot.translation - blocks.end.pivot.translation).length();
            // The same sums are computed in another order.
            assert!(apart < 0.02, "{name}: {apart} mu apart");
        }
    }
}

#[test]
fn pressed_point_has_equal_inertia_in_both_forms() {
    fn check<S: Simd>(simd: S) {
        let mut flat = Inertia::zero(simd);
        let r = V3::all(simd, Vector::new(0.3, -0.7, 0.2));
        flat.press(r, all(simd, 2.0), all(simd, 5.0));
        let mut general = General::rigid(simd, &Inertia::zero(simd));
        general.press(r, V3::all(simd, Vector::Z), all(simd, 5.0), all(simd, 2.0));
        let v = V3::all(simd, Vector::new(0.4, 1.1, -0.6));
        let w = V3::all(simd, Vector::new(-0.9, 0.5, 0.8));
        let (one, other) = (flat.times(Spatial { a: w, l: v }), general.times(Spatial { a: w, l: v }));
        for (a, b) in [(one.a, other.a), (one.l, other.l)] {
            let apart = a.sub(b);
            assert!(apart.dot(apart)[0] < 1e-10);
        }
    }
    at_level!(Level::new(), simd => check(simd));
}

#[test]
fn brick_rests_on_tread_and_edge() {
    let (robot, layers) = (brick(), layers(&stairs()));
    let model = Model::new(&robot, &physics());
    // Places on the first tread, straight and turned, and over its front edge with the middle on the tread, also
    // turned.
    for (x, yaw) in [(-4.5, 0.0), (-4.4, 0.4), (-5.5, 0.0), (-5.6, 0.8), (-5.3, -2.2)] {
        let start = placed(&robot, Vector::new(x, 0.3, 0.6 + 0.5), yaw);
        let mut world = world_on(&model, &layers, &start);
        seconds(&mut *world, 5.0);
        let moved = world.place() - start.pivot.translation;
        let energy = world.energy();
        assert!(moved.length() < 0.006, "at {x}, {yaw}: moved by {moved}");
        assert!(energy < 1e-5, "at {x}, {yaw}: {energy} kg·mu²/s² left");
    }
}

#[test]
fn brick_with_middle_beyond_edge_tips() {
    let (robot, layers) = (brick(), layers(&stairs()));
    let model = Model::new(&robot, &physics());
    let start = placed(&robot, Vector::new(-6.3, 0.0, 1.1), 0.0);
    let mut world = world_on(&model, &layers, &start);
    seconds(&mut *world, 5.0);
    // The brick ends with one edge on the ground and leans against the stair's edge. Upright, its middle would be at
    // half its length, 1 mu.
    assert!(world.place().z < 0.95, "its middle is at {}", world.place());
    assert!(world.energy() < 1e-3, "{}", world.energy());
}

#[test]
fn brick_slides_off_tread_and_rests_below() {
    let (robot, layers) = (brick(), layers(&stairs()));
    let model = Model::new(&robot, &physics());
    let mut world = world_on(&model, &layers, &placed(&robot, Vector::new(-5.0, 0.0, 1.1), 0.0));
    seconds(&mut *world, 0.5);
    world.push(Vector::new(-6.0, 0.0, 0.0));
    seconds(&mut *world, 5.0);
    let place = world.place();
    assert!(place.x < -6.5 && place.z < 1.2, "at {place}");
    assert!(world.energy() < 1e-3, "{}", world.energy());
}

#[test]
fn wall_stops_sliding_brick_at_any_yaw() {
    let (robot, layers) = (brick(), layers(&stairs()));
    let model = Model::new(&robot, &physics());
    for yaw in [0.0, 0.5, 1.57] {
        let reach = (libm::cos(yaw) + 0.5 * libm::sin(yaw)) as f32;
        let mut world = world_on(&model, &layers, &placed(&robot, Vector::new(-7.4, 0.0, 0.5), yaw));
        seconds(&mut *world, 0.5);
        world.push(Vector::new(4.0, 0.0, 0.0));
        let mut farthest = f32::MIN;
        for _ in 0..400 {
            world.step();
            farthest = farthest.max(world.place().x);
        }
        assert!(farthest < -6.0 - 0.5 + 0.02, "{farthest}");
        if yaw == 0.0 {
            assert!((farthest + reach + 6.0).abs() < 0.02, "{farthest}");
        }
        assert!(world.place().z < 0.52, "the brick was lifted to {}", world.place());
    }
}

#[test]
fn falling_bricks_rest_on_stairs_in_any_orientation() {
    let (robot, blocks) = (brick(), stairs());
    let motion = Motion::standing(1, 6.0);
    let mut stream = crate::base::random::Stream::new(7, crate::base::random::Purpose::Sample, 0, 0, 0);
    for i in 0..60 {
        let mut draw = |spread: f64| stream.uniform(-spread, spread) as f32;
        let mut start = placed(&robot, Vector::new(draw(8.0), draw(3.0), 4.5), 0.0);
        start.pivot.rotation =
            crate::base::math::Rotation::from_xyzw(draw(1.0), draw(1.0), draw(1.0), draw(1.0)).normalize();
        let request = Request { start: &start, motion: &motion };
        let rollout = run_at(Level::new(), &robot, &physics(), &blocks, &[request]).remove(0);
        assert_eq!(rollout.outcome, Outcome::Completed, "{i}: {start:?}");
        assert!(rollout.end_speed < 0.02, "{i}: {} mu/s at {:?}", rollout.end_speed, rollout.end);
        let deepest = deepest(&robot, &rollout.end, &blocks);
        assert!(deepest < 0.02, "{i}: {deepest} mu deep at {:?}", rollout.end);
    }
}

/// Returns the greatest depth of the robot in a block or the ground.
fn deepest(robot: &Robot, state: &State, blocks: &[Block]) -> f32 {
    use rapier3d::parry::query::contact;
    use rapier3d::parry::shape::Cuboid;
    let mut deepest = -robot.bounds(state).0.z;
    let poses = robot.body_poses(state);
    for block in blocks {
        let half = Vector::new(block.size[0] as f32, block.size[1] as f32, block.top as f32) / 2.0;
        let at = Vector::new(block.center[0] as f32, block.center[1] as f32, half.z);
        let at = crate::base::math::Pose::from_parts(at, about_z(0.0));
        for (body, pose) in robot.bodies.iter().zip(&poses) {
            for part in &body.boxes {
                let found = contact(&(*pose * part.pose), &Cuboid::new(part.half), &at, &Cuboid::new(half), 0.0);
                if let Ok(Some(contact)) = found {
                    deepest = deepest.max(-contact.dist);
                }
            }
        }
    }
    deepest
}

#[test]
fn robot_does_not_sink_into_stairs() {
    let blocks = stairs();
    for name in ["quadropod", "lizard"] {
        let robot = robot(name);
        let mut start = robot.neutral();
        start.pivot.translation += Vector::new(-6.0, 0.0, 0.7);
        let tables = gaits(&robot, 16, 4.0);
        let requests: Vec<Request<'_>> = tables.iter().map(|motion| Request { start: &start, motion }).collect();
        for rollout in run_at(Level::new(), &robot, &physics(), &blocks, &requests) {
            assert_eq!(rollout.outcome, Outcome::Completed);
            let depths: Vec<f32> =
                (0..rollout.trace.len()).map(|s| deepest(&robot, &rollout.trace.state(s), &blocks)).collect();
            let deepest = depths.into_iter().fold(0.0, f32::max);
            assert!(deepest < 0.06, "{name}: {deepest} mu deep");
        }
    }
}

#[test]
fn batch_and_instruction_set_change_no_bit() {
    let (robot, blocks) = (robot("lizard"), stairs());
    let mut start = robot.neutral();
    start.pivot.translation += Vector::new(-6.0, 0.0, 0.7);
    let tables = gaits(&robot, 18, 2.0);
    let requests: Vec<Request<'_>> = tables.iter().map(|motion| Request { start: &start, motion }).collect();
    let together = run_at(Level::new(), &robot, &physics(), &blocks, &requests);
    for (i, request) in requests.iter().enumerate().take(5) {
        let alone = run_at(Level::new(), &robot, &physics(), &blocks, std::slice::from_ref(request));
        assert_eq!(format!("{:?}", together[i]), format!("{:?}", alone[0]));
    }
    for level in levels() {
        let again = run_at(level, &robot, &physics(), &blocks, &requests[..3]);
        assert_eq!(format!("{:?}", &together[..3]), format!("{again:?}"));
    }
}
