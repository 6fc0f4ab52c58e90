//! A step of all lanes: semi-implicit in velocity, with motors, limits and contacts linearised several times.
//!
//! (M + dt·D) v⁺ = M v − dt·bias + dt·f. M v and the bias come from one pass over the tree (recursive Newton–Euler,
//! Featherstone (2008), section 5.3), in which each body carries its momentum minus dt times its bias force.

use super::contact::{Surface, box_axes, box_center};
use super::factor::System;
use super::inertia::{Composite, Inertia};
use super::kinematics::{Frames, Motion, Spatial, Velocity};
use super::lanes::{Lanes, Mask, V3, all, clamp, fma, fnma};
use super::model::{Joint, Model};
use super::touch;
use crate::base::math::Vector;
use fearless_simd::prelude::*;

/// Ratio of a joint limit's stiffness and damping to those of the motors.
const LIMIT_STIFFNESS: f32 = 10.0;

/// Data of a step, kept from step to step.
pub(super) struct Stepper<'a, S: Simd, G: Surface<S>> {
    simd: S,
    model: &'a Model,
    pub frames: Frames<S>,
    ground: G,
    system: System<S>,
    /// Motions of the bodies.
    motions: Vec<Spatial<S>>,
    accelerations: Vec<Spatial<S>>,
    rigid: Vec<Inertia<S>>,
    pressed: Vec<G::Inertia>,
    /// Momentum minus dt·bias of every body, plus impulses of contacts between bodies.
    carried: Vec<Spatial<S>>,
    impulses: Vec<Spatial<S>>,
    next: Velocity<S>,
    /// 1 in the lanes where a hinge is locked, else 0.
    locks: Vec<Lanes<S>>,
    /// True if a hinge is locked in any lane.
    locked: bool,
    /// Drives of the motors in the last linearisation.
    motors: Vec<Drive<S>>,
    /// Kinetic energy at the step's start, kg·mu²/s².
    pub energy: Lanes<S>,
    /// Potential energy at the step's start, kg·mu²/s²; 0 with all centres of mass at height 0.
    pub potential: Lanes<S>,
    /// Work of the motors in the last step, kg·mu²/s².
    pub work: Lanes<S>,
    /// Work of the motors in the last step, each without its sign, kg·mu²/s².
    pub turnover: Lanes<S>,
    /// Greatest squared speed of a body's origin at the step's start, mu²/s², and height of the lowest centre of mass,
    /// mu.
    pub extremes: (Lanes<S>, Lanes<S>),
}

impl<'a, S: Simd, G: Surface<S>> Stepper<'a, S, G> {
    pub fn new(simd: S, model: &'a Model, ground: G) -> Self {
        let (bodies, hinges) = (model.bodies.len(), model.hinges.len());
        let zero = Spatial::zero(simd);
        Self {
            simd,
            model,
            frames: Frames::new(simd, model),
            ground,
            system: System::new(simd, model),
            motions: vec![zero; bodies],
            accelerations: vec![zero; bodies],
            rigid: vec![Inertia::zero(simd); bodies],
            pressed: vec![G::Inertia::rigid(simd, &Inertia::zero(simd)); bodies],
            carried: vec![zero; bodies],
            impulses: vec![zero; bodies],
            next: Velocity { base: zero, rates: vec![all(simd, 0.0); hinges] },
            locks: vec![all(simd, 0.0); hinges],
            locked: false,
            motors: vec![Drive { stiffening: all(simd, 0.0), impulse: all(simd, 0.0) }; hinges],
            energy: all(simd, 0.0),
            potential: all(simd, 0.0),
            work: all(simd, 0.0),
            turnover: all(simd, 0.0),
            extremes: (all(simd, 0.0), all(simd, 0.0)),
        }
    }

    /// Locks a hinge of a lane at its present angle.
    pub fn lock(&mut self, hinge: usize, lane: usize) {
        self.locks[hinge][lane] = 1.0;
        self.locked = true;
    }

