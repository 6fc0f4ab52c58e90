//! Robots of M-TRAN modules: geometry of a module, configurations, their text, random configurations
//! (Yoshida et al. 2003, sections 2.1 and 2.2 A).
//!
//! Lengths are in mu, the distance of the two rotational axes of a module. Angles are in degrees where a name says so.
//! z of the world is up.

mod angle;
mod configuration;
mod frame;
mod geometry;
mod place;
mod port;
mod random;
mod robot;
mod shape;
mod text;

pub use angle::Angle;
pub use configuration::{Configuration, Connection};
pub(crate) use configuration::{components, describe_port, ordered};
pub use frame::Frame;
pub use geometry::{
    ACTIVE_PART, FACES, Face, HALF, MEET, PARTS, face_of_part, link_of_part, may_connect, part_of_link,
};
pub use place::{MAX_COORDINATE, MAX_MODULES, Place, PlaceError, UNIT_TOLERANCE};
pub use port::Port;
pub use random::{MAX_TRIES, RandomError, random};
pub use robot::{KIND, MAX_DRAWS, NotARobot, drawn};
pub use shape::{PENETRATION, lowest, penetration};
pub use text::{InitialStateError, TextError, parse, print};
