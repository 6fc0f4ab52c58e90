//! Contact with ground at z = 0 and with stairs on it.
//!
//! A box touches a stair in two ways: with its corners on the stair's faces, and with its edges on the edges around the
//! stair's top. A corner touches the face that it has penetrated least, and a face is touched only by corners of the
//! box's side that is turned to it. An edge presses along the common normal of the two edges. So when a box slides over
//! an edge, it gains at one place the force that it loses at another, and forces hardly jump.

use super::contact::{Surface, box_axes, box_center};
use super::general::General;
use super::kinematics::{Frames, Spatial};
use super::lanes::{Lanes, Mask, V3, all, fnma, three};
use super::model::{Model, Part};
use super::terrain::Layer;
use crate::base::math::Vector;
use fearless_simd::prelude::*;

/// Distance above which pairs are skipped, mu; as for flat ground.
const NEAR: f32 = 0.1;
/// Distance at which nothing can touch, mu.
const FAR: f32 = 1e6;
/// Greatest depth behind a face, mu; a deeper corner has come through another face.
const DEEPEST: f32 = 0.2;
/// Greatest turn of an edge contact's normal beyond the normals of the two faces at that edge, as a sine.
const BEYOND: f32 = 0.2;
/// Cosine between the normals of two edges of a box above which both press together, because they bound one face.
const TOGETHER: f32 = 0.87;
/// Squared sine of the angle between two edges below which they count as parallel.
const PARALLEL: f32 = 1e-4;

/// Point of a body that may touch something.
#[derive(Clone, Copy)]
struct Contact<S: Simd> {
    body: usize,
    /// Position from the base's origin.
    at: V3<S>,
    /// Unit normal, out of the touched surface.
    normal: V3<S>,
    /// Depth, mu; negative if apart.
    depth: Lanes<S>,
}

/// Ground with stairs on it.
pub(super) struct Uneven<'a, S: Simd> {
    layers: &'a [Layer],
    ridges: Vec<Ridge>,
    contacts: Vec<Contact<S>>,
}

/// Box of the robot, in the world.
struct Solid<S: Simd> {
    body: usize,
    /// Centre from the base's origin.
    from_base: V3<S>,
    center: V3<S>,
    axes: [V3<S>; 3],
    half: [Lanes<S>; 3],
    /// Half sides of the axis-aligned box around it.
    reach: V3<S>,
}

/// Convex edge of a block.
#[derive(Clone, Copy)]
struct Ridge {
    /// Direction of the edge, along x (0) or y (1).
    along: usize,
    /// Middle of the edge.
    at: Vector,
    half: f32,
    /// Outward normal of the side that ends at the edge; the other face is the top.
    out: Vector,
}

impl<'a, S: Simd> Uneven<'a, S> {
    pub fn new(layers: &'a [Layer]) -> Self {
        Self { layers, ridges: layers.iter().flat_map(ridges).collect(), contacts: Vec::new() }
    }

    #[inline(always)]
    fn keep(&mut self, simd: S, contact: Contact<S>, near: Mask<S>) {
        let near: Mask<S> = near & contact.depth.simd_gt(all(simd, -NEAR));
        if near.any_true() {
            let depth = near.select(contact.depth, all(simd, -FAR));
            self.contacts.push(Contact { depth, ..contact });
        }
    }

    /// Finds corners of the box's most downward face on the ground or on the highest block beneath them.
    #[inline(always)]
    fn treads(&mut self, simd: S, solid: &Solid<S>) {
        let zero = all(simd, 0.0);
        let lowest = solid.center.z - solid.reach.z;
        let top = self.layers.last().map_or(0.0, |layer| layer.top);
        if lowest.simd_gt(all(simd, top + NEAR)).all_true() {
            return;
        }
        for corner in solid.face(simd, V3::all(simd, -Vector::Z)) {
            let w = solid.center.add(corner);
            let mut height = zero;
            for layer in self.layers {
                let top = all(simd, layer.top);
                let depth = top - w.z;
                let mut over: Mask<S> = depth.simd_lt(all(simd, DEEPEST));
                for (w, c, axis) in [(w.x, solid.center.x, 0), (w.y, solid.center.y, 1)] {
                    let (low, high) = (all(simd, layer.low[axis]), all(simd, layer.high[axis]));
                    // Where the box is beside the block, the corner may have come through the block's side.
                    over &= (w - low).simd_ge(c.simd_lt(low).select(greater::<S>(depth, zero), zero));
                    over &= (high - w).simd_ge(c.simd_gt(high).select(greater::<S>(depth, zero), zero));
                }
                height = (over & top.simd_gt(height)).select(top, height);
            }
            let at = solid.from_base.add(corner);
            let contact = Contact { body: solid.body, at, normal: V3::all(simd, Vector::Z), depth: height - w.z };
            self.keep(simd, contact, zero.simd_ge(zero));
        }
    }