    /// Unlocks all hinges of all lanes.
    pub fn unlock(&mut self) {
        if self.locked {
            self.locks.fill(all(self.simd, 0.0));
            self.locked = false;
        }
    }

    /// Updates the bodies' frames from the motion.
    #[inline(always)]
    pub fn place(&mut self, motion: &Motion<S>) {
        self.frames.update(self.simd, self.model, motion);
    }

    /// Advances the motion by a step. The frames must be in place. `targets` are the joint targets at the step's end,
    /// rad.
    #[inline(always)]
    pub fn step(&mut self, motion: &mut Motion<S>, targets: &[Lanes<S>]) {
        let (simd, model) = (self.simd, self.model);
        self.measure(motion);
        touch::bodies(simd, model, &self.frames, &self.motions, &mut self.carried);
        self.ground.find(simd, model, &self.frames, motion.position);
        self.next.base = motion.velocity.base;
        self.next.rates.copy_from_slice(&motion.velocity.rates);
        for iteration in 0..model.iterations {
            if iteration > 0 {
                self.frames.velocities(model, &self.next, &mut self.motions);
            }
            self.solve(motion, targets);
        }
        std::mem::swap(&mut motion.velocity, &mut self.next);
        motion.advance(simd, model.dt);
    }

    /// Computes motions, inertias, bias, energy and extremes of a motion with its frames in place.
    #[inline(always)]
    pub fn measure(&mut self, motion: &Motion<S>) {
        self.frames.velocities(self.model, &motion.velocity, &mut self.motions);
        self.bias(motion);
    }

    /// Computes the rigid inertias, and for every body its momentum minus dt times its bias force.
    #[inline(never)]
    fn bias(&mut self, motion: &Motion<S>) {
        self.simd.vectorize(
            #[inline(always)]
            || {
                let (simd, model) = (self.simd, self.model);
                let minus_dt = all(simd, -model.dt);
                let base = self.motions[0];
                // The base's linear acceleration is that of its moving origin, −ω × v. Gravity counts as an upward
                // acceleration.
                let linear = V3::all(simd, -model.gravity).sub(base.a.cross(base.l));
                self.accelerations[0] = Spatial { a: V3::zero(simd), l: linear };
                let (mut energy, mut potential) = (all(simd, 0.0), all(simd, 0.0));
                let (mut fastest, mut lowest) = (all(simd, 0.0), all(simd, f32::MAX));
                for (i, link) in model.bodies.iter().enumerate() {
                    let v = self.motions[i];
                    if i > 0 {
                        let hinge = &model.hinges[i - 1];
                        let s = self.frames.hinges[i - 1];
                        // V × S θ̇. As V = V_parent + S θ̇, the cross product of the last term with S θ̇ is 0.
                        let turn = Spatial { a: v.a.cross(s.a), l: v.a.cross(s.l).add(v.l.cross(s.a)) };
                        self.accelerations[i] =
                            self.accelerations[hinge.parent].plus(motion.velocity.rates[i - 1], turn);
                    }
                    let inertia = Inertia::of_body(simd, link, &self.frames, i);
                    let momentum = inertia.times(v);
                    energy += v.dot(momentum);
                    let speed = v.l.add(v.a.cross(self.frames.origins[i]));
                    let square = speed.dot(speed);
                    // Compared so that a NaN is kept.
                    fastest = square.simd_le(fastest).select(fastest, square);
                    let height = motion.position.z + inertia.first.z / inertia.flat;
                    lowest = height.simd_ge(lowest).select(lowest, height);
                    potential = fma::<S>(inertia.flat, height, potential);
                    let rate_of_change = inertia.times(self.accelerations[i]);
                    let crossed =
                        Spatial { a: v.a.cross(momentum.a).add(v.l.cross(momentum.l)), l: v.a.cross(momentum.l) };
                    let force = rate_of_change.add(crossed);
                    self.carried[i] = momentum.plus(minus_dt, force).without_negative_zeros(simd);
                    self.rigid[i] = inertia.without_negative_zeros(simd);
                }
                self.energy = energy * all(simd, 0.5);
                self.potential = potential * all(simd, -model.gravity.z);
                self.extremes = (fastest, lowest);
            },
        )
    }

