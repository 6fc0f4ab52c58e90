//! Poses and headings in rapier's f32 types. All trigonometry comes from `libm`.

pub use rapier3d::math::{Pose, Rotation, Vector};

/// Returns the rotation by `angle` rad about a unit `axis`.
pub fn about(axis: Vector, angle: f32) -> Rotation {
    let (s, c) = (libm::sinf(angle * 0.5), libm::cosf(angle * 0.5));
    Rotation::from_xyzw(axis.x * s, axis.y * s, axis.z * s, c)
}

/// Returns the rotation by `angle` rad about z.
pub fn about_z(angle: f64) -> Rotation {
    Rotation::from_xyzw(0.0, 0.0, libm::sin(angle * 0.5) as f32, libm::cos(angle * 0.5) as f32)
}

/// Returns the heading of a rotation in (−π, π]: its twist about z. Returns 0 where the twist is undefined: after an
/// exact half turn about a horizontal axis.
pub fn heading(rotation: Rotation) -> f64 {
    if rotation.z == 0.0 && rotation.w == 0.0 {
        return 0.0;
    }
    wrap(2.0 * libm::atan2(f64::from(rotation.z), f64::from(rotation.w)))
}

/// Returns the angle wrapped into (−π, π].
pub fn wrap(angle: f64) -> f64 {
    use std::f64::consts::PI;
    if angle > -PI && angle <= PI {
        return angle;
    }
    let turned = angle - 2.0 * PI * libm::floor((angle + PI) / (2.0 * PI));
    if turned <= -PI || turned > PI { PI } else { turned }
}

/// Returns the angle in (−π, π] of a rotation about the unit `axis`. The rotation must have no part about other axes.
pub fn angle_about(rotation: Rotation, axis: Vector) -> f32 {
    let along = rotation.x * axis.x + rotation.y * axis.y + rotation.z * axis.z;
    // q and −q are the same rotation. The one with w ≥ 0 keeps the angle within a half turn.
    let (along, w) = if rotation.w < 0.0 { (-along, -rotation.w) } else { (along, rotation.w) };
    2.0 * libm::atan2f(along, w)
}

/// Returns the angle between two rotations, rad.
pub fn angle_between(a: Rotation, b: Rotation) -> f32 {
    let d = a.inverse() * b;
    let sine = (d.x * d.x + d.y * d.y + d.z * d.z).sqrt();
    2.0 * libm::atan2f(sine, d.w.abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::PI;

    #[test]
    fn heading_ignores_tilt_about_horizontal_axis() {
        for yaw in [-3.0, -1.0, 0.0, 0.5, 3.1] {
            let tilt = about(Vector::new(0.6, 0.8, 0.0), 0.9);
            assert!((heading(about_z(yaw) * tilt) - yaw).abs() < 1e-6);
        }
        assert_eq!(heading(Rotation::from_xyzw(1.0, 0.0, 0.0, 0.0)), 0.0);
    }

    #[test]
    fn wrapped_angle_is_equivalent_and_in_range() {
        for turns in -3..=3 {
            for angle in [-3.0, 0.0, 2.0, std::f64::consts::PI] {
                let wrapped = wrap(angle + f64::from(turns) * 2.0 * std::f64::consts::PI);
                assert!((wrapped - angle).abs() < 1e-9, "{angle} {turns} {wrapped}");
            }
        }
        assert_eq!(wrap(-std::f64::consts::PI), std::f64::consts::PI);
    }

    #[test]
    fn angle_of_rotation_about_axis_is_recovered() {
        let axis = Vector::new(0.0, 0.6, 0.8);
        for angle in [-PI / 2.0, -0.3, 0.0, 1.2] {
            assert!((angle_about(about(axis, angle), axis) - angle).abs() < 1e-6);
            assert!((angle_between(Rotation::IDENTITY, about(axis, angle)) - angle.abs()).abs() < 1e-6);
        }
    }
}
