//! The kinds of modules that ship, one file each.

mod block;
mod cosmo;
mod mtran;

use super::kind::{FaceKind, Gender, ModuleKind};
use crate::base::registry::{Registered, Registry};

/// Kinds that ship. Messages list them in this order.
static KINDS: Registry<ModuleKind> = Registry::new(&[&cosmo::COSMO, &block::BLOCK, &mtran::MTRAN]);

impl Registered for ModuleKind {
    fn registry() -> &'static Registry<Self> {
        &KINDS
    }
}

/// Half of the side lengths of a cube, mu. A module is 1 mu long: two cubes of 0.48 mu on a grid of 0.5 mu, so that
/// docked cubes leave a gap of 0.02 mu.
const HALF: [f64; 3] = [0.24; 3];
/// Mass of a cube, kg.
const CUBE_MASS: f64 = 0.5;
const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];
const NEG_X: [f64; 3] = [-1.0, 0.0, 0.0];
const NEG_Y: [f64; 3] = [0.0, -1.0, 0.0];
const NEG_Z: [f64; 3] = [0.0, 0.0, -1.0];

const fn face(name: &'static str, part: usize, position: [f64; 3], normal: [f64; 3], up: [f64; 3]) -> FaceKind {
    FaceKind { name, part, position, normal, up, gender: Gender::Any }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tree has one part more than hinges, and each hinge joins a part that no hinge before it has reached.
    #[test]
    fn hinges_of_each_kind_form_one_tree() {
        for kind in ModuleKind::registry().all() {
            let mut group: Vec<usize> = (0..kind.parts.len()).collect();
            for hinge in kind.hinges {
                let (from, to) = (group[hinge.from], group[hinge.to]);
                assert_ne!(from, to, "{}: hinge {} closes a loop", kind.name, hinge.name);
                group.iter_mut().filter(|g| **g == to).for_each(|g| *g = from);
            }
            assert!(group.iter().all(|g| *g == group[0]), "{}: a part is not joined", kind.name);
            assert!(!kind.faces.is_empty(), "{} has no face", kind.name);
        }
    }
}
