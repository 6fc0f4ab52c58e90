//! The two kinds of joints in rapier. Impulse joints pull two free bodies together; multibody joints have the joint
//! angles as coordinates. Motors, gains, limits and contacts are the same.

use super::{PhysicsWorld, RigidBodyHandle, Robot};
use crate::base::math::{Vector, about};
use crate::model::{Hinge, State};
use crate::physics::{JointKind, Physics};
use rapier3d::dynamics::{
    ImpulseJointHandle, JointAxesMask, JointAxis, MotorModel, MultibodyJointHandle, RevoluteJointBuilder,
};

/// Handles of the joints, in the order of the robot's hinges.
pub(super) enum Joints {
    Impulse(Vec<ImpulseJointHandle>),
    Multibody(Vec<MultibodyJointHandle>),
}

impl Joints {
    /// Returns no joints, for a robot that is not in the world yet.
    pub fn none() -> Self {
        Self::Impulse(Vec::new())
    }

    /// Joins bodies that are at their places.
    pub fn insert(
        world: &mut PhysicsWorld,
        robot: &Robot,
        physics: &Physics,
        bodies: &[RigidBodyHandle],
        start: &State,
    ) -> Self {
        let hinges = robot.hinges.iter().enumerate();
        let joints = hinges.map(|(i, h)| (bodies[h.parent], bodies[i + 1], revolute(h, physics, start.joints[i])));
        match physics.joints {
            JointKind::Impulse => Self::Impulse(joints.map(|(a, b, j)| world.insert_impulse_joint(a, b, j)).collect()),
            JointKind::Multibody => {
                let insert = |(a, b, joint)| {
                    world.insert_multibody_joint(a, b, joint).expect("the hinges of a compiled robot form a tree")
                };
                let handles: Vec<_> = joints.map(insert).collect();
                if let Some(first) = handles.first() {
                    turn_to_start(world, *first, bodies, start);
                    set_going(world, *first, bodies, start);
                }
                Self::Multibody(handles)
            }
        }
    }

    /// Sets the motors' targets, rad.
    pub fn set_targets(&self, world: &mut PhysicsWorld, physics: &Physics, targets: &[f32]) {
        let (stiffness, damping) = (physics.stiffness, physics.damping);
        match self {
            Self::Impulse(handles) => {
                for (handle, &target) in handles.iter().zip(targets) {
                    if let Some(joint) = world.impulse_joints.get_mut(*handle, false) {
                        joint.data.set_motor_position(JointAxis::AngX, target, stiffness, damping);
                    }
                }
            }
            Self::Multibody(handles) => {
                for (handle, &target) in handles.iter().zip(targets) {
                    let found = world.multibody_joints.get_mut(*handle);
                    if let Some(link) = found.and_then(|(multibody, id)| multibody.link_mut(id)) {
                        link.joint.data.set_motor_position(JointAxis::AngX, target, stiffness, damping);
                    }
                }
            }
        }
    }

    /// Locks a joint at an angle, rad.
    pub fn lock(&self, world: &mut PhysicsWorld, joint: usize, angle: f32) {
        match self {
            Self::Impulse(handles) => {
                if let Some(joint) = world.impulse_joints.get_mut(handles[joint], false) {
                    // rapier locks an axis at 0, so the first frame is turned by the angle.
                    let frame = &mut joint.data.local_frame1;
                    frame.rotation = (frame.rotation * about(Vector::X, angle)).normalize();
                    joint.data.lock_axes(JointAxesMask::ANG_X);
                }
            }
            Self::Multibody(handles) => {
                // A multibody keeps its number of coordinates, so limits hold the angle.
                let found = world.multibody_joints.get_mut(handles[joint]);
                if let Some(link) = found.and_then(|(multibody, id)| multibody.link_mut(id)) {
                    let data = &mut link.joint.data;
                    data.set_limits(JointAxis::AngX, [angle, angle]).set_motor_max_force(JointAxis::AngX, 0.0);
                }
            }
        }
    }

    /// Returns the angle of a joint, rad, if rapier stores it.
    pub fn angle(&self, world: &PhysicsWorld, joint: usize) -> Option<f32> {
        let Self::Multibody(handles) = self else { return None };
        let (multibody, id) = world.multibody_joints.get(handles[joint])?;
        Some(multibody.link(id)?.joint().coords()[JointAxis::AngX as usize])
    }
}

fn revolute(hinge: &Hinge, physics: &Physics, angle: f32) -> RevoluteJointBuilder {
    RevoluteJointBuilder::new(hinge.axis)
        .local_anchor1(hinge.anchor)
        .local_anchor2(rapier3d::math::Vector::ZERO)
        .contacts_enabled(false)
        .limits(hinge.limits)
        .motor_model(MotorModel::ForceBased)
        .motor_max_force(hinge.torque_or(physics.max_torque))
        .motor_position(angle, physics.stiffness, physics.damping)
}

/// Sets the velocities of a multibody, which has its own: linear and angular of its root's centre of mass, then those
/// of the joints.
fn set_going(world: &mut PhysicsWorld, root: MultibodyJointHandle, bodies: &[RigidBodyHandle], start: &State) {
    let Some(velocities) = &start.velocities else { return };
    let pivot = &world.bodies[bodies[0]];
    let (linear, angular) = (pivot.linvel(), pivot.angvel());
    let Some((multibody, _)) = world.multibody_joints.get_mut(root) else { return };
    let mut own = vec![0.0; multibody.ndofs()];
    own[..3].copy_from_slice(&linear.to_array());
    own[3..6].copy_from_slice(&angular.to_array());
    for link in multibody.links().filter(|link| !link.is_root()) {
        let body = bodies.iter().position(|b| *b == link.rigid_body_handle());
        own[link.assembly_id()] = body.map_or(0.0, |b| velocities.rates[b - 1]);
    }
    multibody.generalized_velocity_mut().copy_from_slice(&own);
}

/// Sets the start's angles of a multibody. rapier creates it with all angles at 0, at any poses of its bodies, and with
/// a damping that also acts on the free pivot, which is removed.
fn turn_to_start(world: &mut PhysicsWorld, root: MultibodyJointHandle, bodies: &[RigidBodyHandle], start: &State) {
    let Some((multibody, _)) = world.multibody_joints.get_mut(root) else { return };
    multibody.damping_mut().fill(0.0);
    let mut turns = vec![0.0; multibody.ndofs()];
    for link in multibody.links().filter(|link| !link.is_root()) {
        let body = bodies.iter().position(|b| *b == link.rigid_body_handle());
        // The index of a body's joint is one less than the body's: the pivot has no joint.
        turns[link.assembly_id()] = body.map_or(0.0, |b| start.joints[b - 1]);
    }
    multibody.apply_displacements(&turns);
    multibody.forward_kinematics(&world.bodies, true);
    multibody.update_rigid_bodies(&mut world.bodies, true);
}
