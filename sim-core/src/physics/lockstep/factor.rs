//! The mass matrix of a floating tree and its factors.
//!
//! The matrix is that of composite rigid bodies: Featherstone (2008), section 6.2. H = LᵀDL keeps the tree's zeros:
//! section 6.4. Hinges are eliminated from the leaves; the dense 6 × 6 matrix of the base remains.

use super::inertia::Composite;
use super::kinematics::{Frames, Spatial, Velocity};
use super::lanes::{Lanes, V3, all, fnma};
use super::model::Model;
use fearless_simd::prelude::*;

/// Symmetric linear system over base and hinges.
pub(super) struct System<S: Simd> {
    /// Elements of every hinge with the base.
    base_rows: Vec<Spatial<S>>,
    /// Elements of hinges with each other, row by row; only those of ancestors are filled.
    rows: Vec<Lanes<S>>,
    base: [[Lanes<S>; 6]; 6],
    hinges: usize,
}

impl<S: Simd> System<S> {
    pub fn new(simd: S, model: &Model) -> Self {
        let n = model.hinges.len();
        let zero = all(simd, 0.0);
        Self { base_rows: vec![Spatial::zero(simd); n], rows: vec![zero; n * n], base: [[zero; 6]; 6], hinges: n }
    }

    /// Computes the mass matrix. `inertias` become those of the subtrees.
    #[inline(never)]
    pub fn assemble<I: Composite<S>>(&mut self, simd: S, model: &Model, frames: &Frames<S>, inertias: &mut [I]) {
        simd.vectorize(
            #[inline(always)]
            || {
                for (i, hinge) in model.hinges.iter().enumerate().rev() {
                    inertias[hinge.parent] = inertias[hinge.parent].add(&inertias[i + 1]);
                    let force = inertias[i + 1].times(frames.hinges[i]);
                    self.base_rows[i] = force;
                    let mut at = Some(i);
                    while let Some(j) = at {
                        self.rows[i * self.hinges + j] = frames.hinges[j].dot(force);
                        at = model.hinges[j].carrier;
                    }
                }
                self.base = inertias[0].matrix(simd);
            },
        )
    }

    /// Adds to a hinge's diagonal element.
    #[inline(always)]
    pub fn stiffen(&mut self, hinge: usize, by: Lanes<S>) {
        let at = hinge * self.hinges + hinge;
        self.rows[at] += by;
    }

    /// Solves for the velocity. `velocity` holds the right side and is overwritten by the solution; the matrix is
    /// overwritten too.
    #[inline(never)]
    pub fn solve(&mut self, simd: S, model: &Model, velocity: &mut Velocity<S>) {
        simd.vectorize(
            #[inline(always)]
            || {
                let n = self.hinges;
                let one = all(simd, 1.0);
                // Eliminate hinges from the leaves.
                for k in (0..n).rev() {
                    let inverse = one / self.rows[k * n + k];
                    let (row, rate) = (self.base_rows[k], velocity.rates[k]);
                    let mut at = model.hinges[k].carrier;
                    while let Some(i) = at {
                        let share = self.rows[k * n + i] * inverse;
                        let mut below = Some(i);
                        while let Some(j) = below {
                            self.rows[i * n + j] = fnma::<S>(share, self.rows[k * n + j], self.rows[i * n + j]);
                            below = model.hinges[j].carrier;
                        }
                        self.base_rows[i] = self.base_rows[i].plus(-share, row);
                        velocity.rates[i] = fnma::<S>(share, rate, velocity.rates[i]);
                        at = model.hinges[i].carrier;
                    }
                    let line = [row.a.x, row.a.y, row.a.z, row.l.x, row.l.y, row.l.z];
                    for i in 0..6 {
                        let share = line[i] * inverse;
                        for j in 0..=i {
                            self.base[i][j] = fnma::<S>(share, line[j], self.base[i][j]);
                        }
                    }
                    velocity.base = velocity.base.plus(-(rate * inverse), row);
                    // Kept for the back substitution: the inverse of row k's pivot.
                    self.rows[k * n + k] = inverse;
                }
                velocity.base = dense(simd, &mut self.base, velocity.base);
                for k in 0..n {
                    let mut sum = velocity.rates[k] - self.base_rows[k].dot(velocity.base);
                    let mut at = model.hinges[k].carrier;
                    while let Some(i) = at {
                        sum = fnma::<S>(self.rows[k * n + i], velocity.rates[i], sum);
                        at = model.hinges[i].carrier;
                    }
                    velocity.rates[k] = sum * self.rows[k * n + k];
                }
            },
        )
    }
}

/// Solves the dense 6 × 6 system by LDLᵀ.
#[inline(always)]
fn dense<S: Simd>(simd: S, m: &mut [[Lanes<S>; 6]; 6], right: Spatial<S>) -> Spatial<S> {
    let mut x = [right.a.x, right.a.y, right.a.z, right.l.x, right.l.y, right.l.z];
    let mut inverse = [all(simd, 0.0); 6];
    for k in 0..6 {
        inverse[k] = all(simd, 1.0) / m[k][k];
        for i in k + 1..6 {
            let share = m[i][k] * inverse[k];
            for j in k + 1..=i {
                m[i][j] = fnma::<S>(share, m[j][k], m[i][j]);
            }
            x[i] = fnma::<S>(share, x[k], x[i]);
        }
    }
    for k in (0..6).rev() {
        let mut sum = x[k];
        for i in k + 1..6 {
            sum = fnma::<S>(m[i][k], x[i], sum);
        }
        x[k] = sum * inverse[k];
    }
    Spatial { a: V3 { x: x[0], y: x[1], z: x[2] }, l: V3 { x: x[3], y: x[4], z: x[5] } }
}
