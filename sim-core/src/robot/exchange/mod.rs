//! Robots in the formats of others: MJCF (MuJoCo's) and URDF (ROS's). Text only; who reads and writes files is elsewhere.
//!
//! One unit of length in a file is 1 mu. Numbers are written so that reading them gives the same bits.

mod mjcf;
mod urdf;
mod xml;

use super::Robot;
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
