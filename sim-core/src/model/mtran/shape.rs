//! Overlap of parts, and their height.
//!
//! A part is a prism along its axis, 1 mu high, over a D: a half disc of radius 0.5 mu, and a rectangle of 1 mu by 0.5 mu
//! that ends at the flat end. For the overlap of two parts the half circle is replaced by eight chords, so that each
//! part is a convex polyhedron of 22 points. The chords lie at most 0.0096 mu inside the circle. The test of
//! separating axes is exact for these polyhedra.

use super::Frame;
use super::geometry::{HALF, outward};
use nalgebra::Vector3;

/// Greatest depth of an overlap of two parts that is not a collision, mu.
pub const PENETRATION: f64 = 0.02;

/// Cosine and sine of 11.25°, 22.5° and 33.75°.
const C1: f64 = 0.980_785_280_403_230_4;
const S1: f64 = 0.195_090_322_016_128_25;
const C2: f64 = 0.923_879_532_511_286_7;
const S2: f64 = 0.382_683_432_365_089_8;
const C3: f64 = 0.831_469_612_302_545_2;
const S3: f64 = 0.555_570_233_019_602_2;
const D: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Corners of a part's D as multiples of [`HALF`]: along x, and along y away from the flat end.
const OUTLINE: [[f64; 2]; 11] = [
    [1.0, -1.0],
    [1.0, 0.0],
    [C2, S2],
    [D, D],
    [S2, C2],
    [0.0, 1.0],
    [-S2, C2],
    [-D, D],
    [-C2, S2],
    [-1.0, 0.0],
    [-1.0, -1.0],
];

/// Unit normals of the edges of the D, one of each two opposite ones. The directions of the edges are the same set,
/// and so are those of the D with y reversed.
const NORMALS: [[f64; 2]; 10] =
    [[1.0, 0.0], [0.0, 1.0], [C1, S1], [C3, S3], [S3, C3], [S1, C1], [-S1, C1], [-S3, C3], [-C3, S3], [-C1, S1]];

/// Least squared distance at which two parts can't overlap, mu²: the corners lie √0.75 mu from the centre of the axis.
const CLEAR: f64 = 3.0;

/// Squared length of the cross product of unit vectors below which they count as parallel.
const PARALLEL: f64 = 1e-12;

/// Returns the greatest extent of a part's polyhedron from its axis point along a unit direction, mu.
fn extent(frame: &Frame, part: u8, direction: &Vector3<f64>) -> f64 {
    let inner = frame.rotation.transpose() * direction;
    let (x, y) = (inner.x, -inner.y * outward(part));
    let in_plane = OUTLINE.iter().map(|p| p[0] * x + p[1] * y).fold(f64::NEG_INFINITY, f64::max);
    HALF * (in_plane + inner.z.abs())
}

/// Returns the directions of a part's edges in world coordinates. They are also the normals of its surfaces.
fn directions(frame: &Frame) -> [Vector3<f64>; 11] {
    let (x, y, z) = (frame.axis(0), frame.axis(1), frame.axis(2));
    let mut directions = [z; 11];
    for (direction, [a, b]) in directions[1..].iter_mut().zip(NORMALS) {
        *direction = x * a + y * b;
    }
    directions
}

/// Returns the depth of the overlap of two parts if it is greater than `allowed`, mu. A part is its frame and its
/// number, 0 or 1.
///
/// The depth is the least distance by which one part must be moved so that they no longer overlap.
pub fn penetration(a: (&Frame, u8), b: (&Frame, u8), allowed: f64) -> Option<f64> {
    let between = b.0.origin - a.0.origin;
    if between.norm_squared() >= CLEAR {
        return None;
    }
    let mut least = f64::INFINITY;
    let mut separates = |axis: &Vector3<f64>| {
        let gap = between.dot(axis);
        let ahead = extent(a.0, a.1, axis) + extent(b.0, b.1, &-axis) - gap;
        let behind = extent(a.0, a.1, &-axis) + extent(b.0, b.1, axis) + gap;
        least = least.min(ahead).min(behind);
        least <= allowed
    };
    let (of_a, of_b) = (directions(a.0), directions(b.0));
    if of_a.iter().chain(&of_b).any(&mut separates) {
        return None;
    }
    for p in &of_a {
        for q in &of_b {
            let across = p.cross(q);
            let squared = across.norm_squared();
            if squared > PARALLEL && separates(&(across / squared.sqrt())) {
                return None;
            }
        }
    }
    Some(least)
}