    /// Linearises about `next`, solves, and stores the solution in `next`.
    #[inline(never)]
    fn solve(&mut self, motion: &Motion<S>, targets: &[Lanes<S>]) {
        self.simd.vectorize(
            #[inline(always)]
            || {
                let (simd, model) = (self.simd, self.model);
                for i in 0..self.rigid.len() {
                    self.pressed[i] = G::Inertia::rigid(simd, &self.rigid[i]);
                }
                self.impulses.copy_from_slice(&self.carried);
                self.ground.press(simd, model, &self.motions, &mut self.pressed, &mut self.impulses);
                self.system.assemble(simd, model, &self.frames, &mut self.pressed);
                for i in (0..model.hinges.len()).rev() {
                    let wrench = self.impulses[i + 1];
                    let parent = model.hinges[i].parent;
                    self.impulses[parent] = self.impulses[parent].add(wrench);
                    let rate = self.next.rates[i];
                    let hinge = &model.hinges[i];
                    let mut motor = self.motor(hinge, motion.angles[i], rate, targets[i]);
                    let mut limit = self.limit(hinge, motion.angles[i], rate);
                    if self.locked {
                        let open: Mask<S> = self.locks[i].simd_lt(all(simd, 0.5));
                        motor = motor.only(simd, open, 0.0);
                        // Infinite stiffness keeps the joint's rate at exactly 0, so its angle stays.
                        limit = limit.only(simd, open, f32::INFINITY);
                    }
                    self.system.stiffen(i, motor.stiffening + limit.stiffening);
                    self.next.rates[i] = self.frames.hinges[i].dot(wrench) + (motor.impulse + limit.impulse);
                    self.motors[i] = motor;
                }
                self.next.base = self.impulses[0];
                self.system.solve(simd, model, &mut self.next);
                // The work of an impulse is its product with the mean of the rates before and after it.
                let (mut work, mut turnover) = (all(simd, 0.0), all(simd, 0.0));
                for i in 0..model.hinges.len() {
                    let after = self.next.rates[i];
                    let impulse = fnma::<S>(self.motors[i].stiffening, after, self.motors[i].impulse);
                    let twice = after + motion.velocity.rates[i];
                    work = fma::<S>(impulse, twice, work);
                    turnover += (impulse * twice).abs();
                }
                self.work = work * all(simd, 0.5);
                self.turnover = turnover * all(simd, 0.5);
            },
        )
    }

    /// Returns the motor of a hinge, linearised about a rate: an implicit spring and damper, or a constant torque where
    /// that would be too strong.
    #[inline(always)]
    fn motor(&self, hinge: &Joint, angle: Lanes<S>, rate: Lanes<S>, target: Lanes<S>) -> Drive<S> {
        let (simd, model) = (self.simd, self.model);
        let dt = all(simd, model.dt);
        let ahead = fma::<S>(dt, rate, angle);
        let stiffness = all(simd, model.stiffness);
        let torque = fnma::<S>(all(simd, model.damping), rate, stiffness * (target - ahead));
        let most = all(simd, hinge.max_torque);
        let weak: Mask<S> = torque.abs().simd_le(most);
        let stiffening = all(simd, model.dt * (model.damping + model.dt * model.stiffness));
        Drive {
            stiffening: weak.select(stiffening, all(simd, 0.0)),
            impulse: dt * weak.select(stiffness * (target - angle), clamp::<S>(torque, most)),
        }
    }