    /// Finds corners of the face that the box turns to a side of a block.
    #[inline(always)]
    fn risers(&mut self, simd: S, solid: &Solid<S>) {
        let zero = all(simd, 0.0);
        for (axis, sign) in [(0, 1.0_f32), (0, -1.0), (1, 1.0), (1, -1.0)] {
            let direction = if axis == 0 { Vector::X } else { Vector::Y } * sign;
            let (_, c_other) = solid.center.split(axis);
            let s = all(simd, sign);
            let mut any = false;
            for layer in self.layers {
                any |= solid.meets(simd, layer, axis, sign).any_true();
            }
            if !any {
                continue;
            }
            for corner in solid.face(simd, V3::all(simd, direction)) {
                let w = solid.center.add(corner);
                let (w_axis, w_other) = w.split(axis);
                let mut depth = all(simd, -FAR);
                for layer in self.layers {
                    let (low, high) = (all(simd, layer.low[1 - axis]), all(simd, layer.high[1 - axis]));
                    let through = s * (w_axis - all(simd, layer.side(axis, sign)));
                    let least = greater::<S>(through, zero);
                    let by_low = c_other.simd_lt(low).select(least, zero);
                    let by_high = c_other.simd_gt(high).select(least, zero);
                    let touches: Mask<S> = solid.meets(simd, layer, axis, sign)
                        & (all(simd, layer.top) - w.z).simd_gt(least)
                        & (w_other - low).simd_ge(by_low)
                        & (high - w_other).simd_ge(by_high)
                        & through.simd_lt(all(simd, DEEPEST))
                        & through.simd_gt(depth);
                    depth = touches.select(through, depth);
                }
                let at = solid.from_base.add(corner);
                let contact = Contact { body: solid.body, at, normal: V3::all(simd, -direction), depth };
                self.keep(simd, contact, zero.simd_ge(zero));
            }
        }
    }

