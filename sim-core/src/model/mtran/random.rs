//! Random configurations (Yoshida et al. 2003, sections 3.2 and 4: "randomly generated initial states").

use super::geometry::{ACTIVE_PART, FACES, HALF, PARTS, face_of_part, link_of_part, part_of_link};
use super::{Angle, Port};
use super::{Configuration, Frame, MAX_MODULES, Place};
use nalgebra::{Matrix3, Vector3};

/// Greatest number of draws for the place of one module.
pub const MAX_TRIES: u32 = 1000;

/// Reason why no random configuration was drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RandomError {
    /// The number of modules is out of range.
    #[error("{modules} modules: allowed are 1 to {MAX_MODULES}")]
    Count {
        /// Number of modules.
        modules: usize,
    },
    /// No free place was found for a module.
    #[error("module {module} found no free place in {MAX_TRIES} draws: draw again, or use fewer modules")]
    NoPlace {
        /// Number of the module.
        module: usize,
    },
}

/// Returns a random connected configuration of `modules` modules on the ground. `below(n)` returns a whole number
/// from 0 to n − 1, all equally likely.
///
/// All angles are 0 (section 2.2 A: "the initial rotation angles are assumed to be 0° for simplicity"). All axes and
/// links have directions ±x, ±y or ±z. Module 0 has one of the 24 orientations, all equally likely, and x = y = 0.
/// Each further module is attached to a module of those before it, by a face of it, a compatible face of the new
/// module and a turn of 0°, 90°, 180° or 270°, each drawn uniformly. A draw on a face that is covered, or one that
/// makes modules overlap, is repeated, up to [`MAX_TRIES`] times a module. Other faces that meet are connected too. The
/// lowest parts touch z = 0.
///
/// # Errors
///
/// `modules` is out of range, or a module found no free place.
pub fn random(modules: usize, below: &mut impl FnMut(u32) -> u32) -> Result<Configuration, RandomError> {
    if !(1..=MAX_MODULES).contains(&modules) {
        return Err(RandomError::Count { modules });
    }
    let mut links = vec![Frame { rotation: orientation(below(6), below(4)), origin: Vector3::zeros() }];
    while links.len() < modules {
        let free = (0..MAX_TRIES).map(|_| attach(&links, below)).find(|link| is_free(&links, link));
        links.push(free.ok_or(RandomError::NoPlace { module: links.len() })?);
    }
    let heights = links.iter().flat_map(|link| (0..PARTS).map(|part| center(link, part).z));
    let lift = HALF - heights.fold(f64::INFINITY, f64::min);
    let place = |link: &Frame| Place {
        position: (link.origin + Vector3::new(0.0, 0.0, lift)).into(),
        z: link.axis(2).into(),
        y: link.axis(1).into(),
        angles: [Angle::default(); 2],
    };
    let places: Vec<Place> = links.iter().map(place).collect();
    Ok(Configuration::of_places(&places).expect("modules attached at free faces are connected and do not overlap"))
}

/// Returns the rotation whose z axis has one of the six directions of the world's axes, and whose y axis has one of the
/// four that are perpendicular to it.
fn orientation(axis: u32, turn: u32) -> Matrix3<f64> {
    let mut z = Vector3::zeros();
    z[axis as usize / 2] = if axis.is_multiple_of(2) { 1.0 } else { -1.0 };
    let mut y = Vector3::zeros();
    y[(axis as usize / 2 + 1) % 3] = 1.0;
    let first = Frame::of_axes(Vector3::zeros(), y, z);
    first.then(&Frame::turned(90 * turn as i32)).rotation
}

/// Draws the link of a module that is attached to one of the modules so far.
fn attach(links: &[Frame], below: &mut impl FnMut(u32) -> u32) -> Frame {
    let carrier = below(links.len() as u32);
    let mut draw = |part| Port { module: 0, part, face: below(u32::from(FACES)) as u8 };
    let inner = draw(1 - ACTIVE_PART);
    let outer = draw(ACTIVE_PART);
    // The faces above are a passive and an active one. The carrier has one of them, the new module the other.
    let (at, own) = if below(2) == 0 { (inner, outer) } else { (outer, inner) };
    let target = face_of_part(&part_of_link(&links[carrier as usize], at.part, 0), at.part, at.face);
    let local = face_of_part(&Frame::identity(), own.part, own.face);
    // In a frame of a face, z is its normal and y its up direction. The new face looks against the target.
    let facing = Frame::of_axes(target.position, target.up, -target.normal);
    let face = Frame::of_axes(local.position, local.up, local.normal);
    let turned = facing.then(&Frame::turned(90 * below(4) as i32));
    link_of_part(&turned.then(&face.inverse()), own.part, 0)
}

/// Returns the centre of a part's axis, mu.
fn center(link: &Frame, part: u8) -> Vector3<f64> {
    part_of_link(link, part, 0).origin
}

/// Returns true if no part of a module overlaps those of other modules. At angle 0 each part fills a cell of a lattice
/// of 1 mu, so parts overlap only if they are in the same cell.
fn is_free(links: &[Frame], link: &Frame) -> bool {
    let centers = |link: &Frame| [center(link, 0), center(link, 1)];
    let own = centers(link);
    links.iter().flat_map(centers).all(|other| own.iter().all(|c| (c - other).norm_squared() > 0.25))
}
