//! Robots and environments: files, checks, catalogue, compiled robots, and places on a map.

mod assemble;
mod body;
pub mod catalogue;
pub mod environment;
mod kind;
mod kinds;
mod mechanics;
pub mod mtran;
mod place;
mod plausible;
mod pose;
mod prism;
pub(crate) mod rigid;
mod spec;
mod touch;

pub use body::{Body, CollisionBox, CollisionCapsule, Hinge, Module, PartBox, Robot};
pub use kind::{D_EDGES, FaceKind, Gender, HingeKind, ModuleKind, PartKind, PartShape, QUARTER_TURNS};
pub use place::{Place, Plane};
pub use pose::{Connection, Face, Phase, State, Twist, Velocities};
pub use prism::CollisionPrism;
pub use spec::*;
pub use touch::bodies_touching;
pub(crate) use touch::{Solid, state_touches};
