//! Exact tests between a robot's shapes and the blocks of an environment.

use super::environment::Block;
use super::{Place, Robot, State};
use crate::base::math::{Pose, Vector, about_z};
use rapier3d::parry::query::details::{intersection_test_cuboid_cuboid, intersection_test_support_map_support_map};
use rapier3d::parry::shape::{Capsule, Cuboid};

/// Whether the robot, in this configuration of the frame at `place`, touches a block.
pub(crate) fn state_touches(robot: &Robot, block: &Block, place: &Place, state: &State) -> bool {
    Solid::of(block).meets(robot, &place.frame(), &robot.body_poses(state))
}

/// A block, ready to be met.
pub(crate) struct Solid<'a> {
    /// The block.
    pub block: &'a Block,
    cuboid: Cuboid,
    pose: Pose,
}

impl<'a> Solid<'a> {
    /// Of a block.
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

    /// Whether a robot with bodies at these poses of a frame touches it.
    pub fn meets(&self, robot: &Robot, frame: &Pose, poses: &[Pose]) -> bool {
        poses.iter().zip(&robot.bodies).any(|(pose, body)| {
            let touched = body.boxes.iter().any(|part| {
                let part_pose = *frame * *pose * part.pose;
                intersection_test_cuboid_cuboid(&self.pose.inv_mul(&part_pose), &self.cuboid, &Cuboid::new(part.half))
            });
            touched || {
                let pose = self.pose.inv_mul(&(*frame * *pose));
                body.capsules.iter().any(|part| {
                    let [a, b] = part.ends;
                    intersection_test_support_map_support_map(&pose, &self.cuboid, &Capsule::new(a, b, part.radius))
                })
            }
        })
    }
}
