//! Robot files of M-TRAN configurations, and back.

use super::{Angle, Configuration, Connection, Place, PlaceError, Port};
use crate::base::random::{Purpose, Stream};
use crate::model::{Attachment, ModuleSpec, PoseSpec, Robot, RobotSpec};
use nalgebra::Vector3;

/// Name of the module kind.
pub const KIND: &str = "mtran";

/// Error of a configuration that a robot file can't hold.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotARobot {
    /// A part is turned.
    #[error(
        "module {module} starts with part {part} at {degrees} degrees: a robot file holds modules with both angles 0; \
         start from 0 and turn the part by a segment"
    )]
    Angle {
        /// Number of the module.
        module: usize,
        /// Number of the part.
        part: usize,
        /// Its angle.
        degrees: i32,
    },
    /// The connections form a loop.
    #[error(
        "the connections form a loop, which {first} and {second} close: a robot file holds modules that form a tree; \
         move a module so that these faces do not meet"
    )]
    Loop {
        /// A face.
        first: String,
        /// The face that it is connected to.
        second: String,
    },
}

/// Greatest number of configurations that are drawn for one whose connections form a tree.
pub const MAX_DRAWS: u32 = 1000;

/// Draws a random connected configuration of `modules` modules on the ground, from a seed. Its connections form a tree
/// (as robot files need it), if one is found in [`MAX_DRAWS`] draws.
///
/// # Errors
/// If there are no or too many modules, or no place is found for one.
pub fn drawn(modules: usize, seed: u64) -> Result<Configuration, super::RandomError> {
    let mut stream = Stream::new(seed, Purpose::Configuration, modules as u32, 0, 0);
    let mut draw = || super::random(modules, &mut |n| stream.below(n));
    let mut drawn = draw()?;
    for _ in 1..MAX_DRAWS {
        if drawn.connections().len() + 1 == modules {
            break;
        }
        drawn = draw()?;
    }
    Ok(drawn)
}

impl Configuration {
    /// Returns the robot file of the configuration. Module i is named i, and the pivot is the link of module 0.
    ///
    /// # Errors
    /// If a part is turned, or the connections form a loop.
    pub fn robot(&self, name: &str, description: &str) -> Result<RobotSpec, NotARobot> {
        for (module, angles) in self.angles().iter().enumerate() {
            if let Some(part) = angles.iter().position(|angle| *angle != Angle::default()) {
                return Err(NotARobot::Angle { module, part, degrees: angles[part].degrees() });
            }
        }
        let mut modules =
            vec![ModuleSpec { name: "0".into(), kind: KIND.into(), attach: None, pose: Some(self.pose()) }];
        modules.extend((1..self.len()).map(|i| ModuleSpec {
            name: i.to_string(),
            kind: KIND.into(),
            attach: None,
            pose: None,
        }));
        let mut used: Vec<Connection> = Vec::new();
        let mut reached = vec![0];
        let mut at = 0;
        while at < reached.len() {
            let carrier = reached[at];
            for &(a, b) in self.connections() {
                let (to, own) = if a.module == carrier { (a, b) } else { (b, a) };
                if to.module == carrier && !reached.contains(&own.module) {
                    modules[own.module as usize].attach = Some(self.attachment(to, own));
                    reached.push(own.module);
                    used.push((a, b));
                }
            }
            at += 1;
        }
        if let Some((a, b)) = self.connections().iter().find(|connection| !used.contains(connection)) {
            let [first, second] = [*a, *b].map(super::describe_port);
            return Err(NotARobot::Loop { first, second });
        }
        Ok(RobotSpec {
            name: name.to_owned(),
            description: description.to_owned(),
            pivot: "0/link".into(),
            failed: Vec::new(),
            variants: Default::default(),
            modules,
            bodies: Vec::new(),
        })
    }

