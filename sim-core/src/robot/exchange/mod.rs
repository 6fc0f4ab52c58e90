//! Robots in the formats of others: MJCF (MuJoCo's) and URDF (ROS's). Text only; who reads and writes files is
//! elsewhere.
//!
//! One unit of length in a file is 1 mu. Numbers are written so that reading them gives the same bits.
//!
//! What is imported is a tree of hinges from −90° to 90° with boxes and capsules on its bodies. Everything that a robot
//! here can't have is refused by name. Gravity, friction and motors are not the robot's: they are a job's `[physics]`.

mod mjcf;
mod source;
mod tree;
mod urdf;
mod xml;

use super::{Robot, RobotSpec};
use crate::error::Invalid;
use crate::rollout::Physics;

/// A format that a robot can be written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// MuJoCo's XML: the robot on flat ground, with its motors and its friction, ready to be simulated.
    Mjcf,
    /// The Unified Robot Description Format: links and joints; friction and gains have no place in it.
    Urdf,
}

impl Format {
    /// The robot, with the gravity, friction and motors of `physics`, as text of this format.
    pub fn write(self, robot: &Robot, physics: &Physics) -> String {
        match self {
            Self::Mjcf => mjcf::write(robot, physics),
            Self::Urdf => urdf::write(robot, physics),
        }
    }
}

/// A robot from MJCF or URDF; the root element tells which it is.
///
/// # Errors
/// Names the line, the element and what is allowed where it holds something that robots here can't have.
pub fn read(text: &str) -> Result<RobotSpec, Invalid> {
    let document = source::parse(text)?;
    let root = document.root_element();
    match source::tag(root) {
        "mujoco" => mjcf::read(&document),
        "robot" => urdf::read(root),
        _ => Err(source::foreign(root, "this is no robot: MJCF begins with <mujoco>, URDF with <robot>")),
    }
}
