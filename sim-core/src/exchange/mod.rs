//! Import and export of robots: MJCF (MuJoCo) and URDF (ROS). The functions take and return text; callers read and
//! write the files.
//!
//! One unit of length in a file is 1 mu, unless the caller gives another unit. Numbers are written so that reading them
//! gives the same bits.
//!
//! D-shaped parts are written as convex meshes in MJCF, which is not read back. URDF has no place for them.
//!
//! An imported robot is a tree of hinges from −90° to 90° with boxes and capsules on its bodies. Every element and
//! attribute is read, ignored by the format's schema, or refused with its line. Gravity, friction and motors are not
//! part of the robot: they come from a job's `[physics]`.

mod mjcf;
mod names;
mod schema;
mod source;
mod tree;
mod urdf;
mod xml;

use self::tree::Tree;
use crate::base::error::{Faults, Invalid};
use crate::model::{Robot, RobotSpec};
use crate::physics::Physics;

/// Format that a robot can be written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// MuJoCo's XML: the robot on flat ground, with its motors and its friction, ready for simulation.
    Mjcf,
    /// Unified Robot Description Format: links and joints. It has no place for friction and gains.
    Urdf,
}

impl Format {
    /// Writes the robot, with the gravity, friction and motors of `physics`, as text of this format.
    ///
    /// # Errors
    /// If the format has no place for a shape of the robot.
    pub fn write(self, robot: &Robot, physics: &Physics) -> Result<String, Unwritable> {
        match self {
            Self::Mjcf => Ok(mjcf::write(robot, physics)),
            Self::Urdf if robot.bodies.iter().any(|body| !body.prisms.is_empty()) => Err(Unwritable),
            Self::Urdf => Ok(urdf::write(robot, physics)),
        }
    }
}

/// Error of a robot that a format can't describe.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("URDF describes D-shaped parts only by mesh files, which evogait does not write: export the robot as MJCF")]
pub struct Unwritable;

/// Robot from another format.
#[derive(Clone, Debug, PartialEq)]
pub struct Import {
    /// The robot.
    pub robot: RobotSpec,
    /// Notes for the user: content that was ignored, and names that were changed.
    pub notes: Vec<String>,
}

/// Reads a robot from MJCF or URDF. The root element determines the format.
///
/// # Errors
/// If the robot has content that can't be imported. The error gives the line, the element and what is allowed for each.
pub fn read(text: &str) -> Result<Import, Invalid> {
    read_in(text, 1.0)
}

/// Reads a robot as [`read`] does, with 1 mu for every `unit` of length in the file.
///
/// # Errors
/// As [`read`].
pub fn read_in(text: &str, unit: f64) -> Result<Import, Invalid> {
    let document = source::parse(text)?;
    let root = document.root_element();
    match source::tag(root) {
        "mujoco" => mjcf::read(root, unit),
        "robot" => urdf::read(root, unit),
        _ => Err(source::foreign(root, "this is not a robot file: MJCF begins with <mujoco>, URDF with <robot>")),
    }
}

/// Returns the robot of a tree if there are no faults. The robot is checked like any robot file; its faults get lines.
fn finish(
    mut tree: Tree,
    unit: f64,
    mut faults: Faults,
    notes: impl IntoIterator<Item = String>,
) -> Result<Import, Invalid> {
    if unit != 1.0 {
        tree.robot = tree.robot.in_units_of(unit);
    }
    if faults.is_empty()
        && let Err(fault) = Robot::compile(&tree.robot)
    {
        let all = match fault {
            Invalid::Several(all) => all,
            one => vec![one],
        };
        all.into_iter().for_each(|fault| faults.add(located(fault, &tree)));
    }
    faults.end()?;
    Ok(Import { robot: tree.robot, notes: notes.into_iter().collect() })
}

/// Converts a fault of a body to a fault of the element that the body was read from.
fn located(fault: Invalid, tree: &Tree) -> Invalid {
    let text = fault.to_string();
    let found = text.strip_prefix("robot.body[").and_then(|rest| {
        let (index, rest) = rest.split_once("].")?;
        Some((tree.elements.get(index.parse::<usize>().ok()?)?, rest))
    });
    match found {
        Some((element, rest)) => source::foreign(*element, rest),
        None => fault,
    }
}
