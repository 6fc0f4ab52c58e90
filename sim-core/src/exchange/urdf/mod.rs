//! URDF, the Unified Robot Description Format: <https://wiki.ros.org/urdf/XML>.

mod read;
mod schema;
mod write;

pub(super) use read::read;
pub(super) use write::write;
