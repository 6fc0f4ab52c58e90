//! Changes of a robot during a motion.

use crate::base::math::Pose;
use crate::model::Face;

/// Change at a tick. It acts at the first physics step at or after its tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    /// Tick from the start of the motion, [`TICK`](super::TICK) s each.
    pub tick: u32,
    /// The change.
    pub change: Change,
}

/// Change of a robot. Modules and joints are numbered as in the initial topology.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// Two faces connect at their present poses.
    Connect {
        /// The two faces.
        faces: [Face; 2],
    },
    /// Two connected faces disconnect.
    Disconnect {
        /// The two faces.
        faces: [Face; 2],
    },
    /// A module is lifted and set down, with all that is connected to it.
    Place {
        /// The module.
        module: usize,
        /// Its pose in the world from then on, mu.
        pose: Pose,
    },
    /// A joint locks at its present angle, at once. The state at the end does not record it, so a motion that continues
    /// from there must repeat the event at tick 0.
    Fail {
        /// The joint.
        joint: usize,
    },
    /// A new module of the same kind, with working joints, replaces a module.
    Replace {
        /// The module.
        module: usize,
    },
}

impl Change {
    /// Returns the name of the kind of change, such as "connect".
    pub fn name(&self) -> &'static str {
        match self {
            Self::Connect { .. } => "connect",
            Self::Disconnect { .. } => "disconnect",
            Self::Place { .. } => "place",
            Self::Fail { .. } => "fail",
            Self::Replace { .. } => "replace",
        }
    }
}
