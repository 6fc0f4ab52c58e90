//! The rapier engine: rollouts on rapier3d. It is the reference engine, and supports any terrain.
//!
//! Every rollout builds a fresh world, so rollouts do not affect each other. Joints have force-based motors and are
//! impulse or multibody joints, by the job's setting. Friction is Coulomb's; joints are warm-started; bodies never
//! sleep. Contacts between bodies that share a joint are off, all others on.

mod joints;

use super::{
    Bound, Course, Effort, Engine, Motion, Outcome, Physics, Request, Rollout, Trace, Unsupported, sample_every, spans,
};
use crate::base::math::{Pose, Vector, about_z, angle_about};
use crate::model::environment::Block;
use crate::model::{Hinge, Robot, State, Twist, Velocities};
use joints::Joints;
use rapier3d::dynamics::{FrictionModel, IntegrationParameters, MassProperties, RigidBodyBuilder, RigidBodyHandle};
use rapier3d::geometry::{ColliderBuilder, SharedShape};
use rapier3d::math::Matrix;
use rapier3d::pipeline::PhysicsWorld;

/// Engine on rapier3d, which simulates one rollout after the other.
pub struct RapierEngine;

impl Engine for RapierEngine {
    /// Accepts all robots and terrain. Of events it accepts only failures of joints.
    fn supports(&self, robot: &Robot, _: &[Block], motion: &Motion) -> Result<(), Unsupported> {
        motion.events().iter().try_for_each(|event| Unsupported::of_event(robot, &event.change))
    }

    fn run(&self, robot: &Robot, physics: &Physics, terrain: &[Block], batch: &[Request<'_>]) -> Vec<Rollout> {
        let never = || false;
        let rollout = |request| Simulation::new(robot, physics, terrain, request).run(request, &never);
        batch.iter().map(|request| rollout(request).expect("a rollout without a stop runs to its end")).collect()
    }

    /// Simulates one rollout on flat ground; checks `stop` before every step. A step of the largest robot takes at most
    /// some milliseconds per substep.
    fn run_until(
        &self,
        robot: &Robot,
        physics: &Physics,
        request: &Request<'_>,
        stop: &dyn Fn() -> bool,
    ) -> Option<Rollout> {
        Simulation::new(robot, physics, &[], request).run(request, stop)
    }
}

struct Simulation<'a> {
    robot: &'a Robot,
    physics: &'a Physics,
    world: PhysicsWorld,
    bodies: Vec<RigidBodyHandle>,
    joints: Joints,
}

fn parameters(physics: &Physics) -> IntegrationParameters {
    IntegrationParameters {
        dt: 1.0 / physics.steps_per_second as f32,
        num_solver_iterations: physics.substeps as usize,
        friction_model: FrictionModel::Coulomb,
        warmstart_joints: true,
        // Friction acts in both passes of a substep: closer to finely stepped references at the same cost.
        friction_in_bias_pass: true,
        ..IntegrationParameters::default()
    }
}

impl<'a> Simulation<'a> {
    fn new(robot: &'a Robot, physics: &'a Physics, terrain: &[Block], request: &Request<'_>) -> Self {
        let mut world = PhysicsWorld::new();
        world.gravity = Vector::new(0.0, 0.0, -physics.gravity);
        world.integration_parameters = parameters(physics);
        let friction = physics.friction;
        let ground = world.insert_body(RigidBodyBuilder::fixed());
        world.insert_collider(ColliderBuilder::new(SharedShape::halfspace(Vector::Z)).friction(friction), Some(ground));
        for block in terrain {
            let half = Vector::new(block.size[0] as f32, block.size[1] as f32, (block.top - block.base) as f32) * 0.5;
            let center =
                Vector::new(block.center[0] as f32, block.center[1] as f32, ((block.top + block.base) * 0.5) as f32);
            let pose = Pose::from_parts(center, about_z(block.yaw));
            let shape = ColliderBuilder::cuboid(half.x, half.y, half.z).position(pose).friction(friction);
            world.insert_collider(shape, Some(ground));
        }
        let mut simulation = Self { robot, physics, world, bodies: Vec::new(), joints: Joints::none() };
        simulation.insert_robot(request.start);
        simulation
    }

