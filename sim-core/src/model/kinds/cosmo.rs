//! Kind `cosmo`: the module of the CoSMO platform.

use super::{CUBE_MASS, HALF, NEG_X, NEG_Y, NEG_Z, X, Y, Z, face};
use crate::model::kind::{HingeKind, ModuleKind, PartKind};

/// CoSMO module (Liedke et al. 2013, as Vonásek and Faigl 2016, section V, use it): two cubes with one hinge about z
/// between them. Cube `a` is at −x, cube `b` at +x.
pub(super) static COSMO: ModuleKind = ModuleKind {
    name: "cosmo",
    parts: &[
        PartKind::cuboid("a", [-0.25, 0.0, 0.0], HALF, CUBE_MASS),
        PartKind::cuboid("b", [0.25, 0.0, 0.0], HALF, CUBE_MASS),
    ],
    hinges: &[HingeKind::new("joint", [0, 1], [0.0; 3], Z)],
    faces: &[
        face("back", 0, [-0.5, 0.0, 0.0], NEG_X, Z),
        face("front", 1, [0.5, 0.0, 0.0], X, Z),
        face("a-left", 0, [-0.25, 0.25, 0.0], Y, Z),
        face("a-right", 0, [-0.25, -0.25, 0.0], NEG_Y, Z),
        face("a-top", 0, [-0.25, 0.0, 0.25], Z, X),
        face("a-bottom", 0, [-0.25, 0.0, -0.25], NEG_Z, X),
        face("b-left", 1, [0.25, 0.25, 0.0], Y, Z),
        face("b-right", 1, [0.25, -0.25, 0.0], NEG_Y, Z),
        face("b-top", 1, [0.25, 0.0, 0.25], Z, X),
        face("b-bottom", 1, [0.25, 0.0, -0.25], NEG_Z, X),
    ],
};
