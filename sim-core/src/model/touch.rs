//! Exact tests between a robot's shapes and the blocks of an environment.

use super::environment::Block;
use super::{Body, CollisionBox, CollisionCapsule, CollisionPrism, Place, Robot, State};
use crate::base::math::{Pose, Vector, about_z};
use rapier3d::parry::query::details::{intersection_test_cuboid_cuboid, intersection_test_support_map_support_map};
use rapier3d::parry::shape::{Capsule, Cuboid};

/// Returns true if the robot touches a block in this configuration, which is relative to the frame at `place`.
pub(crate) fn state_touches(robot: &Robot, block: &Block, place: &Place, state: &State) -> bool {
    Solid::of(block).meets(robot, &place.frame(), &robot.body_poses(state))
}

/// Distance to the ground or to terrain below which a body touches it, mu. Engines let robots sink in by about as much,
/// and lift them by as much.
const TOUCH: f32 = 0.01;

/// Returns for each body true if it touches the ground at z = 0 or terrain in this configuration, relative to the map.
pub fn bodies_touching(robot: &Robot, terrain: &[Block], state: &State) -> Vec<bool> {
    let solids: Vec<Solid<'_>> = terrain.iter().map(Solid::of).collect();
    let touching = |(body, pose): (&Body, Pose)| {
        let box_touches = |part: &CollisionBox| {
            let at = pose * part.pose;
            let up = at.rotation.inverse() * Vector::Z;
            let lowest = at.translation.z - part.half.dot(up.abs());
            let grown = Cuboid::new(part.half + Vector::splat(TOUCH));
            lowest <= TOUCH || solids.iter().any(|solid| solid.meets_box(&at, &grown))
        };
        let capsule_touches = |part: &CollisionCapsule| {
            let lowest = part.ends.map(|end| (pose * end).z).into_iter().fold(f32::INFINITY, f32::min) - part.radius;
            let [a, b] = part.ends;
            let grown = Capsule::new(a, b, part.radius + TOUCH);
            lowest <= TOUCH || solids.iter().any(|solid| solid.meets_capsule(&pose, &grown))
        };
        let prism_touches = |prism: &CollisionPrism| {
            let lowest = prism.corners().iter().map(|corner| (pose * *corner).z).fold(f32::INFINITY, f32::min);
            lowest <= TOUCH || solids.iter().any(|solid| solid.is_near_prism(&pose, prism, TOUCH))
        };
        body.boxes.iter().any(box_touches)
            || body.capsules.iter().any(capsule_touches)
            || body.prisms.iter().any(prism_touches)
    };
    robot.bodies.iter().zip(robot.body_poses(state)).map(touching).collect()
}

/// Block prepared for intersection tests.
pub(crate) struct Solid<'a> {
    /// The prepared block.
    pub block: &'a Block,
    cuboid: Cuboid,
    pose: Pose,
}

impl<'a> Solid<'a> {
    /// Prepares a block.
    pub fn of(block: &'a Block) -> Self {
        let cuboid = Cuboid::new(Vector::new(
            (block.size[0] / 2.0) as f32,
            (block.size[1] / 2.0) as f32,
            ((block.top - block.base) / 2.0) as f32,
        ));
        let center =
            Vector::new(block.center[0] as f32, block.center[1] as f32, ((block.top + block.base) / 2.0) as f32);
        Self { block, cuboid, pose: Pose::from_parts(center, about_z(block.yaw)) }
    }

    /// Returns true if a robot with bodies at these poses of a frame touches the block.
    pub fn meets(&self, robot: &Robot, frame: &Pose, poses: &[Pose]) -> bool {
        poses.iter().zip(&robot.bodies).any(|(pose, body)| {
            let of_box = |part: &CollisionBox| self.meets_box(&(*frame * *pose * part.pose), &Cuboid::new(part.half));
            let of_capsule = |part: &CollisionCapsule| {
                let [a, b] = part.ends;
                self.meets_capsule(&(*frame * *pose), &Capsule::new(a, b, part.radius))
            };
            let of_prism = |prism: &CollisionPrism| self.is_near_prism(&(*frame * *pose), prism, 0.0);
            body.boxes.iter().any(of_box) || body.capsules.iter().any(of_capsule) || body.prisms.iter().any(of_prism)
        })
    }

    fn meets_box(&self, pose: &Pose, part: &Cuboid) -> bool {
        intersection_test_cuboid_cuboid(&self.pose.inv_mul(pose), &self.cuboid, part)
    }

    /// Returns true if a prism of a body at a pose is at most `distance` mu from the block, along each of its axes.
    fn is_near_prism(&self, pose: &Pose, prism: &CollisionPrism, distance: f32) -> bool {
        let grown = Cuboid::new(self.cuboid.half_extents + Vector::splat(distance));
        intersection_test_support_map_support_map(&self.pose.inv_mul(pose), &grown, prism.polyhedron())
    }

    fn meets_capsule(&self, pose: &Pose, part: &Capsule) -> bool {
        intersection_test_support_map_support_map(&self.pose.inv_mul(pose), &self.cuboid, part)
    }
}
