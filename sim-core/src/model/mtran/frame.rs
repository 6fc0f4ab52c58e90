//! Rigid frames, and rotations by whole degrees.

use nalgebra::{Matrix3, Vector3};

/// Rigid frame: a rotation and an origin, in the coordinates of an outer frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Rotation. Its columns are the frame's x, y and z axis in outer coordinates.
    pub rotation: Matrix3<f64>,
    /// Origin in outer coordinates, mu.
    pub origin: Vector3<f64>,
}

impl Frame {
    /// Returns the frame that is the outer frame itself.
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), origin: Vector3::zeros() }
    }

    /// Returns the frame at `origin` whose y and z axis have these directions. Both must be unit vectors and
    /// perpendicular; x = y × z.
    pub fn of_axes(origin: Vector3<f64>, y: Vector3<f64>, z: Vector3<f64>) -> Self {
        Self { rotation: Matrix3::from_columns(&[y.cross(&z), y, z]), origin }
    }

    /// Returns the frame turned about z by so many degrees, by the right-hand rule.
    pub fn turned(degrees: i32) -> Self {
        let (s, c) = sin_cos(degrees);
        let rotation = Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0);
        Self { rotation, origin: Vector3::zeros() }
    }

    /// Returns the frame moved along y by a distance, mu.
    pub fn along_y(distance: f64) -> Self {
        Self { rotation: Matrix3::identity(), origin: Vector3::new(0.0, distance, 0.0) }
    }

    /// Returns a point of this frame in outer coordinates.
    pub fn point(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * p + self.origin
    }

    /// Returns a direction of this frame in outer coordinates.
    pub fn direction(&self, d: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * d
    }

    /// Returns a frame that is given in this frame, in outer coordinates.
    pub fn then(&self, inner: &Frame) -> Frame {
        Frame { rotation: self.rotation * inner.rotation, origin: self.point(&inner.origin) }
    }

    /// Returns the outer frame in this frame's coordinates.
    pub fn inverse(&self) -> Frame {
        let rotation = self.rotation.transpose();
        Frame { rotation, origin: -(rotation * self.origin) }
    }

    /// Returns the axis of an index: 0 is x, 1 is y, 2 is z.
    pub fn axis(&self, index: usize) -> Vector3<f64> {
        self.rotation.column(index).into_owned()
    }
}

/// Returns sine and cosine of so many degrees: the nearest `f64` for multiples of 30°, from `libm` otherwise.
fn sin_cos(degrees: i32) -> (f64, f64) {
    let sine = |degrees: i32| {
        let turn = degrees.rem_euclid(360);
        let (sign, half) = if turn < 180 { (1.0, turn) } else { (-1.0, turn - 180) };
        sign * match half {
            0 => 0.0,
            30 | 150 => 0.5,
            60 | 120 => 0.75_f64.sqrt(),
            90 => 1.0,
            other => libm::sin(f64::from(other).to_radians()),
        }
    };
    (sine(degrees), sine(degrees + 90))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_and_cosines_match_libm() {
        for degrees in -720..=720 {
            let (s, c) = sin_cos(degrees);
            let radians = f64::from(degrees).to_radians();
            assert!((s - libm::sin(radians)).abs() < 1e-14, "sine of {degrees}°: {s}");
            assert!((c - libm::cos(radians)).abs() < 1e-14, "cosine of {degrees}°: {c}");
        }
    }

    #[test]
    fn quarter_turns_are_exact() {
        let quarter = Frame::turned(90);
        let whole = (0..4).fold(Frame::identity(), |frame, _| frame.then(&quarter));
        assert_eq!(whole, Frame::identity());
        assert_eq!(quarter.direction(&Vector3::x()), Vector3::y());
    }

    #[test]
    fn frame_after_its_inverse_is_identity() {
        let frame = Frame::along_y(1.0).then(&Frame::turned(30)).then(&Frame::along_y(-2.5));
        let both = frame.inverse().then(&frame);
        assert!((both.rotation - Matrix3::identity()).norm() < 1e-15 && both.origin.norm() < 1e-15);
    }
}
