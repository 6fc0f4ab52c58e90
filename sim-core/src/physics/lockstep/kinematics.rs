//! Forward kinematics: poses and velocities of bodies, in world axes about the base's origin.
//!
//! After Featherstone, *Rigid Body Dynamics Algorithms* (2008), section 4.4. All spatial quantities are about one
//! point, so they add without transforms: V_i = V_parent + S_i θ̇_i, S_i = (a_i, o_i × a_i).

use super::lanes::{Lanes, M3, V3, all, fma, fnma, half_sine_cosine};
use super::model::Model;
use fearless_simd::prelude::*;

/// Configuration and velocity of every lane.
#[derive(Clone)]
pub(super) struct Motion<S: Simd> {
    /// Origin of the base, mu.
    pub position: V3<S>,
    /// Rotation of the base, unit quaternion x, y, z, w.
    pub rotation: [Lanes<S>; 4],
    pub angles: Vec<Lanes<S>>,
    pub velocity: Velocity<S>,
}

/// Generalised velocity.
#[derive(Clone)]
pub(super) struct Velocity<S: Simd> {
    /// Velocity of the base: angular, and linear at its origin.
    pub base: Spatial<S>,
    /// Rates of the hinges, rad/s.
    pub rates: Vec<Lanes<S>>,
}

/// Spatial vector about the base's origin: motion (angular, linear) or force (moment, force).
#[derive(Clone, Copy)]
pub(super) struct Spatial<S: Simd> {
    pub a: V3<S>,
    pub l: V3<S>,
}

impl<S: Simd> Spatial<S> {
    #[inline(always)]
    pub fn zero(simd: S) -> Self {
        Self { a: V3::zero(simd), l: V3::zero(simd) }
    }

    #[inline(always)]
    pub fn dot(self, o: Self) -> Lanes<S> {
        self.a.dot(o.a) + self.l.dot(o.l)
    }

    #[inline(always)]
    pub fn add(self, o: Self) -> Self {
        Self { a: self.a.add(o.a), l: self.l.add(o.l) }
    }

    /// Replaces −0 by 0. Then adding a zero of either sign changes no bit. A contact that only other lanes have adds
    /// such zeros.
    #[inline(always)]
    pub fn without_negative_zeros(self, simd: S) -> Self {
        self.add(Self::zero(simd))
    }

    #[inline(always)]
    pub fn plus(self, k: Lanes<S>, o: Self) -> Self {
        Self { a: self.a.plus(k, o.a), l: self.l.plus(k, o.l) }
    }
}

/// Frames of bodies and axes of hinges.
pub(super) struct Frames<S: Simd> {
    /// Axes of every body.
    pub axes: Vec<M3<S>>,
    /// Origin of every body from the base's origin.
    pub origins: Vec<V3<S>>,
    /// Axis S_i of every hinge.
    pub hinges: Vec<Spatial<S>>,
}

impl<S: Simd> Frames<S> {
    pub fn new(simd: S, model: &Model) -> Self {
        let zero = V3::zero(simd);
        Self {
            axes: vec![M3 { c: [zero; 3] }; model.bodies.len()],
            origins: vec![zero; model.bodies.len()],
            hinges: vec![Spatial::zero(simd); model.hinges.len()],
        }
    }

    #[inline(never)]
    pub fn update(&mut self, simd: S, model: &Model, motion: &Motion<S>) {
        simd.vectorize(
            #[inline(always)]
            || {
                self.axes[0] = M3::of_quaternion(simd, motion.rotation);
                self.origins[0] = V3::zero(simd);
                for (i, hinge) in model.hinges.iter().enumerate() {
                    let carrier = self.axes[hinge.parent];
                    let axis = carrier.apply(V3::all(simd, hinge.axis));
                    let origin = self.origins[hinge.parent].add(carrier.apply(V3::all(simd, hinge.anchor)));
                    // R' = R + sin θ [a]ₓ R + (1 − cos θ) [a]ₓ [a]ₓ R, column by column, a in world axes.
                    let (sine, cosine) = half_sine_cosine(simd, motion.angles[i]);
                    let two = all(simd, 2.0) * sine;
                    let (sine, versine) = (two * cosine, two * sine);
                    let [a, b, c] = carrier.c;
                    self.axes[i + 1] = M3 {
                        c: [
                            turned(a, axis, sine, versine),
                            turned(b, axis, sine, versine),
                            turned(c, axis, sine, versine),
                        ],
                    };
                    self.origins[i + 1] = origin;
                    self.hinges[i] = Spatial { a: axis, l: origin.cross(axis) };
                }
            },
        )
    }

    /// Computes the velocity of every body.
    #[inline(always)]
    pub fn velocities(&self, model: &Model, velocity: &Velocity<S>, out: &mut [Spatial<S>]) {
        out[0] = velocity.base;
        for (i, hinge) in model.hinges.iter().enumerate() {
            out[i + 1] = out[hinge.parent].plus(velocity.rates[i], self.hinges[i]);
        }
    }
}

/// Returns a vector turned about an axis; the versine is 1 − cos.
#[inline(always)]
fn turned<S: Simd>(v: V3<S>, axis: V3<S>, sine: Lanes<S>, versine: Lanes<S>) -> V3<S> {
    let once = axis.cross(v);
    v.plus(sine, once).plus(versine, axis.cross(once))
}

impl<S: Simd> Motion<S> {
    /// Advances the configuration by `dt` s with constant velocity.
    #[inline(never)]
    pub fn advance(&mut self, simd: S, dt: f32) {
        simd.vectorize(
            #[inline(always)]
            || {
                let dt = all(simd, dt);
                let base = self.velocity.base;
                self.position = self.position.plus(dt, base.l);
                for i in 0..self.angles.len() {
                    self.angles[i] = fma::<S>(dt, self.velocity.rates[i], self.angles[i]);
                }
                // q + dt/2 ω q, normalised: the rotation by 2·atan(dt |ω| / 2).
                let half = base.a.times(dt * all(simd, 0.5));
                let [x, y, z, w] = self.rotation;
                let x1 = fma::<S>(half.x, w, fma::<S>(half.y, z, fnma::<S>(half.z, y, x)));
                let y1 = fma::<S>(half.y, w, fma::<S>(half.z, x, fnma::<S>(half.x, z, y)));
                let z1 = fma::<S>(half.z, w, fma::<S>(half.x, y, fnma::<S>(half.y, x, z)));
                let w1 = fnma::<S>(half.x, x, fnma::<S>(half.y, y, fnma::<S>(half.z, z, w)));
                let square = fma::<S>(x1, x1, fma::<S>(y1, y1, fma::<S>(z1, z1, w1 * w1)));
                let scale = all(simd, 1.0) / square.sqrt();
                self.rotation = [x1 * scale, y1 * scale, z1 * scale, w1 * scale];
            },
        )
    }
}
