//! Kind `block`: a module without a hinge.

use super::{CUBE_MASS, HALF, NEG_X, NEG_Y, NEG_Z, X, Y, Z, face};
use crate::model::kind::{ModuleKind, PartKind};

/// Passive cube with six faces, to attach legs to.
pub(super) static BLOCK: ModuleKind = ModuleKind {
    name: "block",
    parts: &[PartKind::cuboid("cube", [0.0; 3], HALF, CUBE_MASS)],
    hinges: &[],
    faces: &[
        face("back", 0, [-0.25, 0.0, 0.0], NEG_X, Z),
        face("front", 0, [0.25, 0.0, 0.0], X, Z),
        face("left", 0, [0.0, 0.25, 0.0], Y, Z),
        face("right", 0, [0.0, -0.25, 0.0], NEG_Y, Z),
        face("top", 0, [0.0, 0.0, 0.25], Z, X),
        face("bottom", 0, [0.0, 0.0, -0.25], NEG_Z, X),
    ],
};