    /// Finds edges of the box that cross a convex edge of a block.
    #[inline(always)]
    fn ridge(&mut self, simd: S, solid: &Solid<S>, ridge: Ridge) {
        let zero = all(simd, 0.0);
        let offset = V3::all(simd, ridge.at).sub(solid.center);
        let mut room = [all(simd, NEAR); 3];
        room[ridge.along] = all(simd, ridge.half);
        let close: Mask<S> = (offset.x.abs() - solid.reach.x).simd_lt(room[0])
            & (offset.y.abs() - solid.reach.y).simd_lt(room[1])
            & (offset.z.abs() - solid.reach.z).simd_lt(room[2]);
        if !close.any_true() {
            return;
        }
        let direction = V3::all(simd, [Vector::X, Vector::Y][ridge.along]);
        let (out, up) = (V3::all(simd, ridge.out), V3::all(simd, Vector::Z));
        let bisector = out.add(up);
        // For each direction of edges: the normal, the two edges that may touch, and the lanes where they do.
        let mut normals = [V3::zero(simd); 3];
        let mut points = [[(V3::zero(simd), zero); 2]; 3];
        let mut crossing: [[Mask<S>; 2]; 3] = [[zero.simd_gt(zero); 2]; 3];
        let (mut best, mut best_normal) = (all(simd, FAR), V3::zero(simd));
        for i in 0..3 {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            let edge = solid.axes[i];
            let crossed = direction.cross(edge);
            let square = crossed.dot(crossed);
            let crosses: Mask<S> = square.simd_gt(all(simd, PARALLEL));
            let sine = crosses.select(square, all(simd, 1.0)).sqrt();
            let scale = all(simd, 1.0) / sine;
            let inward: Mask<S> = crossed.dot(bisector).simd_lt(zero);
            let n = crossed.times(inward.select(-scale, scale));
            let between: Mask<S> =
                n.dot(out).simd_ge(all(simd, -BEYOND)) & n.dot(up).simd_ge(all(simd, -BEYOND)) & crosses & close;
            if !between.any_true() {
                continue;
            }
            let (along_j, along_k) = (solid.axes[j].dot(n), solid.axes[k].dot(n));
            // Towards the lowest of the four parallel edges, and towards its neighbour in the face turned most against
            // n.
            let to_j = solid.axes[j].times(along_j.simd_gt(zero).select(-solid.half[j], solid.half[j]));
            let to_k = solid.axes[k].times(along_k.simd_gt(zero).select(-solid.half[k], solid.half[k]));
            let j_faces: Mask<S> = along_j.abs().simd_ge(along_k.abs());
            let (face, side) = (V3::select(j_faces, to_j, to_k), V3::select(j_faces, to_k, to_j));
            // Across both edges' projections, n × direction. Along it the box's edge advances by ± its sine.
            let across = n.cross(direction);
            let pace = edge.dot(across);
            let pace = crosses.select(pace, all(simd, 1.0));
            let corners = [face.add(side), face.sub(side)];
            for which in 0..2 {
                let corner = corners[which];
                let apart = offset.sub(corner);
                let t = apart.dot(across) / pace;
                let at = corner.plus(t, edge);
                let along = at.sub(offset).dot(direction).abs();
                let depth = apart.dot(n);
                crossing[i][which] = between
                    & t.abs().simd_le(solid.half[i])
                    & along.simd_le(all(simd, ridge.half))
                    & depth.simd_lt(all(simd, DEEPEST));
                points[i][which] = (at, depth);
            }
            // The lower edge gives the depth of the pair. A direction of edges with negative depth separates box and
            // stair, so it counts too.
            let depth = points[i][0].1;
            let counts: Mask<S> = crossing[i][0] | crossing[i][1] | (between & depth.simd_lt(zero));
            let better: Mask<S> = counts & depth.simd_lt(best);
            best = better.select(depth, best);
            best_normal = V3::select(better, n, best_normal);
            normals[i] = n;
        }
        for i in 0..3 {
            let together: Mask<S> = normals[i].dot(best_normal).simd_ge(all(simd, TOGETHER));
            for which in 0..2 {
                let (at, depth) = points[i][which];
                let at = solid.from_base.add(at);
                let contact = Contact { body: solid.body, at, normal: normals[i], depth };
                self.keep(simd, contact, crossing[i][which] & together);
            }
        }
    }
}

#[inline(always)]
fn greater<S: Simd>(a: Lanes<S>, b: Lanes<S>) -> Lanes<S> {
    a.simd_gt(b).select(a, b)
}

impl<S: Simd> Solid<S> {
    #[inline(always)]
    fn new(simd: S, part: &Part, frames: &Frames<S>, position: V3<S>) -> Self {
        let axes = box_axes(simd, part, frames);
        let from_base = box_center(simd, part, frames);
        let [a, b, c] = axes;
        let half = V3::all(simd, part.half);
        let reach = V3 {
            x: V3 { x: a.x.abs(), y: b.x.abs(), z: c.x.abs() }.dot(half),
            y: V3 { x: a.y.abs(), y: b.y.abs(), z: c.y.abs() }.dot(half),
            z: V3 { x: a.z.abs(), y: b.z.abs(), z: c.z.abs() }.dot(half),
        };
        let center = position.add(from_base);
        Self { body: part.body, from_base, center, axes, half: three(simd, part.half), reach }
    }

    /// Returns true if the box may touch a block's side in a motion along an axis, in positive (1) or negative (−1)
    /// direction.
    #[inline(always)]
    fn meets(&self, simd: S, layer: &Layer, axis: usize, sign: f32) -> Mask<S> {
        let ((center, aside), (reach, reach_aside)) = (self.center.split(axis), self.reach.split(axis));
        let (low, high) = (all(simd, layer.low[1 - axis]), all(simd, layer.high[1 - axis]));
        let ahead = all(simd, sign) * (all(simd, layer.side(axis, sign)) - center);
        ahead.simd_gt(all(simd, 0.0))
            & (ahead - reach).simd_lt(all(simd, NEAR))
            & (self.center.z - self.reach.z).simd_lt(all(simd, layer.top))
            & (aside + reach_aside).simd_gt(low)
            & (aside - reach_aside).simd_lt(high)
    }

