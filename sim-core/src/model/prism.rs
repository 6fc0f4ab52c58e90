//! Convex prisms: collision shapes with a convex outline, such as the D-shaped parts of M-TRAN modules.

use super::kind::{D_EDGES, PartShape};
use crate::base::math::{Pose, Vector};
use nalgebra::{Matrix3, Vector3};
use rapier3d::geometry::SharedShape;
use rapier3d::parry::shape::ConvexPolyhedron;
use std::fmt;

/// Convex prism in a body's frame.
#[derive(Clone)]
pub struct CollisionPrism {
    corners: Vec<Vector>,
    shape: SharedShape,
}

impl fmt::Debug for CollisionPrism {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CollisionPrism").field("corners", &self.corners).finish_non_exhaustive()
    }
}

impl CollisionPrism {
    /// Creates a prism along z between −`half` and `half`, mu, at a pose in the body's frame. The outline lists its
    /// corners (x, y) counter-clockwise, mu.
    ///
    /// # Panics
    /// If the outline has fewer than 3 corners, or is not convex.
    pub(super) fn new(outline: &[[f64; 2]], half: f64, pose: &Pose) -> Self {
        let corner = |z: f64| move |&[x, y]: &[f64; 2]| *pose * Vector::new(x as f32, y as f32, z as f32);
        let corners: Vec<Vector> = outline.iter().map(corner(-half)).chain(outline.iter().map(corner(half))).collect();
        let points = corners.clone();
        let polyhedron = ConvexPolyhedron::from_convex_mesh(points, &triangles(outline.len() as u32))
            .expect("the outline of a prism is convex and has at least 3 corners");
        Self { corners, shape: SharedShape::new(polyhedron) }
    }

    /// Returns its corners: those of the lower outline, then those of the upper one, in the body's frame, mu.
    pub fn corners(&self) -> &[Vector] {
        &self.corners
    }

    /// Returns the shape for the collision library, in the body's frame.
    pub(crate) fn shape(&self) -> &SharedShape {
        &self.shape
    }

    /// Returns the polyhedron for intersection tests, in the body's frame.
    pub(crate) fn polyhedron(&self) -> &ConvexPolyhedron {
        self.shape.as_convex_polyhedron().expect("a prism is a convex polyhedron")
    }
}

/// Returns the triangles of a prism with `n` corners a side, counter-clockwise seen from outside.
fn triangles(n: u32) -> Vec<[u32; 3]> {
    let lower = (2..n).map(|i| [0, i, i - 1]);
    let upper = (2..n).map(|i| [n, n + i - 1, n + i]);
    let sides = (0..n).flat_map(|i| {
        let j = (i + 1) % n;
        [[i, j, n + j], [i, n + j, n + i]]
    });
    lower.chain(upper).chain(sides).collect()
}

/// Returns the outline of a D-shaped part of a radius, mu, counter-clockwise, as [`PartShape::RoundAhead`] describes it;
/// `None` for other shapes.
pub(super) fn d_outline(shape: PartShape, radius: f64) -> Option<Vec<[f64; 2]>> {
    let ahead = match shape {
        PartShape::RoundAhead => 1.0,
        PartShape::RoundBehind => -1.0,
        PartShape::Box | PartShape::None => return None,
    };
    let mut outline = vec![[-radius, -radius], [radius, -radius], [radius, 0.0]];
    outline.extend((1..D_EDGES).map(|i| {
        let angle = std::f64::consts::PI * i as f64 / D_EDGES as f64;
        [radius * libm::cos(angle), radius * libm::sin(angle)]
    }));
    outline.push([-radius, 0.0]);
    // A half turn about z keeps the order of the corners.
    Some(outline.into_iter().map(|[x, y]| [x * ahead, y * ahead]).collect())
}

