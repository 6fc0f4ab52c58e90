//! Writer from robots to URDF.

use crate::base::math::{Rotation, Vector};
use crate::exchange::xml::{Attribute, Writer, triple};
use crate::model::{Body, Robot};
use crate::physics::Physics;

/// Speed limit of a joint without one, rad/s. URDF requires a limit; no motor reaches this one.
const VELOCITY: f32 = 1000.0;

/// Writes the robot in its neutral configuration. The root link is the pivot's body.
pub(in crate::exchange) fn write(robot: &Robot, physics: &Physics) -> String {
    let mut xml = Writer::new();
    xml.comment(&format!(
        "{}, written by evogait. Units: mu (one module length) for length, kg, s, rad; torque in kg mu^2/s^2.\n\
         URDF has no place for these: gravity {} mu/s^2, friction {} everywhere, motors with stiffness {} and\n\
         damping {} that give at most the effort of their joint. A velocity of {VELOCITY} stands for no limit.",
        robot.name, physics.gravity, physics.friction, physics.stiffness, physics.damping
    ));
    xml.open("robot", &[("name", robot.name.clone())]);
    for body in &robot.bodies {
        link(&mut xml, body);
    }
    for (i, hinge) in robot.hinges.iter().enumerate() {
        xml.open("joint", &[("name", hinge.name.clone()), ("type", "revolute".into())]);
        xml.leaf("parent", &[("link", robot.bodies[hinge.parent].name.clone())]);
        xml.leaf("child", &[("link", robot.bodies[i + 1].name.clone())]);
        xml.leaf("origin", &origin(hinge.anchor, Rotation::IDENTITY));
        xml.leaf("axis", &[("xyz", triple(hinge.axis))]);
        xml.leaf(
            "limit",
            &[
                ("lower", hinge.limits[0].to_string()),
                ("upper", hinge.limits[1].to_string()),
                ("effort", hinge.torque_or(physics.max_torque).to_string()),
                ("velocity", hinge.speed.unwrap_or(VELOCITY).to_string()),
            ],
        );
        xml.close();
    }
    xml.finish()
}

fn link(xml: &mut Writer, body: &Body) {
    xml.open("link", &[("name", body.name.clone())]);
    xml.open("inertial", &[]);
    xml.leaf("origin", &origin(body.center_of_mass, Rotation::IDENTITY));
    xml.leaf("mass", &[("value", body.mass.to_string())]);
    let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] = body.inertia;
    let moments = [("ixx", xx), ("ixy", xy), ("ixz", xz), ("iyy", yy), ("iyz", yz), ("izz", zz)];
    xml.leaf("inertia", &moments.map(|(name, moment)| (name, moment.to_string())));
    xml.close();
    // Visual and collision shapes are the same.
    for purpose in ["visual", "collision"] {
        for part in &body.boxes {
            xml.open(purpose, &[]);
            xml.leaf("origin", &origin(part.pose.translation, part.pose.rotation));
            xml.open("geometry", &[]);
            xml.leaf("box", &[("size", triple(part.half * 2.0))]);
            xml.close();
            xml.close();
        }
        for part in &body.capsules {
            let [a, b] = part.ends;
            let (along, length) = ((b - a).normalize(), (b - a).length());
            // The shortest rotation from z. A capsule may be turned end for end.
            let along = if along.z < 0.0 { -along } else { along };
            let turn = Rotation::from_xyzw(-along.y, along.x, 0.0, 1.0 + along.z).normalize();
            xml.open(purpose, &[]);
            xml.leaf("origin", &origin((a + b) * 0.5, turn));
            xml.open("geometry", &[]);
            xml.leaf("capsule", &[("radius", part.radius.to_string()), ("length", length.to_string())]);
            xml.close();
            xml.close();
        }
    }
    xml.close();
}

fn origin(at: Vector, rotation: Rotation) -> [Attribute; 2] {
    let [roll, pitch, yaw] = roll_pitch_yaw(rotation).map(|angle| angle + 0.0); // avoids "-0"
    [("xyz", triple(at)), ("rpy", format!("{roll} {pitch} {yaw}"))]
}

/// Returns the rotations about the fixed x, then y, then z axis, rad.
fn roll_pitch_yaw(rotation: Rotation) -> [f64; 3] {
    if rotation == Rotation::IDENTITY {
        return [0.0; 3];
    }
    let quaternion = [rotation.x, rotation.y, rotation.z, rotation.w].map(f64::from);
    let length = quaternion.iter().map(|v| v * v).sum::<f64>().sqrt();
    let [x, y, z, w] = quaternion.map(|v| v / length);
    // Entries of the rotation matrix R = Rz(yaw) · Ry(pitch) · Rx(roll).
    let (r00, r10) = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w));
    let (r20, r21, r22) = (2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y));
    let flat = (r00 * r00 + r10 * r10).sqrt();
    let pitch = libm::atan2(-r20, flat);
    if flat < 1e-7 {
        // At a pitch of ±90° roll and yaw turn about the same axis: the whole turn is written as roll.
        let (r01, r11) = (2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z));
        return [libm::atan2(if pitch > 0.0 { r01 } else { -r01 }, r11), pitch, 0.0];
    }
    [libm::atan2(r21, r22), pitch, libm::atan2(r10, r00)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::{about, angle_between};

    #[test]
    fn roll_pitch_yaw_reproduce_the_rotation() {
        let turns = [-3.0f32, -1.5707964, -0.4, 0.0, 0.7, 1.5707964, 3.1];
        for (roll, pitch, yaw) in turns.iter().flat_map(|r| turns.iter().flat_map(move |p| turns.map(|y| (*r, *p, y))))
        {
            let turned = |[r, p, y]: [f32; 3]| about(Vector::Z, y) * about(Vector::Y, p) * about(Vector::X, r);
            let rotation = turned([roll, pitch, yaw]);
            let again = turned(roll_pitch_yaw(rotation).map(|a| a as f32));
            assert!(angle_between(rotation, again) < 1e-6, "{roll} {pitch} {yaw}");
        }
    }
}