    /// Returns the vectors from the centre to the four corners of the face that points most along `direction`.
    #[inline(always)]
    fn face(&self, simd: S, direction: V3<S>) -> [V3<S>; 4] {
        let zero = all(simd, 0.0);
        let mut edges = self.axes;
        let mut looks = [zero; 3];
        for i in 0..3 {
            let along = self.axes[i].dot(direction);
            looks[i] = along.abs();
            edges[i] = self.axes[i].times(along.simd_lt(zero).select(-self.half[i], self.half[i]));
        }
        let x_most: Mask<S> = looks[0].simd_ge(looks[1]) & looks[0].simd_ge(looks[2]);
        let y_most: Mask<S> = looks[1].simd_ge(looks[2]);
        let face = V3::select(x_most, edges[0], V3::select(y_most, edges[1], edges[2]));
        let one = V3::select(x_most, edges[1], edges[0]);
        let other = V3::select(x_most, edges[2], V3::select(y_most, edges[2], edges[1]));
        [face.add(one).add(other), face.add(one).sub(other), face.sub(one).add(other), face.sub(one).sub(other)]
    }
}

/// Returns the edges around a block's top.
fn ridges(layer: &Layer) -> [Ridge; 4] {
    let Layer { low, high, top } = *layer;
    let middle = [0, 1].map(|axis| (low[axis] + high[axis]) / 2.0);
    let half = [0, 1].map(|axis| (high[axis] - low[axis]) / 2.0);
    let x = |at: f32, out: Vector| Ridge { along: 1, at: Vector::new(at, middle[1], top), half: half[1], out };
    let y = |at: f32, out: Vector| Ridge { along: 0, at: Vector::new(middle[0], at, top), half: half[0], out };
    [x(low[0], -Vector::X), x(high[0], Vector::X), y(low[1], -Vector::Y), y(high[1], Vector::Y)]
}

impl<S: Simd> Surface<S> for Uneven<'_, S> {
    type Inertia = General<S>;

    #[inline(never)]
    fn find(&mut self, simd: S, model: &Model, frames: &Frames<S>, position: V3<S>) {
        self.contacts.clear();
        for part in &model.boxes {
            self.find_of(simd, part, frames, position);
        }
    }

    #[inline(never)]
    fn press(
        &self,
        simd: S,
        model: &Model,
        motion: &[Spatial<S>],
        inertias: &mut [General<S>],
        impulses: &mut [Spatial<S>],
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                let zero = all(simd, 0.0);
                let nowhere = V3::zero(simd);
                let dt = all(simd, model.dt);
                let stiffness = all(simd, model.contact.stiffness);
                let resistance = all(simd, model.contact.resistance);
                let slip = all(simd, model.contact.slip * model.contact.slip);
                let friction = all(simd, model.friction);
                for contact in &self.contacts {
                    let body = motion[contact.body];
                    let velocity = body.l.add(body.a.cross(contact.at));
                    let away = velocity.dot(contact.normal);
                    let force = fnma::<S>(resistance, away, stiffness * contact.depth);
                    let ends_inside = fnma::<S>(dt, away, contact.depth).simd_gt(zero);
                    let touches: Mask<S> = ends_inside & force.simd_gt(zero);
                    if !touches.any_true() {
                        continue;
                    }
                    let sliding = velocity.plus(-away, contact.normal);
                    let speed = (sliding.dot(sliding) + slip).sqrt();
                    let across = touches.select(dt * friction * force / speed, zero);
                    let along = touches.select(dt * resistance, zero);
                    let push = touches.select(dt * stiffness * contact.depth, zero);
                    // Non-finite numbers stay in their lane, and a lane without contact adds zeros.
                    let at = V3::select(touches, contact.at, nowhere);
                    let normal = V3::select(touches, contact.normal, nowhere);
                    inertias[contact.body].press(at, normal, along, across);
                    let impulse = &mut impulses[contact.body];
                    impulse.a = impulse.a.plus(push, at.cross(normal));
                    impulse.l = impulse.l.plus(push, normal);
                }
            },
        )
    }
}

impl<S: Simd> Uneven<'_, S> {
    #[inline(never)]
    fn find_of(&mut self, simd: S, part: &Part, frames: &Frames<S>, position: V3<S>) {
        simd.vectorize(
            #[inline(always)]
            || {
                let solid = Solid::new(simd, part, frames, position);
                self.treads(simd, &solid);
                self.risers(simd, &solid);
                for i in 0..self.ridges.len() {
                    self.ridge(simd, &solid, self.ridges[i]);
                }
            },
        )
    }
}
