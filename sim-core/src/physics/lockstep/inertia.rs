//! Inertias about the base's origin, in world axes, with contacts on flat ground.
//!
//! A rigid body's inertia has 10 numbers. A point pressed to flat ground resists motion along the ground (dt·D_t) and
//! across it (dt·D_n). Both act like masses that differ along z. A body with such points needs 13 numbers, and inertias
//! of bodies still add.

use super::kinematics::{Frames, Spatial};
use super::lanes::{Lanes, V3, all, fma, fnma};
use super::model::Link;
use fearless_simd::prelude::*;

/// Symmetric 3 × 3 matrix: xx, yy, zz, xy, xz, yz.
pub(super) type Symmetric<S> = [Lanes<S>; 6];

/// Rigid inertia plus pressed points.
#[derive(Clone, Copy)]
pub(super) struct Inertia<S: Simd> {
    /// Mass along the ground.
    pub flat: Lanes<S>,
    /// Mass across the ground.
    pub upright: Lanes<S>,
    /// First moments of the mass along the ground.
    pub first: V3<S>,
    /// First moments x, y of the mass across the ground.
    pub first_upright: [Lanes<S>; 2],
    /// Second moments about the base's origin.
    pub second: Symmetric<S>,
}

/// Inertia with contacts, from which the mass matrix is assembled.
pub(super) trait Composite<S: Simd>: Copy {
    /// Returns the inertia of a body without contacts.
    fn rigid(simd: S, body: &Inertia<S>) -> Self;
    /// Returns the sum.
    fn add(&self, other: &Self) -> Self;
    /// Returns the momentum of a motion.
    fn times(&self, motion: Spatial<S>) -> Spatial<S>;
    /// Returns the matrix over (angular, linear); rows and columns 0 to 5, the lower triangle filled.
    fn matrix(&self, simd: S) -> [[Lanes<S>; 6]; 6];
}

#[inline(always)]
fn dot<S: Simd>(a: [Lanes<S>; 3], b: [Lanes<S>; 3]) -> Lanes<S> {
    fma::<S>(a[0], b[0], fma::<S>(a[1], b[1], a[2] * b[2]))
}

impl<S: Simd> Inertia<S> {
    #[inline(always)]
    pub fn zero(simd: S) -> Self {
        let zero = all(simd, 0.0);
        Self { flat: zero, upright: zero, first: V3::zero(simd), first_upright: [zero; 2], second: [zero; 6] }
    }

    /// Returns the inertia of a body at its place in `frames`.
    #[inline(always)]
    pub fn of_body(simd: S, link: &Link, frames: &Frames<S>, body: usize) -> Self {
        let axes = &frames.axes[body];
        let center = frames.origins[body].add(axes.apply(V3::all(simd, link.center)));
        let mass = all(simd, link.mass);
        let first = center.times(mass);
        let i = link.inertia;
        let (xx, yy, zz) = (all(simd, i[0]), all(simd, i[1]), all(simd, i[2]));
        let (xy, xz, yz) = (all(simd, i[3]), all(simd, i[4]), all(simd, i[5]));
        let [a, b, c] = axes.c;
        // R I Rᵀ = Σ (R I)_k R_kᵀ.
        let [ta, tb, tc] = if link.diagonal {
            [a.times(xx), b.times(yy), c.times(zz)]
        } else {
            [
                a.times(xx).plus(xy, b).plus(xz, c),
                a.times(xy).plus(yy, b).plus(yz, c),
                a.times(xz).plus(yz, b).plus(zz, c),
            ]
        };
        let (tx, ty, tz) = ([ta.x, tb.x, tc.x], [ta.y, tb.y, tc.y], [ta.z, tb.z, tc.z]);
        let (x, y, z) = ([a.x, b.x, c.x], [a.y, b.y, c.y], [a.z, b.z, c.z]);
        let (cx, cy, cz) = (center.x, center.y, center.z);
        let (fx, fy, fz) = (first.x, first.y, first.z);
        Self {
            flat: mass,
            upright: mass,
            first,
            first_upright: [fx, fy],
            second: [
                fma::<S>(fy, cy, fma::<S>(fz, cz, dot::<S>(tx, x))),
                fma::<S>(fx, cx, fma::<S>(fz, cz, dot::<S>(ty, y))),
                fma::<S>(fx, cx, fma::<S>(fy, cy, dot::<S>(tz, z))),
                fnma::<S>(fx, cy, dot::<S>(tx, y)),
                fnma::<S>(fx, cz, dot::<S>(tx, z)),
                fnma::<S>(fy, cz, dot::<S>(ty, z)),
            ],
        }
    }

