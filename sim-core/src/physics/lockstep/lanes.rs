//! Vectors and matrices of lanes: every number is a register with one rollout per lane.
//!
//! Only operations that IEEE 754 rounds correctly are used: sums, products, quotients, roots and fused multiply-adds.
//! They have the same bits at every width and on every instruction set, and lanes do not affect each other.
//!
//! Each phase of a step is compiled as one function for each instruction set: an outer function that is never inlined,
//! and in it `vectorize` with the work in a closure that is always inlined. All functions that the work calls are
//! inlined into it, because a separate function would be compiled for the baseline. So no closure is passed to `map` or
//! similar functions in here. One function for the whole step would take ten times as long to compile, and run no
//! faster.

use crate::base::math::Vector;
use fearless_simd::prelude::*;

/// One number for each lane.
pub(super) type Lanes<S> = <S as Simd>::f32s;
/// One truth value for each lane.
pub(super) type Mask<S> = <<S as Simd>::f32s as SimdBase<S>>::Mask;

/// Returns a·b + c, rounded once.
#[inline(always)]
pub(super) fn fma<S: Simd>(a: Lanes<S>, b: Lanes<S>, c: Lanes<S>) -> Lanes<S> {
    a.mul_add_precise(b, c)
}

/// Returns c − a·b, rounded once.
#[inline(always)]
pub(super) fn fnma<S: Simd>(a: Lanes<S>, b: Lanes<S>, c: Lanes<S>) -> Lanes<S> {
    (-a).mul_add_precise(b, c)
}

/// Returns the same number in every lane.
#[inline(always)]
pub(super) fn all<S: Simd>(simd: S, value: f32) -> Lanes<S> {
    Lanes::<S>::splat(simd, value)
}

/// Returns the same three numbers in every lane.
#[inline(always)]
pub(super) fn three<S: Simd>(simd: S, v: Vector) -> [Lanes<S>; 3] {
    [all(simd, v.x), all(simd, v.y), all(simd, v.z)]
}

/// Returns the value clamped to ± bound.
#[inline(always)]
pub(super) fn clamp<S: Simd>(value: Lanes<S>, bound: Lanes<S>) -> Lanes<S> {
    let value = value.simd_lt(-bound).select(-bound, value);
    value.simd_gt(bound).select(bound, value)
}

/// Vector of three numbers.
#[derive(Clone, Copy)]
pub(super) struct V3<S: Simd> {
    pub x: Lanes<S>,
    pub y: Lanes<S>,
    pub z: Lanes<S>,
}

impl<S: Simd> V3<S> {
    #[inline(always)]
    pub fn zero(simd: S) -> Self {
        Self::all(simd, Vector::ZERO)
    }

    /// Returns the same vector in every lane.
    #[inline(always)]
    pub fn all(simd: S, v: Vector) -> Self {
        Self { x: all(simd, v.x), y: all(simd, v.y), z: all(simd, v.z) }
    }

    #[inline(always)]
    pub fn dot(self, o: Self) -> Lanes<S> {
        fma::<S>(self.x, o.x, fma::<S>(self.y, o.y, self.z * o.z))
    }

    #[inline(always)]
    pub fn cross(self, o: Self) -> Self {
        Self {
            x: fnma::<S>(self.z, o.y, self.y * o.z),
            y: fnma::<S>(self.x, o.z, self.z * o.x),
            z: fnma::<S>(self.y, o.x, self.x * o.y),
        }
    }

    #[inline(always)]
    pub fn add(self, o: Self) -> Self {
        Self { x: self.x + o.x, y: self.y + o.y, z: self.z + o.z }
    }

    #[inline(always)]
    pub fn sub(self, o: Self) -> Self {
        Self { x: self.x - o.x, y: self.y - o.y, z: self.z - o.z }
    }

    #[inline(always)]
    pub fn times(self, k: Lanes<S>) -> Self {
        Self { x: self.x * k, y: self.y * k, z: self.z * k }
    }

    /// Returns self + k·o.
    #[inline(always)]
    pub fn plus(self, k: Lanes<S>, o: Self) -> Self {
        Self { x: fma::<S>(k, o.x, self.x), y: fma::<S>(k, o.y, self.y), z: fma::<S>(k, o.z, self.z) }
    }

    /// Returns the components along a horizontal axis and along the other one.
    #[inline(always)]
    pub fn split(self, axis: usize) -> (Lanes<S>, Lanes<S>) {
        if axis == 0 { (self.x, self.y) } else { (self.y, self.x) }
    }

    #[inline(always)]
    pub fn select(mask: Mask<S>, a: Self, b: Self) -> Self {
        Self { x: mask.select(a.x, b.x), y: mask.select(a.y, b.y), z: mask.select(a.z, b.z) }
    }
}

/// Rotation matrix, by columns: the axes of a frame.
#[derive(Clone, Copy)]
pub(super) struct M3<S: Simd> {
    pub c: [V3<S>; 3],
}

impl<S: Simd> M3<S> {
    /// Returns the matrix of a unit quaternion x, y, z, w.
    #[inline(always)]
    pub fn of_quaternion(simd: S, [x, y, z, w]: [Lanes<S>; 4]) -> Self {
        let (one, two) = (all(simd, 1.0), all(simd, 2.0));
        let (x2, y2, z2) = (x * two, y * two, z * two);
        let first =
            V3 { x: fnma::<S>(y, y2, fnma::<S>(z, z2, one)), y: fma::<S>(x, y2, w * z2), z: fnma::<S>(w, y2, x * z2) };
        let second =
            V3 { x: fnma::<S>(w, z2, x * y2), y: fnma::<S>(x, x2, fnma::<S>(z, z2, one)), z: fma::<S>(y, z2, w * x2) };
        let third =
            V3 { x: fma::<S>(x, z2, w * y2), y: fnma::<S>(w, x2, y * z2), z: fnma::<S>(x, x2, fnma::<S>(y, y2, one)) };
        Self { c: [first, second, third] }
    }

    /// Returns the vector with these coordinates in the frame.
    #[inline(always)]
    pub fn apply(&self, v: V3<S>) -> V3<S> {
        self.c[0].times(v.x).plus(v.y, self.c[1]).plus(v.z, self.c[2])
    }
}

/// Returns sine and cosine of half an angle, from which those of the angle follow. The angle is at most ± π. They are
/// Taylor sums about 0, with an error below 2·10⁻⁷ for angles to ± 2 rad, the usual range of joints.
#[inline(always)]
pub(super) fn half_sine_cosine<S: Simd>(simd: S, angle: Lanes<S>) -> (Lanes<S>, Lanes<S>) {
    let t = angle * all(simd, 0.5);
    let u = t * t;
    let mut sine = all(simd, -1.0 / 39_916_800.0);
    for c in [1.0 / 362_880.0, -1.0 / 5040.0, 1.0 / 120.0, -1.0 / 6.0, 1.0] {
        sine = fma::<S>(sine, u, all(simd, c));
    }
    let mut cosine = all(simd, 1.0 / 479_001_600.0);
    for c in [-1.0 / 3_628_800.0, 1.0 / 40_320.0, -1.0 / 720.0, 1.0 / 24.0, -0.5, 1.0] {
        cosine = fma::<S>(cosine, u, all(simd, c));
    }
    (sine * t, cosine)
}