    /// Returns the limits of a hinge, linearised about a rate: a spring and damper while the predicted angle is beyond
    /// a limit.
    #[inline(always)]
    fn limit(&self, hinge: &Joint, angle: Lanes<S>, rate: Lanes<S>) -> Drive<S> {
        let (simd, model) = (self.simd, self.model);
        let zero = all(simd, 0.0);
        let [low, high] = hinge.limits.map(|limit| all(simd, limit));
        let middle = all(simd, 0.5 * (hinge.limits[0] + hinge.limits[1]));
        let bound = angle.simd_gt(middle).select(high, low);
        let ahead = fma::<S>(all(simd, model.dt), rate, angle);
        let beyond: Mask<S> = ahead.simd_gt(high) | ahead.simd_lt(low);
        let (spring, damper) = (LIMIT_STIFFNESS * model.stiffness, LIMIT_STIFFNESS * model.damping);
        Drive {
            stiffening: beyond.select(all(simd, model.dt * (damper + model.dt * spring)), zero),
            impulse: beyond.select(all(simd, model.dt * spring) * (bound - angle), zero),
        }
    }

    /// Returns the box around the robot, in the world.
    #[inline(never)]
    pub fn bounds(&self, simd: S, model: &Model, motion: &Motion<S>) -> (V3<S>, V3<S>) {
        simd.vectorize(
            #[inline(always)]
            || {
                let (mut low, mut high) = (V3::all(simd, Vector::MAX), V3::all(simd, Vector::MIN));
                for part in &model.boxes {
                    let center = motion.position.add(box_center(simd, part, &self.frames));
                    let [a, b, c] = box_axes(simd, part, &self.frames);
                    let half = V3::all(simd, part.half);
                    let reach = V3 {
                        x: V3 { x: a.x.abs(), y: b.x.abs(), z: c.x.abs() }.dot(half),
                        y: V3 { x: a.y.abs(), y: b.y.abs(), z: c.y.abs() }.dot(half),
                        z: V3 { x: a.z.abs(), y: b.z.abs(), z: c.z.abs() }.dot(half),
                    };
                    let (bottom, top) = (center.sub(reach), center.add(reach));
                    low.x = bottom.x.simd_lt(low.x).select(bottom.x, low.x);
                    low.y = bottom.y.simd_lt(low.y).select(bottom.y, low.y);
                    low.z = bottom.z.simd_lt(low.z).select(bottom.z, low.z);
                    high.x = top.x.simd_gt(high.x).select(top.x, high.x);
                    high.y = top.y.simd_gt(high.y).select(top.y, high.y);
                    high.z = top.z.simd_gt(high.z).select(top.z, high.z);
                }
                (low, high)
            },
        )
    }
}

#[cfg(test)]
impl<S: Simd> Stepper<'_, S, super::contact::Corners<S>> {
    /// Returns the forces of flat ground on every corner of the first lane in the last step, which gave `velocity`; see
    /// [`super::contact::Corners::forces`].
    pub fn corner_forces(&self, velocity: &Velocity<S>) -> Vec<(f32, f32)> {
        let mut after = self.motions.clone();
        self.frames.velocities(self.model, velocity, &mut after);
        self.ground.forces(self.model, &self.motions, &after)
    }
}

/// Contribution of a hinge to the linear system.
#[derive(Clone, Copy)]
struct Drive<S: Simd> {
    /// Addition to the diagonal.
    stiffening: Lanes<S>,
    /// Addition to the right side.
    impulse: Lanes<S>,
}

impl<S: Simd> Drive<S> {
    /// Returns the drive in the given lanes; other lanes get no impulse and the given stiffening.
    #[inline(always)]
    fn only(self, simd: S, lanes: Mask<S>, stiffening: f32) -> Self {
        Self {
            stiffening: lanes.select(self.stiffening, all(simd, stiffening)),
            impulse: lanes.select(self.impulse, all(simd, 0.0)),
        }
    }
}
