//! Contact with flat ground at z = 0.
//!
//! A corner at depth φ with velocity u resists with the normal force f_n = k φ − r u_z, if it is positive and the
//! corner ends the step below the ground. Friction is regularised Coulomb friction, −μ f_n u_t / √(|u_t|² + v_s²). With
//! f_n and the root from the last iterate, both forces are linear in the new velocity and become inertia of the
//! corner's body.
//!
//! A spring with the force of the step's end adds a damper k·dt. r is the total damper, and at least k·dt. So the
//! bounce hardly depends on the step, and the spring is stable at any step.

use super::inertia::{Composite, Inertia};
use super::kinematics::{Frames, Spatial};
use super::lanes::{Lanes, Mask, V3, all, fma, fnma, three};
use super::model::{Model, Part};
use fearless_simd::prelude::*;

/// Height of the lowest corner above which a box is skipped, if it is that high in every lane, mu. A corner that falls
/// from higher within one step is handled in the next.
const NEAR: f32 = 0.1;
/// Distance from the ground at which no corner can touch it, mu.
const FAR: f32 = 1e6;

/// Surface that robots stand on.
pub(super) trait Surface<S: Simd> {
    /// Inertia of bodies that touch the surface.
    type Inertia: Composite<S>;

    /// Finds the points that may touch the surface within a step. `position` is the base's origin.
    fn find(&mut self, simd: S, model: &Model, frames: &Frames<S>, position: V3<S>);

    /// Adds the effect of the surface, linearised about the motion of the bodies: dt times its resistance to the
    /// inertias, dt times the springs' forces to the impulses.
    fn press(
        &self,
        simd: S,
        model: &Model,
        motion: &[Spatial<S>],
        inertias: &mut [Self::Inertia],
        impulses: &mut [Spatial<S>],
    );
}

/// Corner that may touch the ground.
#[derive(Clone, Copy)]
struct Corner<S: Simd> {
    body: usize,
    /// Position from the base's origin.
    at: V3<S>,
    /// Depth below the ground, mu; negative above it.
    depth: Lanes<S>,
}

/// Corners near the ground, of the most downward face of each box.
pub(super) struct Corners<S: Simd>(Vec<Corner<S>>);

/// Returns the axes of a box in world axes.
#[inline(always)]
pub(super) fn box_axes<S: Simd>(simd: S, part: &Part, frames: &Frames<S>) -> [V3<S>; 3] {
    let body = &frames.axes[part.body];
    match &part.axes {
        None => body.c,
        Some([a, b, c]) => {
            [body.apply(V3::all(simd, *a)), body.apply(V3::all(simd, *b)), body.apply(V3::all(simd, *c))]
        }
    }
}

/// Returns the centre of a box from the base's origin.
#[inline(always)]
pub(super) fn box_center<S: Simd>(simd: S, part: &Part, frames: &Frames<S>) -> V3<S> {
    frames.origins[part.body].add(frames.axes[part.body].apply(V3::all(simd, part.center)))
}

impl<S: Simd> Corners<S> {
    pub fn new(model: &Model) -> Self {
        Self(Vec::with_capacity(4 * model.boxes.len()))
    }

    /// Returns the normal force and the friction of every corner in the first lane, kg·mu/s². `about` is the motion
    /// that a step's last linearisation was about, `after` the motion at the step's end.
    #[cfg(test)]
    pub fn forces(&self, model: &Model, about: &[Spatial<S>], after: &[Spatial<S>]) -> Vec<(f32, f32)> {
        let velocity = |motion: &[Spatial<S>], corner: &Corner<S>| {
            let v = motion[corner.body].l.add(motion[corner.body].a.cross(corner.at));
            crate::base::math::Vector::new(v.x[0], v.y[0], v.z[0])
        };
        let carried = |depth: f32, v: crate::base::math::Vector| {
            let force = model.contact.stiffness * depth - model.contact.resistance * v.z;
            if depth > model.dt * v.z { force.max(0.0) } else { 0.0 }
        };
        let both = |corner: &Corner<S>| {
            let (before, after) = (velocity(about, corner), velocity(after, corner));
            let flat = before.truncate();
            let drag =
                carried(corner.depth[0], before) / (flat.dot(flat) + model.contact.slip * model.contact.slip).sqrt();
            (carried(corner.depth[0], after), model.friction * drag * after.truncate().length())
        };
        self.0.iter().map(both).collect()
    }
}