    /// Adds a point at `r` that resists by `flat` along the ground and `upright` across it.
    #[inline(always)]
    pub fn press(&mut self, r: V3<S>, flat: Lanes<S>, upright: Lanes<S>) {
        let (fx, fy, fz) = (flat * r.x, flat * r.y, flat * r.z);
        let (ux, uy) = (upright * r.x, upright * r.y);
        self.flat += flat;
        self.upright += upright;
        self.first = self.first.add(V3 { x: fx, y: fy, z: fz });
        self.first_upright = [self.first_upright[0] + ux, self.first_upright[1] + uy];
        let [xx, yy, zz, xy, xz, yz] = self.second;
        let deep = fz * r.z;
        self.second = [
            fma::<S>(uy, r.y, xx + deep),
            fma::<S>(ux, r.x, yy + deep),
            fma::<S>(fx, r.x, fma::<S>(fy, r.y, zz)),
            fnma::<S>(ux, r.y, xy),
            fnma::<S>(fx, r.z, xz),
            fnma::<S>(fy, r.z, yz),
        ];
    }

    /// Returns the same inertia without negative zeros; see [`Spatial::without_negative_zeros`].
    #[inline(always)]
    pub fn without_negative_zeros(&self, simd: S) -> Self {
        self.add(&Self::zero(simd))
    }
}

impl<S: Simd> Composite<S> for Inertia<S> {
    #[inline(always)]
    fn rigid(_: S, body: &Self) -> Self {
        *body
    }

    #[inline(always)]
    fn add(&self, o: &Self) -> Self {
        let mut second = self.second;
        for i in 0..6 {
            second[i] += o.second[i];
        }
        Self {
            flat: self.flat + o.flat,
            upright: self.upright + o.upright,
            first: self.first.add(o.first),
            first_upright: [self.first_upright[0] + o.first_upright[0], self.first_upright[1] + o.first_upright[1]],
            second,
        }
    }

    #[inline(always)]
    fn times(&self, m: Spatial<S>) -> Spatial<S> {
        let (w, v, h) = (m.a, m.l, self.first);
        let [nx, ny] = self.first_upright;
        let [xx, yy, zz, xy, xz, yz] = self.second;
        let w3 = [w.x, w.y, w.z];
        Spatial {
            a: V3 {
                x: fma::<S>(ny, v.z, fnma::<S>(h.z, v.y, dot::<S>([xx, xy, xz], w3))),
                y: fma::<S>(h.z, v.x, fnma::<S>(nx, v.z, dot::<S>([xy, yy, yz], w3))),
                z: fma::<S>(h.x, v.y, fnma::<S>(h.y, v.x, dot::<S>([xz, yz, zz], w3))),
            },
            l: V3 {
                x: fma::<S>(self.flat, v.x, fnma::<S>(w.z, h.y, w.y * h.z)),
                y: fma::<S>(self.flat, v.y, fnma::<S>(w.x, h.z, w.z * h.x)),
                z: fma::<S>(self.upright, v.z, fnma::<S>(w.y, nx, w.x * ny)),
            },
        }
    }

    #[inline(always)]
    fn matrix(&self, simd: S) -> [[Lanes<S>; 6]; 6] {
        let zero = all(simd, 0.0);
        let h = self.first;
        let [nx, ny] = self.first_upright;
        let [xx, yy, zz, xy, xz, yz] = self.second;
        let (f, u) = (self.flat, self.upright);
        [
            [xx, zero, zero, zero, zero, zero],
            [xy, yy, zero, zero, zero, zero],
            [xz, yz, zz, zero, zero, zero],
            [zero, h.z, -h.y, f, zero, zero],
            [-h.z, zero, h.x, zero, f, zero],
            [ny, -nx, zero, zero, zero, u],
        ]
    }
}
