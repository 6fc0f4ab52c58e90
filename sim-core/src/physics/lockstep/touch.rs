//! Contact between two bodies of the robot: overlapping boxes push each other apart.
//!
//! Overlap is found by separating axes (Gottschalk, Lin and Manocha 1996): faces of both boxes and crossed edges, so no
//! corner and no edge is missed. The push is an explicit spring and damper along the axis of least overlap, with
//! friction.

use super::contact::{box_axes, box_center};
use super::kinematics::{Frames, Spatial};
use super::lanes::{Lanes, Mask, V3, all, clamp, fma, fnma, three};
use super::model::{Model, Part};
use fearless_simd::prelude::*;

/// Factor by which crossed edges must overlap less than faces to be chosen: a face's contact is steadier.
const FACE_FIRST: f32 = 0.95;
/// Sine of the angle below which an edge or a face counts as flat against the other box.
const FLAT: f32 = 0.05;
/// Squared sine below which two edges count as parallel and give no axis to test.
const PARALLEL: f32 = 1e-4;

/// Adds dt times the forces of overlapping boxes to `carried`.
#[inline(never)]
pub(super) fn bodies<S: Simd>(
    simd: S,
    model: &Model,
    frames: &Frames<S>,
    motions: &[Spatial<S>],
    carried: &mut [Spatial<S>],
) {
    simd.vectorize(
        #[inline(always)]
        || {
            for &(i, j) in &model.pairs {
                let (a, b) = (&model.boxes[i], &model.boxes[j]);
                let from = box_center(simd, a, frames);
                let apart = box_center(simd, b, frames).sub(from);
                let reach = a.radius + b.radius;
                let far: Mask<S> = apart.dot(apart).simd_ge(all(simd, reach * reach));
                if far.all_true() {
                    continue;
                }
                push(simd, model, frames, (a, b), (from, apart, !far), motions, carried);
            }
        },
    )
}

/// Box, one in each lane: centre from the base's origin, axes, half sides.
struct Solid<S: Simd> {
    center: V3<S>,
    axes: [V3<S>; 3],
    half: [Lanes<S>; 3],
}

impl<S: Simd> Solid<S> {
    /// Returns the middle of the part farthest along `n`: a corner, or the middle of a flat edge or face.
    #[inline(always)]
    fn support(&self, simd: S, n: V3<S>) -> V3<S> {
        let mut at = self.center;
        for i in 0..3 {
            let side = clamp::<S>(self.axes[i].dot(n) * all(simd, 1.0 / FLAT), all(simd, 1.0));
            at = at.plus(side * self.half[i], self.axes[i]);
        }
        at
    }

    /// Returns the point of the box nearest to `p`.
    #[inline(always)]
    fn nearest(&self, p: V3<S>) -> V3<S> {
        let offset = p.sub(self.center);
        let mut at = self.center;
        for i in 0..3 {
            at = at.plus(clamp::<S>(self.axes[i].dot(offset), self.half[i]), self.axes[i]);
        }
        at
    }
}

/// Orientation and offset of a box b relative to a box a, one pair in each lane.
struct Relative<S: Simd> {
    /// Cosines of the angles between axis i of a and axis j of b.
    cosine: [[Lanes<S>; 3]; 3],
    /// Magnitudes of the cosines.
    absolute: [[Lanes<S>; 3]; 3],
    /// Offset from the centre of a to the centre of b.
    apart: V3<S>,
    /// The offset along the axes of a.
    in_a: [Lanes<S>; 3],
    /// The offset along the axes of b.
    in_b: [Lanes<S>; 3],
}

impl<S: Simd> Relative<S> {
    #[inline(always)]
    fn of(simd: S, a: &Solid<S>, b: &Solid<S>, apart: V3<S>) -> Self {
        let zero = all(simd, 0.0);
        let mut cosine = [[zero; 3]; 3];
        let mut absolute = [[zero; 3]; 3];
        let (mut in_a, mut in_b) = ([zero; 3], [zero; 3]);
        for i in 0..3 {
            for j in 0..3 {
                cosine[i][j] = a.axes[i].dot(b.axes[j]);
                absolute[i][j] = cosine[i][j].abs();
            }
            in_a[i] = a.axes[i].dot(apart);
            in_b[i] = b.axes[i].dot(apart);
        }
        Self { cosine, absolute, apart, in_a, in_b }
    }
}

/// Axis of greatest separation of two boxes.
struct Axis<S: Simd> {
    /// Distance between the boxes along the axis; negative if they overlap.
    gap: Lanes<S>,
    normal: V3<S>,
    /// True if the axis is that of a face of a.
    face_of_a: Mask<S>,
    /// True if the axis is that of two crossed edges.
    edges: Mask<S>,
}

impl<S: Simd> Axis<S> {
    /// Returns the axis of greatest separation among those of the faces.
    #[inline(always)]
    fn of_faces(simd: S, a: &Solid<S>, b: &Solid<S>, relative: &Relative<S>) -> Self {
        let zero = all(simd, 0.0);
        let mut gap = all(simd, f32::MIN);
        let mut normal = V3::zero(simd);
        let mut face_of_a: Mask<S> = zero.simd_gt(zero);
        for i in 0..3 {
            let mut sum = a.half[i];
            for j in 0..3 {
                sum = fma::<S>(b.half[j], relative.absolute[i][j], sum);
            }
            let this = relative.in_a[i].abs() - sum;
            let better: Mask<S> = this.simd_gt(gap);
            gap = better.select(this, gap);
            normal = V3::select(better, a.axes[i], normal);
            face_of_a |= better;
        }
        for j in 0..3 {
            let mut sum = b.half[j];
            for i in 0..3 {
                sum = fma::<S>(a.half[i], relative.absolute[i][j], sum);
            }
            let this = relative.in_b[j].abs() - sum;
            let better: Mask<S> = this.simd_gt(gap);
            gap = better.select(this, gap);
            normal = V3::select(better, b.axes[j], normal);
            face_of_a &= !better;
        }
        Self { gap, normal, face_of_a, edges: zero.simd_gt(zero) }
    }

