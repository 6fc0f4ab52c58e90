//! Inertias with contacts of any direction.
//!
//! A point that is pressed along n resists by dt·D_n along n and by dt·D_t across n. As an inertia about the base's
//! origin this is a mass of D_t plus (D_n − D_t) w wᵀ, w = (r × n, n). Such an inertia has all 21 numbers of a
//! symmetric 6 × 6 matrix, and inertias of bodies still add.

use super::inertia::{Composite, Inertia};
use super::kinematics::Spatial;
use super::lanes::{Lanes, V3, all, fma, fnma};
use fearless_simd::prelude::*;

/// Lower triangle of a matrix over (angular, linear), row by row.
#[derive(Clone, Copy)]
pub(super) struct General<S: Simd>([Lanes<S>; 21]);

#[inline(always)]
const fn at(row: usize, column: usize) -> usize {
    if row >= column { row * (row + 1) / 2 + column } else { column * (column + 1) / 2 + row }
}

impl<S: Simd> General<S> {
    /// Adds a point at `r` that resists by `along` in direction `n`, a unit vector, and by `across` in all others.
    #[inline(always)]
    pub fn press(&mut self, r: V3<S>, n: V3<S>, along: Lanes<S>, across: Lanes<S>) {
        let m = &mut self.0;
        // Mass of the point.
        let (x, y, z) = (across * r.x, across * r.y, across * r.z);
        m[at(0, 0)] = fma::<S>(y, r.y, fma::<S>(z, r.z, m[at(0, 0)]));
        m[at(1, 1)] = fma::<S>(x, r.x, fma::<S>(z, r.z, m[at(1, 1)]));
        m[at(2, 2)] = fma::<S>(x, r.x, fma::<S>(y, r.y, m[at(2, 2)]));
        m[at(1, 0)] = fnma::<S>(x, r.y, m[at(1, 0)]);
        m[at(2, 0)] = fnma::<S>(x, r.z, m[at(2, 0)]);
        m[at(2, 1)] = fnma::<S>(y, r.z, m[at(2, 1)]);
        m[at(3, 1)] += z;
        m[at(3, 2)] -= y;
        m[at(4, 0)] -= z;
        m[at(4, 2)] += x;
        m[at(5, 0)] += y;
        m[at(5, 1)] -= x;
        for i in 3..6 {
            m[at(i, i)] += across;
        }
        // Difference of its resistance along n.
        let more = along - across;
        let w = r.cross(n);
        let w = [w.x, w.y, w.z, n.x, n.y, n.z];
        for i in 0..6 {
            let scaled = more * w[i];
            for j in 0..=i {
                m[at(i, j)] = fma::<S>(scaled, w[j], m[at(i, j)]);
            }
        }
    }
}

impl<S: Simd> Composite<S> for General<S> {
    #[inline(always)]
    fn rigid(simd: S, body: &Inertia<S>) -> Self {
        let m = body.matrix(simd);
        let mut lower = [all(simd, 0.0); 21];
        for i in 0..6 {
            for j in 0..=i {
                // Adding to 0 leaves no negative zero.
                lower[at(i, j)] += m[i][j];
            }
        }
        Self(lower)
    }

    #[inline(always)]
    fn add(&self, o: &Self) -> Self {
        let mut sum = self.0;
        for i in 0..21 {
            sum[i] += o.0[i];
        }
        Self(sum)
    }

    #[inline(always)]
    fn times(&self, motion: Spatial<S>) -> Spatial<S> {
        let (a, l) = (motion.a, motion.l);
        let v = [a.x, a.y, a.z, l.x, l.y, l.z];
        let mut momentum = v;
        for i in 0..6 {
            let mut sum = self.0[at(i, 0)] * v[0];
            for j in 1..6 {
                sum = fma::<S>(self.0[at(i, j)], v[j], sum);
            }
            momentum[i] = sum;
        }
        let [ax, ay, az, lx, ly, lz] = momentum;
        Spatial { a: V3 { x: ax, y: ay, z: az }, l: V3 { x: lx, y: ly, z: lz } }
    }

    #[inline(always)]
    fn matrix(&self, simd: S) -> [[Lanes<S>; 6]; 6] {
        let mut m = [[all(simd, 0.0); 6]; 6];
        for i in 0..6 {
            for j in 0..=i {
                m[i][j] = self.0[at(i, j)];
            }
        }
        m
    }
}
