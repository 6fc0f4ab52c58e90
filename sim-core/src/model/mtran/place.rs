//! Places of modules, and the errors of configurations.

use super::Frame;
use super::configuration::describe_port;
use super::{Angle, Port};
use nalgebra::Vector3;

/// Greatest number of modules of a configuration.
pub const MAX_MODULES: usize = 64;

/// Greatest size of a coordinate of a position, mu.
pub const MAX_COORDINATE: f64 = 1000.0;

/// Greatest error of the length of an axis, and of the cosine of the angle between two axes.
pub const UNIT_TOLERANCE: f64 = 1e-6;

/// Error below which axes are used as they are. Otherwise they are made unit and perpendicular. So a place that was
/// printed gives the same frame again.
const EXACT: f64 = 1e-12;

/// Place of a module: its initial state (Yoshida et al. 2003, section 2.2 A).
///
/// `position`, `z` and `y` are those of the link, also if the angle of part 0 is not 0: the paper calls them "the
/// directions of the rotational axis and link of part 0". They do not turn with part 0. The direction of part 0
/// itself follows from them and `angles[0]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Centre of the rotational axis of part 0 in the world, mu. Each coordinate is at most [`MAX_COORDINATE`] in size.
    pub position: [f64; 3],
    /// Direction of both rotational axes in the world, a unit vector.
    pub z: [f64; 3],
    /// Direction of the link, from the axis of part 0 to that of part 1, a unit vector perpendicular to `z`.
    pub y: [f64; 3],
    /// Angles of part 0 and part 1 relative to the link.
    pub angles: [Angle; 2],
}

impl Place {
    /// Returns the frame of the link of module `module`. Axes with an error up to [`UNIT_TOLERANCE`] are made unit and
    /// perpendicular; z keeps its direction.
    ///
    /// # Errors
    ///
    /// A number is not finite or a coordinate too large, or the axes are not unit or not perpendicular.
    pub(super) fn link(&self, module: usize) -> Result<Frame, PlaceError> {
        if let Some(&value) = self.position.iter().find(|v| !v.is_finite() || v.abs() > MAX_COORDINATE) {
            return Err(PlaceError::Position { module, value });
        }
        let (z, y) = (Vector3::from(self.z), Vector3::from(self.y));
        for (axis, length) in [('z', z.norm()), ('y', y.norm())] {
            if !length.is_finite() || (length - 1.0).abs() > UNIT_TOLERANCE {
                return Err(PlaceError::NotUnit { module, axis, length });
            }
        }
        let cosine = z.dot(&y);
        if cosine.abs() > UNIT_TOLERANCE {
            return Err(PlaceError::NotPerpendicular { module, cosine });
        }
        let error = (z.norm() - 1.0).abs().max((y.norm() - 1.0).abs()).max(cosine.abs());
        let (z, y) = if error <= EXACT {
            (z, y)
        } else {
            let z = z.normalize();
            (z, (y - z * z.dot(&y)).normalize())
        };
        Ok(Frame::of_axes(Vector3::from(self.position), y, z))
    }
}

/// Reason why places of modules are not a configuration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlaceError {
    /// There is no module, or there are more than [`MAX_MODULES`].
    #[error("{count} modules: allowed are 1 to {MAX_MODULES}")]
    Count {
        /// Number of modules.
        count: usize,
    },
    /// A coordinate of a position is not finite or too large.
    #[error("module {module}: a coordinate of p is {value} mu: allowed is -{MAX_COORDINATE} to {MAX_COORDINATE}")]
    Position {
        /// Number of the module.
        module: usize,
        /// The coordinate, mu.
        value: f64,
    },
    /// An axis is not a unit vector.
    #[error(
        "module {module}: {axis} has length {length}: allowed is 1 with an error up to {UNIT_TOLERANCE:e}. \
         Write its numbers with at least 7 decimals"
    )]
    NotUnit {
        /// Number of the module.
        module: usize,
        /// The axis, z or y.
        axis: char,
        /// Its length.
        length: f64,
    },
    /// The axes of a module are not perpendicular.
    #[error(
        "module {module}: z and y are not perpendicular: the cosine of their angle is {cosine}, \
         allowed is 0 with an error up to {UNIT_TOLERANCE:e}"
    )]
    NotPerpendicular {
        /// Number of the module.
        module: usize,
        /// Cosine of the angle between z and y.
        cosine: f64,
    },
    /// Two modules overlap.
    #[error(
        "modules {} and {} overlap by {depth:.3} mu: allowed is {} mu. Move one of them",
        .modules[0], .modules[1], super::PENETRATION
    )]
    Overlap {
        /// Numbers of the modules.
        modules: [usize; 2],
        /// Depth of the overlap, mu.
        depth: f64,
    },
    /// A module is not connected to module 0, neither directly nor through other modules.
    #[error("module {module} is not connected to module 0: {}", hint(.meeting))]
    Disconnected {
        /// Lowest number of such a module.
        module: usize,
        /// Two faces that meet between the two pieces, but are both active or both passive.
        meeting: Option<(Port, Port)>,
    },
}

/// Returns what separates two pieces of a robot.
fn hint(meeting: &Option<(Port, Port)>) -> String {
    let rule = "one face must be active (part 1), the other passive (part 0)";
    match meeting {
        Some((a, b)) => format!("{} and {} meet, but {rule}", describe_port(*a), describe_port(*b)),
        None => format!(
            "a face of each must lie on each other within {:e} mu, turned by a multiple of 90°, and {rule}",
            super::MEET
        ),
    }
}
