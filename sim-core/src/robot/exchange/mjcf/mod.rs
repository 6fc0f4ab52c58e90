//! MJCF, the format of MuJoCo: <https://mujoco.readthedocs.io/en/stable/XMLreference.html>.

mod defaults;
mod geom;
mod read;
mod write;

pub(super) use read::read;
pub(super) use write::write;