    /// Takes the axis of two crossed edges where the boxes overlap clearly less along it.
    #[inline(always)]
    fn add_edges(&mut self, simd: S, a: &Solid<S>, b: &Solid<S>, relative: &Relative<S>) {
        let Relative { cosine, absolute, apart, .. } = relative;
        for i in 0..3 {
            for j in 0..3 {
                let square = fnma::<S>(cosine[i][j], cosine[i][j], all(simd, 1.0));
                let crossing: Mask<S> = square.simd_gt(all(simd, PARALLEL));
                let scale = all(simd, 1.0) / crossing.select(square, all(simd, 1.0)).sqrt();
                let axis = a.axes[i].cross(b.axes[j]).times(scale);
                let (p, q) = ((i + 1) % 3, (i + 2) % 3);
                let (r, s) = ((j + 1) % 3, (j + 2) % 3);
                let reach_a = fma::<S>(a.half[p], absolute[q][j], a.half[q] * absolute[p][j]);
                let reach_b = fma::<S>(b.half[r], absolute[i][s], b.half[s] * absolute[i][r]);
                let this = fnma::<S>(reach_a + reach_b, scale, axis.dot(*apart).abs());
                // Overlaps are negative: an edge's axis must overlap clearly less than the best so far.
                let better: Mask<S> = crossing & this.simd_gt(self.gap * all(simd, FACE_FIRST));
                self.gap = better.select(this, self.gap);
                self.normal = V3::select(better, axis, self.normal);
                self.edges |= better;
            }
        }
    }

    /// Returns the normal from a to b, and the point of contact.
    #[inline(always)]
    fn contact(&self, simd: S, a: &Solid<S>, b: &Solid<S>, apart: V3<S>) -> (V3<S>, V3<S>) {
        let zero = all(simd, 0.0);
        let n = V3::select(self.normal.dot(apart).simd_lt(zero), V3::zero(simd).sub(self.normal), self.normal);
        let on_b = b.support(simd, V3::zero(simd).sub(n));
        let on_a = a.support(simd, n);
        let between = on_a.add(on_b).times(all(simd, 0.5));
        let faces = V3::select(self.face_of_a, a.nearest(on_b), b.nearest(on_a));
        (n, V3::select(self.edges, between, faces))
    }
}

/// Returns dt times the force and torque of a contact on the second box: spring, damper and friction. 0 in lanes
/// without overlap.
#[inline(always)]
fn wrench<S: Simd>(
    simd: S,
    model: &Model,
    (of_a, of_b): (Spatial<S>, Spatial<S>),
    (n, at): (V3<S>, V3<S>),
    (gap, overlap): (Lanes<S>, Mask<S>),
) -> Spatial<S> {
    let zero = all(simd, 0.0);
    let relative = of_b.l.add(of_b.a.cross(at)).sub(of_a.l.add(of_a.a.cross(at)));
    let along = relative.dot(n);
    let force = fnma::<S>(all(simd, model.contact.own_damping), along, all(simd, -model.contact.own_stiffness) * gap);
    let pushes: Mask<S> = overlap & force.simd_gt(zero);
    let force = pushes.select(force, zero);
    let sliding = relative.plus(-along, n);
    let slip = all(simd, model.contact.slip * model.contact.slip);
    let speed = (sliding.dot(sliding) + slip).sqrt();
    // Full friction, limited so that a step does not reverse the motion.
    let drag = all(simd, model.friction) * force / speed;
    let most = all(simd, model.contact.own_damping);
    let drag = drag.simd_gt(most).select(most, drag);
    let total = n.times(force).plus(-drag, sliding).times(all(simd, model.dt));
    Spatial { a: at.cross(total), l: total }
}

/// Pushes two boxes apart in the lanes in which they are near each other and overlap.
#[inline(never)]
fn push<S: Simd>(
    simd: S,
    model: &Model,
    frames: &Frames<S>,
    (first, second): (&Part, &Part),
    (from, apart, near): (V3<S>, V3<S>, Mask<S>),
    motions: &[Spatial<S>],
    carried: &mut [Spatial<S>],
) {
    simd.vectorize(
        #[inline(always)]
        || {
            let zero = all(simd, 0.0);
            let a = Solid { center: from, axes: box_axes(simd, first, frames), half: three(simd, first.half) };
            let b =
                Solid { center: from.add(apart), axes: box_axes(simd, second, frames), half: three(simd, second.half) };
            let relative = Relative::of(simd, &a, &b, apart);
            let mut axis = Axis::of_faces(simd, &a, &b, &relative);
            // A non-finite lane counts as overlapping, which affects no other lane.
            if axis.gap.simd_ge(zero).all_true() {
                return;
            }
            axis.add_edges(simd, &a, &b, &relative);
            let overlap: Mask<S> = near & axis.gap.simd_lt(zero);
            if !overlap.any_true() {
                return;
            }
            let contact = axis.contact(simd, &a, &b, apart);
            let bodies = (motions[first.body], motions[second.body]);
            let wrench = wrench(simd, model, bodies, contact, (axis.gap, overlap));
            carried[second.body] = carried[second.body].add(wrench);
            carried[first.body] = carried[first.body].plus(all(simd, -1.0), wrench);
        },
    )
}
