//! MJCF, the format of MuJoCo: <https://mujoco.readthedocs.io/en/stable/XMLreference.html>.

mod actuator;
mod compiler;
mod defaults;
mod geom;
mod joint;
mod place;
mod read;
mod schema;
mod write;

pub(super) use read::read;
pub(super) use write::write;
