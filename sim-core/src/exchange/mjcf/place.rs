//! Poses of elements: `pos`, and one of five attributes for the orientation.

use super::compiler::Compiler;
use super::defaults::Defaults;
use crate::base::error::Invalid;
use crate::exchange::source::{exactly, foreign_attribute, numbers, rotation, turn};
use crate::exchange::tree::Frame;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use roxmltree::Node;

/// Attributes for an orientation. One that an element gives replaces any that its class gives.
pub(super) const SPELLINGS: [&str; 5] = ["quat", "euler", "axisangle", "xyaxes", "zaxis"];

/// Reads the pose of an element relative to the element around it. Only geoms have defaults.
pub(super) fn place<'a>(
    element: Node<'a, 'a>,
    class: &'a str,
    defaults: &Defaults<'a>,
    compiler: &Compiler,
) -> Result<Frame, Invalid> {
    let pos = defaults.get(element, class, "pos")?.unwrap_or("0 0 0");
    let origin = Vector3::from(exactly::<3>(element, "pos", pos)?);
    let rotation = match defaults.first(element, class, &SPELLINGS)? {
        Some((spelling, text)) => orientation(element, spelling, text, compiler)?,
        None => UnitQuaternion::identity(),
    };
    Ok(Frame { rotation, origin })
}

fn orientation(element: Node, spelling: &str, text: &str, compiler: &Compiler) -> Result<UnitQuaternion<f64>, Invalid> {
    match spelling {
        "quat" => rotation(element, exactly(element, spelling, text)?),
        "euler" => {
            let [x, y, z] = exactly::<3>(element, spelling, text)?.map(|angle| compiler.radians(angle));
            let about = |axis, angle| turn(element, axis, angle);
            Ok(about([1.0, 0.0, 0.0], x)? * about([0.0, 1.0, 0.0], y)? * about([0.0, 0.0, 1.0], z)?)
        }
        "axisangle" => {
            let [x, y, z, angle] = exactly(element, spelling, text)?;
            turn(element, [x, y, z], compiler.radians(angle))
        }
        "xyaxes" => {
            let [x0, x1, x2, y0, y1, y2] = numbers(element, spelling, text)?[..] else {
                return Err(foreign_attribute(element, spelling, "xyaxes: 6 numbers are needed"));
            };
            let x = Vector3::new(x0, x1, x2).normalize();
            let y = Vector3::new(y0, y1, y2);
            let y = (y - x * x.dot(&y)).normalize();
            if !(x.sum() + y.sum()).is_finite() {
                let reason = "xyaxes: two directions that are not parallel are needed";
                return Err(foreign_attribute(element, spelling, reason));
            }
            let matrix = Matrix3::from_columns(&[x, y, x.cross(&y)]);
            Ok(UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix)))
        }
        _ => {
            let z = Vector3::from(exactly::<3>(element, spelling, text)?).normalize();
            if !z.sum().is_finite() {
                return Err(foreign_attribute(
                    element,
                    spelling,
                    "the axis has no direction: its length must not be 0",
                ));
            }
            shortest_from_z(element, z)
        }
    }
}

/// Returns the shortest rotation from (0, 0, 1) to a unit vector: the quaternion of 1 + cos and the cross product.
pub(super) fn shortest_from_z(element: Node, to: Vector3<f64>) -> Result<UnitQuaternion<f64>, Invalid> {
    match to.z > -1.0 + 1e-12 {
        true => rotation(element, [1.0 + to.z, -to.y, to.x, 0.0]),
        false => rotation(element, [0.0, 1.0, 0.0, 0.0]),
    }
}
