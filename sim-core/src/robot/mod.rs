//! Robots: modules docked to each other, or bodies written out, compiled to few rigid bodies and a tree of hinges.

mod assemble;
mod body;
pub mod exchange;
mod kind;
mod mechanics;
mod plausible;
mod pose;
mod rigid;
mod spec;

pub use body::{Body, CollisionBox, CollisionCapsule, Hinge, JOINT_LIMIT, PartBox, Robot};
pub use kind::{HingeKind, KINDS, Kind, PartKind, PortKind};
pub use pose::State;
pub use spec::*;