impl<S: Simd> Surface<S> for Corners<S> {
    type Inertia = Inertia<S>;

    #[inline(never)]
    fn find(&mut self, simd: S, model: &Model, frames: &Frames<S>, position: V3<S>) {
        let height = position.z;
        simd.vectorize(
            #[inline(always)]
            || {
                self.0.clear();
                let zero = all(simd, 0.0);
                for part in &model.boxes {
                    let axes = box_axes(simd, part, frames);
                    let center = box_center(simd, part, frames);
                    let half = three(simd, part.half);
                    let down = [axes[0].z.abs(), axes[1].z.abs(), axes[2].z.abs()];
                    let reach = fma::<S>(down[0], half[0], fma::<S>(down[1], half[1], down[2] * half[2]));
                    let lowest = height + center.z - reach;
                    // `not higher` rather than `lower`, so that non-finite lanes are not skipped.
                    let high: Mask<S> = lowest.simd_gt(all(simd, NEAR));
                    if high.all_true() {
                        continue;
                    }
                    // Half edges that point down; the one that points down most leads to the face.
                    let mut edges = axes;
                    for i in 0..3 {
                        edges[i] = axes[i].times(axes[i].z.simd_gt(zero).select(-half[i], half[i]));
                    }
                    let x_most: Mask<S> = down[0].simd_ge(down[1]) & down[0].simd_ge(down[2]);
                    let y_most: Mask<S> = down[1].simd_ge(down[2]);
                    let to_face = V3::select(x_most, edges[0], V3::select(y_most, edges[1], edges[2]));
                    let one = V3::select(x_most, edges[1], edges[0]);
                    let other = V3::select(x_most, edges[2], V3::select(y_most, edges[2], edges[1]));
                    let face = center.add(to_face);
                    for at in [
                        face.add(one).add(other),
                        face.add(one).sub(other),
                        face.sub(one).add(other),
                        face.sub(one).sub(other),
                    ] {
                        // A box that is high in this lane is skipped here, independent of the other lanes.
                        let depth = high.select(all(simd, -FAR), -(height + at.z));
                        self.0.push(Corner { body: part.body, at, depth });
                    }
                }
            },
        )
    }

    #[inline(never)]
    fn press(
        &self,
        simd: S,
        model: &Model,
        motion: &[Spatial<S>],
        inertias: &mut [Inertia<S>],
        impulses: &mut [Spatial<S>],
    ) {
        simd.vectorize(
            #[inline(always)]
            || {
                let zero = all(simd, 0.0);
                let dt = all(simd, model.dt);
                let stiffness = all(simd, model.contact.stiffness);
                let resistance = all(simd, model.contact.resistance);
                let slip = all(simd, model.contact.slip * model.contact.slip);
                let friction = all(simd, model.friction);
                for corner in &self.0 {
                    let body = motion[corner.body];
                    let velocity = body.l.add(body.a.cross(corner.at));
                    let force = fnma::<S>(resistance, velocity.z, stiffness * corner.depth);
                    let ends_below = fnma::<S>(dt, velocity.z, corner.depth).simd_gt(zero);
                    let touches: Mask<S> = ends_below & force.simd_gt(zero);
                    if !touches.any_true() {
                        continue;
                    }
                    let speed = fma::<S>(velocity.x, velocity.x, fma::<S>(velocity.y, velocity.y, slip)).sqrt();
                    let flat = touches.select(dt * friction * force / speed, zero);
                    let upright = touches.select(dt * resistance, zero);
                    let push = touches.select(dt * stiffness * corner.depth, zero);
                    inertias[corner.body].press(corner.at, flat, upright);
                    let impulse = &mut impulses[corner.body];
                    // r × (0, 0, push)
                    impulse.a.x = fma::<S>(corner.at.y, push, impulse.a.x);
                    impulse.a.y = fnma::<S>(corner.at.x, push, impulse.a.y);
                    impulse.l.z += push;
                }
            },
        )
    }
}