/// Returns centre of mass, mu, and inertia about it, kg·mu², of an even D-shaped part with a smooth round half: a
/// rectangle and half a disc (closed form). `ahead` is 1 if the round half is on the side of +y, −1 otherwise.
pub(super) fn d_mass(radius: f64, half: f64, mass: f64, ahead: f64) -> (Vector3<f64>, Matrix3<f64>) {
    let (r, square) = (radius, radius * radius);
    let areas = [2.0 * square, 0.5 * std::f64::consts::PI * square];
    let centroids = [-0.5 * r, 4.0 * r / (3.0 * std::f64::consts::PI)];
    let whole = areas[0] + areas[1];
    let center = (areas[0] * centroids[0] + areas[1] * centroids[1]) / whole;
    // Second moments of the area about the centre, a unit of area each.
    let xx = (areas[0] * square / 3.0 + areas[1] * square / 4.0) / whole;
    let own = [square / 12.0, square / 4.0 - centroids[1] * centroids[1]];
    let yy =
        (0..2).map(|i| areas[i] * (own[i] + (centroids[i] - center) * (centroids[i] - center))).sum::<f64>() / whole;
    let zz = half * half / 3.0;
    let inertia = Vector3::new(yy + zz, xx + zz, xx + yy) * mass;
    (Vector3::new(0.0, center * ahead, 0.0), Matrix3::from_diagonal(&inertia))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The outline goes once around counter-clockwise, lies within the box, and is convex.
    #[test]
    fn outline_of_d_is_convex_and_in_its_box() {
        for shape in [PartShape::RoundAhead, PartShape::RoundBehind] {
            let outline = d_outline(shape, 0.5).unwrap();
            let at = |i: usize| outline[i % outline.len()];
            for i in 0..outline.len() {
                let ([ax, ay], [bx, by], [cx, cy]) = (at(i), at(i + 1), at(i + 2));
                let turn = (bx - ax) * (cy - by) - (by - ay) * (cx - bx);
                assert!(turn > -1e-12, "corner {} of {shape:?}", i + 1);
                assert!(at(i).iter().all(|v| v.abs() <= 0.5 + 1e-12));
            }
        }
        assert_eq!(d_outline(PartShape::Box, 0.5), None);
    }

    /// The sum over a fine grid of points is the closed form.
    #[test]
    fn mass_of_d_equals_sum_over_points() {
        let (radius, half, mass) = (0.5, 0.4, 3.0);
        let (center, inertia) = d_mass(radius, half, mass, 1.0);
        let n = 400;
        let at = |i: usize, size: f64| (i as f64 + 0.5) / n as f64 * 2.0 * size - size;
        let inside: Vec<[f64; 2]> = (0..n * n)
            .map(|i| [at(i % n, radius), at(i / n, radius)])
            .filter(|[x, y]| *y < 0.0 || x * x + y * y < radius * radius)
            .collect();
        let mean =
            |f: &dyn Fn(f64, f64) -> f64| inside.iter().map(|&[x, y]| f(x, y)).sum::<f64>() / inside.len() as f64;
        let y = mean(&|_, y| y);
        let (xx, yy, zz) = (mean(&|x, _| x * x), mean(&|_, v| (v - y) * (v - y)), half * half / 3.0);
        assert!((center.y - y).abs() < 1e-4 && center.x == 0.0 && center.z == 0.0, "{center}");
        for (i, sum) in [yy + zz, xx + zz, xx + yy].into_iter().enumerate() {
            assert!((inertia[(i, i)] - mass * sum).abs() < 1e-3 * mass * sum, "moment {i}");
        }
        assert_eq!(d_mass(radius, half, mass, -1.0).0.y, -center.y);
    }

    /// All triangles face outward: the prism's volume by the divergence theorem is that of its outline.
    #[test]
    fn triangles_of_prism_face_outward() {
        let outline = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let prism = CollisionPrism::new(&outline, 0.5, &Pose::identity());
        let volume: f32 = triangles(4)
            .iter()
            .map(|t| t.map(|i| prism.corners()[i as usize]))
            .map(|[a, b, c]| a.dot(b.cross(c)) / 6.0)
            .sum();
        assert!((volume - 4.0).abs() < 1e-5, "{volume}");
    }
}