    fn insert_robot(&mut self, start: &State) {
        let poses = self.robot.body_poses(start);
        let twists = self.robot.body_twists(start, &poses);
        for (i, (body, pose)) in self.robot.bodies.iter().zip(poses).enumerate() {
            let [x, y, z] = body.inertia.map(Vector::from_array);
            let inertia = Matrix::from_cols(x, y, z); // symmetric, so rows are columns
            let mass = MassProperties::with_inertia_matrix(body.center_of_mass, body.mass, inertia);
            let mut dynamic = RigidBodyBuilder::dynamic().pose(pose).can_sleep(false).additional_mass_properties(mass);
            if let Some(twists) = &twists {
                let Twist { angular, linear } = twists[i];
                // rapier's linear velocity is that of the centre of mass.
                let center = linear + angular.cross(pose.rotation * body.center_of_mass);
                dynamic = dynamic.linvel(center).angvel(angular);
            }
            let handle = self.world.insert_body(dynamic);
            for part in &body.boxes {
                let shape = ColliderBuilder::cuboid(part.half.x, part.half.y, part.half.z)
                    .position(part.pose)
                    .density(0.0)
                    .friction(self.physics.friction);
                self.world.insert_collider(shape, Some(handle));
            }
            for capsule in &body.capsules {
                let [a, b] = capsule.ends;
                let shape = ColliderBuilder::new(SharedShape::capsule(a, b, capsule.radius))
                    .density(0.0)
                    .friction(self.physics.friction);
                self.world.insert_collider(shape, Some(handle));
            }
            for prism in &body.prisms {
                let shape = ColliderBuilder::new(prism.shape().clone()).density(0.0).friction(self.physics.friction);
                self.world.insert_collider(shape, Some(handle));
            }
            self.bodies.push(handle);
        }
        self.joints = Joints::insert(&mut self.world, self.robot, self.physics, &self.bodies, start);
    }

    fn run(mut self, request: &Request<'_>, stop: &dyn Fn() -> bool) -> Option<Rollout> {
        let rate = self.physics.steps_per_second;
        let course = Course::new(self.robot, self.physics, request.start, request.motion);
        let steps = course.steps;
        let every = sample_every(rate);
        let mut trace = Trace::new(self.robot.hinges.len());
        let mut boxes = Vec::new();
        let mut outcome = course.outcome;
        let mut targets = vec![0.0; self.robot.hinges.len()];
        let mut state = request.start.clone();
        trace.push(0.0, &state);
        boxes.push(self.robot.bounds(&state));
        let mut effort = Effort::default();
        let mut joints = self.joint_motions();
        let mut done = 0;
        while done < steps {
            if stop() {
                return None;
            }
            let time = f64::from(done + 1) / f64::from(rate);
            course.failing(done).for_each(|joint| self.lock(joint));
            request.motion.targets().at(time, &mut targets);
            self.set_targets(&targets);
            self.world.step();
            done += 1;
            if let Some(bound) = self.broken() {
                outcome = Outcome::Unstable { time: time as f32, bound };
                break;
            }
            let after = self.joint_motions();
            self.works(&targets, &joints, &after).for_each(|work| effort.add(work));
            joints = after;
            if done % every == 0 || done == steps {
                state = self.state();
                trace.push(time as f32, &state);
                boxes.push(self.robot.bounds(&state));
            }
        }
        state.connections = request.start.connections.clone();
        state.phase = match outcome {
            Outcome::Completed => request.motion.end_phase().clone(),
            _ => request.start.phase.clone(),
        };
        Some(Rollout {
            end: state,
            end_speed: self.top_speed(),
            trace,
            swept: spans(&boxes),
            outcome,
            simulated_ms: u64::from(done) * 1000 / u64::from(rate),
            effort,
        })
    }

    /// Returns angle, rad, and rate, rad/s, of every joint.
    fn joint_motions(&self) -> Vec<(f32, f32)> {
        let motion = |(i, hinge): (usize, &Hinge)| (self.angle(i), self.rate(i, hinge));
        self.robot.hinges.iter().enumerate().map(motion).collect()
    }