    /// Returns the configuration of a robot of M-TRAN modules in its neutral configuration: `None` if a module is of
    /// another kind. All faces that meet and may connect count as connected.
    ///
    /// # Errors
    /// If modules overlap, or there are too many.
    pub fn of_robot(robot: &Robot) -> Option<Result<Self, PlaceError>> {
        if robot.modules.is_empty() || robot.modules.iter().any(|module| module.kind.name != KIND) {
            return None;
        }
        let links = robot.parts.chunks(robot.modules[0].kind.parts.len());
        let place = |parts: &[crate::model::PartBox]| {
            let [first, second] = [&parts[0], &parts[2]].map(|part| Vector3::from(part.center));
            let [x, y, z, w] = parts[1].rotation;
            let axis = [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)];
            // Lattice directions and distances: rounding removes the errors of quaternions.
            let tidy = |value: f64| libm::round(value * 1e6) / 1e6 + 0.0;
            Place {
                position: first.map(tidy).into(),
                z: axis.map(tidy),
                y: (second - first).map(tidy).into(),
                angles: [Angle::default(); 2],
            }
        };
        Some(Self::of_places(&links.map(place).collect::<Vec<_>>()))
    }

    /// Returns the pose of module 0 in a robot file: the middle of its link, and rotations about x, then y, then z.
    fn pose(&self) -> PoseSpec {
        let link = &self.links()[0];
        let middle = link.origin + link.axis(1) * 0.5;
        let r = &link.rotation;
        // R = Rx(a) Ry(b) Rz(c).
        let sine = r[(0, 2)].clamp(-1.0, 1.0);
        let turns = if sine.abs() > 1.0 - 1e-9 {
            [libm::atan2(r[(2, 1)], r[(1, 1)]), libm::asin(sine), 0.0]
        } else {
            [libm::atan2(-r[(1, 2)], r[(2, 2)]), libm::asin(sine), libm::atan2(-r[(0, 1)], r[(0, 0)])]
        };
        let degrees = |angle: f64| libm::round(angle.to_degrees() * 1e9) / 1e9 + 0.0;
        PoseSpec { position: middle.into(), rotation: turns.map(degrees) }
    }

    /// Returns the attachment of a module by its own face to a face of another module.
    fn attachment(&self, to: Port, own: Port) -> Attachment {
        let up = |port: Port| {
            let part = self.part(port.module as usize, port.part);
            if port.face == 0 { part.axis(2) } else { part.axis(1) }
        };
        let (normal, a, b) = (self.face(to).normal, up(to), up(own));
        // At turn 0 the up directions agree; a turn is about the carrier's normal.
        let turn = libm::round(libm::atan2(normal.dot(&a.cross(&b)), a.dot(&b)).to_degrees()) as i32;
        let named = |port: Port| format!("{}/{}", port.part, port.face);
        Attachment { to: to.module.to_string(), face: named(to), own: Some(named(own)), turn: turn.rem_euclid(360) }
    }
}

#[cfg(test)]
mod tests {
    use super::super::geometry::{FACES, PARTS};
    use super::*;
    use nalgebra::Matrix3;

    #[test]
    fn ports_are_the_faces_of_the_kind() {
        let kind = <crate::model::ModuleKind as crate::base::registry::Registered>::registry().find(KIND).unwrap();
        let names: Vec<String> =
            (0..PARTS).flat_map(|part| (0..FACES).map(move |face| format!("{part}/{face}"))).collect();
        assert_eq!(kind.faces.iter().map(|face| face.name).collect::<Vec<_>>(), names);
        for (face, name) in kind.faces.iter().zip(&names) {
            let (part, number) = (name.as_bytes()[0] - b'0', name.as_bytes()[2] - b'0');
            let link = super::super::Frame { rotation: Matrix3::identity(), origin: Vector3::new(0.0, -0.5, 0.0) };
            let expected = super::super::face_of_part(&super::super::part_of_link(&link, part, 0), part, number);
            // The kind's boxes are smaller than the faces' places by half of the gap between docked modules.
            assert!((expected.position - Vector3::from(face.position)).norm() < 1e-9, "{name}");
            assert!((expected.normal - Vector3::from(face.normal)).norm() < 1e-9, "{name}");
        }
    }

    /// 200 random robots: robot file, compiled robot, and configuration again.
    #[test]
    fn configuration_becomes_robot_and_back() {
        for seed in 0..200 {
            let configuration = drawn(2 + seed as usize % 6, seed).unwrap();
            let spec = configuration.robot("random", "").unwrap_or_else(|e| panic!("seed {seed}: {e}"));
            let robot = Robot::compile(&spec).unwrap_or_else(|e| panic!("seed {seed}: {e}"));
            assert_eq!(robot.hinges.len(), 2 * configuration.len());
            let again = Configuration::of_robot(&robot).unwrap().unwrap_or_else(|e| panic!("seed {seed}: {e}"));
            assert_eq!(again.connections(), configuration.connections(), "seed {seed}");
            let origin = |c: &Configuration| c.links()[0].origin + c.links()[0].axis(1) * 0.5;
            for (a, b) in again.links().iter().zip(configuration.links()) {
                assert!((a.rotation - b.rotation).norm() < 1e-6, "seed {seed}");
                let (a, b) = (a.origin - origin(&again), b.origin - origin(&configuration));
                assert!((a - b).norm() < 1e-5, "seed {seed}: {a} {b}");
            }
        }
    }
}
