//! Geometry of an M-TRAN module (Yoshida et al. 2003, section 2.1 and Fig. 1).
//!
//! A module has two parts and a link between them. The frame of the link has its origin on the axis of part 0, y along
//! the link and z along the axes, so that the axis of part 1 passes through (0, 1, 0). The frame of a part has its
//! origin on the part's axis and turns about z relative to the link. At angle 0 its axes are those of the link. A
//! positive angle turns the part by the right-hand rule.
//!
//! A part has three faces. At angle 0 the round side of a part faces the other part, and its flat end, face 0, faces
//! outward: towards −y at part 0, towards +y at part 1. Faces 1 and 2 are the sides at +z and −z.
//!
//! The paper says that one of the two parts has active faces, but not which one. Here it is part 1. No configuration
//! depends on this choice, because a connection always needs one face of each kind.

use super::Frame;
use super::Port;
use nalgebra::Vector3;

/// Number of parts of a module.
pub const PARTS: u8 = 2;

/// Number of faces of a part.
pub const FACES: u8 = 3;

/// Part whose faces are active. Those of the other part are passive.
pub const ACTIVE_PART: u8 = 1;

/// Distance of the rotational axes of a module, mu.
const LINK: f64 = 1.0;

/// Half of the width, height and depth of a part, mu: the distance of each face from the centre of the part's axis.
pub const HALF: f64 = 0.5;

/// Greatest distance of two faces that meet, mu. It also limits how much their directions may differ, rad.
pub const MEET: f64 = 1e-6;

/// Face of a part in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Face {
    /// Centre of the face, mu.
    pub position: Vector3<f64>,
    /// Unit vector that points out of the part.
    pub normal: Vector3<f64>,
    /// Unit vector in the plane of the face: z of the part at its flat end, y of the part at its sides.
    pub up: Vector3<f64>,
}

impl Face {
    /// Returns true if two faces lie on each other within [`MEET`]: at the same position, with opposite normals, and
    /// turned by a multiple of 90°.
    pub fn meets(&self, other: &Face) -> bool {
        let twist = self.up.dot(&other.up).abs().min(self.up.cross(&other.up).norm());
        (self.position - other.position).norm() <= MEET && (self.normal + other.normal).norm() <= MEET && twist <= MEET
    }
}

/// Returns the direction from a part's axis to its flat end, along y of the part: −1 or +1.
pub(super) fn outward(part: u8) -> f64 {
    if part == 0 { -1.0 } else { 1.0 }
}

/// Returns the frame of the link's point on the axis of a part, relative to the link.
fn seat(part: u8) -> Frame {
    Frame::along_y(if part == 0 { 0.0 } else { LINK })
}

/// Returns the frame of a part from the frame of its module's link and the part's angle in degrees.
pub fn part_of_link(link: &Frame, part: u8, degrees: i32) -> Frame {
    link.then(&seat(part)).then(&Frame::turned(degrees))
}

/// Returns the frame of a module's link from the frame of a part and the part's angle in degrees. It is the inverse
/// of [`part_of_link`].
pub fn link_of_part(frame: &Frame, part: u8, degrees: i32) -> Frame {
    frame.then(&Frame::turned(-degrees)).then(&seat(part).inverse())
}

/// Returns a face of a part from the part's frame. `face` is 0, 1 or 2.
pub fn face_of_part(frame: &Frame, part: u8, face: u8) -> Face {
    let (y, z) = (frame.axis(1), frame.axis(2));
    let (normal, up) = match face {
        0 => (y * outward(part), z),
        1 => (z, y),
        _ => (-z, y),
    };
    Face { position: frame.origin + normal * HALF, normal, up }
}

/// Returns true if two faces can connect: they belong to different modules, and one is active and the other passive.
pub fn may_connect(a: Port, b: Port) -> bool {
    a.module != b.module && (a.part == ACTIVE_PART) != (b.part == ACTIVE_PART)
}