    /// Returns the work of every motor in a step. rapier reports no torques of multibody joints, so the work follows
    /// from the motor's law, at the mean of the torques at the step's ends. Motors act on the angle one substep ahead,
    /// which adds stiffness times substep to their damping.
    fn works(&self, targets: &[f32], before: &[(f32, f32)], after: &[(f32, f32)]) -> impl Iterator<Item = f64> {
        let ends = before.iter().zip(after);
        let (stiffness, substeps) = (self.physics.stiffness, self.physics.substeps);
        let damping = self.physics.damping + stiffness / (self.physics.steps_per_second * substeps) as f32;
        self.robot.hinges.iter().zip(targets).zip(ends).map(move |((hinge, target), (before, after))| {
            let most = hinge.torque_or(self.physics.max_torque);
            let torque =
                |&(angle, rate): &(f32, f32)| (stiffness * (target - angle) - damping * rate).clamp(-most, most);
            f64::from(0.5 * (torque(before) + torque(after))) * f64::from(after.0 - before.0)
        })
    }

    fn set_targets(&mut self, targets: &[f32]) {
        self.joints.set_targets(&mut self.world, self.physics, targets);
    }

    /// Locks a joint at its present angle.
    fn lock(&mut self, joint: usize) {
        let angle = self.angle(joint);
        self.joints.lock(&mut self.world, joint, angle);
    }

    fn pose(&self, body: usize) -> Pose {
        *self.world.bodies[self.bodies[body]].position()
    }

    fn angle(&self, joint: usize) -> f32 {
        let hinge = &self.robot.hinges[joint];
        let turned =
            || angle_about(self.pose(hinge.parent).rotation.inverse() * self.pose(joint + 1).rotation, hinge.axis);
        self.joints.angle(&self.world, joint).unwrap_or_else(turned)
    }

    fn state(&self) -> State {
        let joints = (0..self.robot.hinges.len()).map(|joint| self.angle(joint)).collect();
        State { velocities: Some(self.velocities()), ..State::new(self.pose(0), joints) }
    }

    fn velocities(&self) -> Velocities {
        let angular = |body: usize| self.world.bodies[self.bodies[body]].angvel();
        let arm = self.pose(0).rotation * self.robot.bodies[0].center_of_mass;
        let linear = self.world.bodies[self.bodies[0]].linvel() - angular(0).cross(arm);
        let pivot = Twist { angular: angular(0), linear };
        let rates = self.robot.hinges.iter().enumerate().map(|(i, hinge)| self.rate(i, hinge));
        Velocities { pivot, rates: rates.collect() }
    }

    /// Returns the rate of a joint, rad/s.
    fn rate(&self, joint: usize, hinge: &Hinge) -> f32 {
        let angular = |body: usize| self.world.bodies[self.bodies[body]].angvel();
        let axis = self.pose(hinge.parent).rotation * hinge.axis;
        (angular(joint + 1) - angular(hinge.parent)).dot(axis)
    }

    fn top_speed(&self) -> f32 {
        self.bodies.iter().map(|b| self.world.bodies[*b].linvel().length()).fold(0.0, f32::max)
    }

    /// Returns the first bound that the world exceeds.
    fn broken(&self) -> Option<Bound> {
        let mut energy = 0.0;
        let mut mass = 0.0;
        for handle in &self.bodies {
            let body = &self.world.bodies[*handle];
            let (position, velocity) = (body.translation(), body.linvel());
            if !body.is_enabled() || !position.is_finite() || !velocity.is_finite() || !body.angvel().is_finite() {
                return Some(Bound::Finite);
            }
            if velocity.length() > Bound::SPEED {
                return Some(Bound::Speed);
            }
            if body.center_of_mass().z < -Bound::DEPTH {
                return Some(Bound::Penetration);
            }
            energy += body.kinetic_energy();
            mass += body.mass();
        }
        (energy > Bound::ENERGY * mass).then_some(Bound::Energy)
    }
}

#[cfg(test)]
mod closed_form;
