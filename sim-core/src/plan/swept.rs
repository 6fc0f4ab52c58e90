//! Laying a rollout into the map: does it leave it, does it touch an obstacle, does it come over terrain?
//!
//! Obstacles stay out of the simulation: rejecting a motion needs no contact forces. Boxes around the robot over short
//! spans of time are tested first; only where one comes near an obstacle are the robot's own boxes tested, at every
//! sample of that span (20 or more a second of motion).

use super::Place;
use crate::environment::{Block, Environment};
use crate::math::{Pose, Vector, about_z};
use crate::robot::{Robot, State};
use crate::rollout::{Rollout, Span};
use rapier3d::parry::query::details::{intersection_test_cuboid_cuboid, intersection_test_support_map_support_map};
use rapier3d::parry::shape::{Capsule, Cuboid};

/// Whether the pivot leaves the map on a rollout laid out from `place`.
pub fn leaves_map(environment: &Environment, place: &Place, rollout: &Rollout) -> bool {
    (0..rollout.trace.len()).any(|i| {
        let p = rollout.trace.pivot(i).translation;
        let (x, y) = place.point(p.x.into(), p.y.into());
        !environment.contains(x, y)
    })
}

/// Whether any part of the robot touches an obstacle on a rollout laid out from `place`.
pub fn touches(robot: &Robot, obstacles: &[Block], place: &Place, rollout: &Rollout) -> bool {
    obstacles.iter().any(|block| {
        rollout
            .swept
            .iter()
            .filter(|span| near(block, place, span))
            .any(|span| (span.first..=span.last).any(|i| state_touches(robot, block, place, &rollout.trace.state(i))))
    })
}

/// Whether the swept boxes of a rollout laid out from `place` come over any of these blocks.
pub fn on_terrain(terrain: &[Block], place: &Place, rollout: &Rollout) -> bool {
    terrain.iter().any(|block| rollout.swept.iter().any(|span| footprint(block, place, span)))
}

/// Whether the robot, in this configuration of the frame at `place`, touches a block.
pub(crate) fn state_touches(robot: &Robot, block: &Block, place: &Place, state: &State) -> bool {
    let solid = Cuboid::new(Vector::new(
        (block.size[0] / 2.0) as f32,
        (block.size[1] / 2.0) as f32,
        ((block.top - block.base) / 2.0) as f32,
    ));
    let center = Vector::new(block.center[0] as f32, block.center[1] as f32, ((block.top + block.base) / 2.0) as f32);
    let block_pose = Pose::from_parts(center, about_z(block.yaw));
    let frame = place.frame();
    robot.body_poses(state).iter().zip(&robot.bodies).any(|(pose, body)| {
        let touched = body.boxes.iter().any(|part| {
            let part_pose = frame * *pose * part.pose;
            intersection_test_cuboid_cuboid(&block_pose.inv_mul(&part_pose), &solid, &Cuboid::new(part.half))
        });
        touched || {
            let pose = block_pose.inv_mul(&(frame * *pose));
            body.capsules.iter().any(|part| {
                let [a, b] = part.ends;
                intersection_test_support_map_support_map(&pose, &solid, &Capsule::new(a, b, part.radius))
            })
        }
    })
}

/// Whether a span's box, laid out, may touch a block: a disc around it against the block's footprint, and heights.
fn near(block: &Block, place: &Place, span: &Span) -> bool {
    f64::from(span.low.z) <= block.top && f64::from(span.high.z) >= block.base && footprint(block, place, span)
}

fn footprint(block: &Block, place: &Place, span: &Span) -> bool {
    let (low, high) = (span.low, span.high);
    let (x, y) = place.point(f64::from(low.x + high.x) / 2.0, f64::from(low.y + high.y) / 2.0);
    let (w, h) = (f64::from(high.x - low.x) / 2.0, f64::from(high.y - low.y) / 2.0);
    block.covers(x, y, (w * w + h * h).sqrt())
}