/// Returns the height of a part's lowest point, mu. Here the round side is exact.
pub fn lowest(frame: &Frame, part: u8) -> f64 {
    let down = -frame.rotation.row(2);
    let (x, y) = (down[0], -down[1] * outward(part));
    let in_plane = if y >= 0.0 { (x * x + y * y).sqrt() } else { x.abs() - y };
    frame.origin.z - HALF * (in_plane + down[2].abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Rotation3, Vector3};
    use proptest::prelude::*;

    fn at(x: f64, y: f64, z: f64, degrees: i32) -> Frame {
        Frame { origin: Vector3::new(x, y, z), ..Frame::turned(degrees) }
    }

    #[test]
    fn each_edge_has_its_unit_normal() {
        for (i, a) in OUTLINE.iter().enumerate() {
            let b = OUTLINE[(i + 1) % OUTLINE.len()];
            let edge = [b[0] - a[0], b[1] - a[1]];
            let fits = |n: &&[f64; 2]| (n[0] * edge[0] + n[1] * edge[1]).abs() < 1e-15;
            let normal = NORMALS.iter().find(fits).expect("a normal of the edge");
            assert!((normal[0] * normal[0] + normal[1] * normal[1] - 1.0).abs() < 1e-15, "{normal:?}");
        }
    }

    #[test]
    fn parts_that_touch_do_not_overlap() {
        let part = at(0.0, 0.0, 0.0, 0);
        for other in [at(1.0, 0.0, 0.0, 0), at(0.0, 1.0, 0.0, 90), at(0.0, 0.0, 1.0, 45), at(1.0, 1.0, 0.0, 0)] {
            assert_eq!(penetration((&part, 0), (&other, 1), 1e-12), None);
        }
    }

    #[test]
    fn depth_of_shifted_parts_is_their_shift() {
        let part = at(0.0, 0.0, 0.0, 0);
        for (other, depth) in
            [(at(0.0, 0.0, -0.75, 20), 0.25), (at(0.0, 0.9, 0.0, 180), 0.1), (at(0.0, -0.95, 0.0, 0), 0.05)]
        {
            let found = penetration((&part, 0), (&other, 1), 0.0).expect("they overlap");
            assert!((found - depth).abs() < 1e-12, "{found} instead of {depth}");
            assert_eq!(penetration((&part, 0), (&other, 1), depth + 1e-9), None);
        }
        let beside = penetration((&part, 0), (&at(0.9, 0.0, 0.0, 0), 1), 0.0).expect("they overlap");
        assert!(beside <= 0.1 && beside > 0.1 - 2.0 * 0.0096, "{beside}");
    }

    #[test]
    fn round_sides_pass_where_boxes_would_overlap() {
        let part = at(0.0, 0.0, 0.0, 0);
        let beyond_the_corner = at(0.8, 0.8, 0.0, 0);
        assert_eq!(penetration((&part, 0), (&beyond_the_corner, 1), 1e-9), None);
        let at_the_flat_end = at(0.8, -0.8, 0.0, 0);
        assert!(penetration((&part, 0), (&at_the_flat_end, 1), 1e-9).is_some());
    }

    #[test]
    fn parts_of_a_module_never_overlap() {
        for first in (-90..=90).step_by(5) {
            for second in (-90..=90).step_by(5) {
                let (a, b) = (at(0.0, 0.0, 0.0, first), at(0.0, 1.0, 0.0, second));
                assert_eq!(penetration((&a, 0), (&b, 1), 1e-9), None, "angles {first}° and {second}°");
            }
        }
    }

    /// Returns a number from −1 to 1 of a sequence that fills the range evenly.
    fn even(index: u32, ratio: f64) -> f64 {
        2.0 * (f64::from(index) * ratio).fract() - 1.0
    }

    /// Returns true if a point of a part's frame lies inside its D.
    fn holds(part: u8, p: &Vector3<f64>) -> bool {
        let y = -p.y * outward(part);
        let in_plane = if y < 0.0 { p.x.abs() < 0.5 && y > -0.5 } else { p.x * p.x + y * y < 0.25 };
        in_plane && p.z.abs() < 0.5
    }

    #[test]
    fn overlap_agrees_with_sampled_points() {
        let (mut overlapping, mut apart) = (0, 0);
        for i in 1..400 {
            let turn = Vector3::new(even(i, 0.618_034), even(i, 0.414_214), even(i, 0.732_051)) * 3.0;
            let origin = Vector3::new(even(i, 0.236_068), even(i, 0.645_751), even(i, 0.316_625)) * 1.1;
            let other = Frame { rotation: *Rotation3::new(turn).matrix(), origin };
            let parts = ((i % 2) as u8, (i / 2 % 2) as u8);
            let depth = penetration((&Frame::identity(), parts.0), (&other, parts.1), 0.0).unwrap_or(0.0);
            let inside = |k: u32| {
                let p = Vector3::new(even(k, 0.618_034), even(k, 0.754_878), even(k, 0.569_840)) * 0.5;
                holds(parts.0, &p) && holds(parts.1, &(other.rotation.transpose() * (p - other.origin)))
            };
            let shared = (0..8000).any(inside);
            // The round sides of the polyhedra lie at most 0.0096 mu inside those of the parts.
            assert!(
                !shared || penetration((&Frame::identity(), parts.0), (&other, parts.1), -0.02).is_some(),
                "pose {i}"
            );
            assert!(depth < 0.2 || shared, "pose {i}: depth {depth} without a shared point");
            overlapping += u32::from(depth >= 0.2);
            apart += u32::from(!shared);
        }
        assert!(overlapping > 50 && apart > 50, "{overlapping} overlap, {apart} do not");
    }

    #[test]
    fn lowest_point_is_round_or_flat() {
        let up = Matrix3::new(0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
        let frame = Frame { rotation: up, origin: Vector3::new(0.0, 0.0, 2.0) };
        assert_eq!((lowest(&frame, 0), lowest(&frame, 1)), (1.5, 1.5));
        let tilted = frame.then(&Frame::turned(45));
        assert!((lowest(&tilted, 1) - 1.5).abs() < 1e-12, "the round side of part 1 is below");
        assert!((lowest(&tilted, 0) - (2.0 - 0.5_f64.sqrt())).abs() < 1e-12, "a corner of part 0 is below");
    }

    proptest! {
        #[test]
        fn depth_is_symmetric_and_the_same_in_any_frame(
            shift in prop::array::uniform3(-1.5..1.5_f64), turn in prop::array::uniform3(-3.0..3.0_f64),
            world in prop::array::uniform3(-3.0..3.0_f64), parts in (0..2_u8, 0..2_u8),
        ) {
            let rotation = |r: [f64; 3]| *Rotation3::new(Vector3::from(r)).matrix();
            let (a, b) = (Frame::identity(), Frame { rotation: rotation(turn), origin: Vector3::from(shift) });
            let outer = Frame { rotation: rotation(world), origin: Vector3::new(3.0, -2.0, 1.0) };
            let depth = penetration((&a, parts.0), (&b, parts.1), 0.0).unwrap_or(0.0);
            let swapped = penetration((&b, parts.1), (&a, parts.0), 0.0).unwrap_or(0.0);
            let moved = penetration((&outer.then(&a), parts.0), (&outer.then(&b), parts.1), 0.0).unwrap_or(0.0);
            prop_assert!((depth - swapped).abs() < 1e-9, "{} {}", depth, swapped);
            prop_assert!((depth - moved).abs() < 1e-9, "{} {}", depth, moved);
        }
    }
}
