//! Configurations: the poses, angles and connections of all modules of a robot.

use super::geometry::{FACES, Face, PARTS, face_of_part, may_connect, part_of_link};
use super::shape::{PENETRATION, lowest, penetration};
use super::{Angle, Port};
use super::{Frame, MAX_MODULES, Place, PlaceError};
use std::collections::BTreeSet;

/// Two connected faces, the lower one first.
pub type Connection = (Port, Port);

/// Returns the connection of two faces.
pub(crate) fn ordered(a: Port, b: Port) -> Connection {
    (a.min(b), a.max(b))
}

/// Returns the name of a face in messages.
pub(crate) fn describe_port(port: Port) -> String {
    format!("module {} part {} face {}", port.module, port.part, port.face)
}

/// Robot of M-TRAN modules: the pose of each link, the angles of the parts, and the connected faces.
///
/// Module i is at index i. The poses are kinematic: the ground and gravity have no effect on them.
#[derive(Clone, Debug, PartialEq)]
pub struct Configuration {
    links: Vec<Frame>,
    angles: Vec<[Angle; 2]>,
    connections: BTreeSet<Connection>,
}

impl Configuration {
    /// Returns the configuration of modules at these places. All faces that meet and may connect are connected: their
    /// positions differ by at most 1e-6 mu, their normals are opposite, they are turned by a multiple of 90° to each
    /// other, and one is active, the other passive.
    ///
    /// # Errors
    ///
    /// The number of modules is out of range, a place is malformed, two modules overlap by more than [`PENETRATION`]
    /// (see [`penetration`]), or the robot is in several pieces.
    pub fn of_places(places: &[Place]) -> Result<Self, PlaceError> {
        if !(1..=MAX_MODULES).contains(&places.len()) {
            return Err(PlaceError::Count { count: places.len() });
        }
        let links = places.iter().enumerate().map(|(i, p)| p.link(i)).collect::<Result<Vec<_>, _>>()?;
        let angles = places.iter().map(|p| p.angles).collect();
        let mut configuration = Self { links, angles, connections: BTreeSet::new() };
        configuration.refuse_overlap()?;
        let meeting = configuration.meeting_faces();
        configuration.connections = meeting.iter().copied().filter(|&(a, b)| may_connect(a, b)).collect();
        let pieces = components(configuration.len(), &configuration.connections);
        if let Some(module) = pieces.iter().position(|&piece| piece != 0) {
            let apart = |&&(a, b): &&Connection| (pieces[a.module as usize] == 0) != (pieces[b.module as usize] == 0);
            return Err(PlaceError::Disconnected { module, meeting: meeting.iter().find(apart).copied() });
        }
        Ok(configuration)
    }

    /// Returns a configuration of parts that are known to fit.
    pub(crate) fn of_parts(links: Vec<Frame>, angles: Vec<[Angle; 2]>, connections: BTreeSet<Connection>) -> Self {
        Self { links, angles, connections }
    }

    /// Returns the number of modules, at least 1.
    #[expect(clippy::len_without_is_empty, reason = "a configuration has at least one module")]
    pub fn len(&self) -> usize {
        self.links.len()
    }

    /// Returns the frame of each module's link: its origin is the centre of the axis of part 0, y points along the link
    /// and z along the axes.
    pub fn links(&self) -> &[Frame] {
        &self.links
    }

    /// Returns the angles of part 0 and part 1 of each module relative to its link.
    pub fn angles(&self) -> &[[Angle; 2]] {
        &self.angles
    }

    /// Returns the connected faces, in order.
    pub fn connections(&self) -> &BTreeSet<Connection> {
        &self.connections
    }

    /// Returns the places of the modules. They hold poses and angles, but not the connections: faces that meet without
    /// being connected are connected in [`Configuration::of_places`] of these places.
    pub fn places(&self) -> Vec<Place> {
        let place = |(link, &angles): (&Frame, &[Angle; 2])| Place {
            position: link.origin.into(),
            z: link.axis(2).into(),
            y: link.axis(1).into(),
            angles,
        };
        self.links.iter().zip(&self.angles).map(place).collect()
    }

    /// Returns the frame of a part: its origin is the centre of the part's axis, and at angle 0 its axes are those of
    /// the link.
    ///
    /// # Panics
    ///
    /// The module does not exist, or the part is not 0 or 1.
    pub fn part(&self, module: usize, part: u8) -> Frame {
        part_of_link(&self.links[module], part, self.angles[module][usize::from(part)].degrees())
    }

    /// Returns a face in world coordinates.
    ///
    /// # Panics
    ///
    /// The module does not exist, or the part is not 0 or 1.
    pub fn face(&self, port: Port) -> Face {
        face_of_part(&self.part(port.module as usize, port.part), port.part, port.face)
    }

    /// Returns all faces, in order.
    pub fn ports(&self) -> impl Iterator<Item = Port> {
        let parts = (0..self.len() as u32).flat_map(|module| (0..PARTS).map(move |part| (module, part)));
        parts.flat_map(|(module, part)| (0..FACES).map(move |face| Port { module, part, face }))
    }

    /// Returns the height of the lowest point of all parts, mu.
    pub fn lowest(&self) -> f64 {
        let parts = (0..self.len()).flat_map(|module| (0..PARTS).map(move |part| (module, part)));
        parts.map(|(module, part)| lowest(&self.part(module, part), part)).fold(f64::INFINITY, f64::min)
    }

    /// Returns the pairs of faces of different modules that meet, in order, connected or not.
    fn meeting_faces(&self) -> Vec<Connection> {
        let faces: Vec<(Port, Face)> = self.ports().map(|port| (port, self.face(port))).collect();
        let mut meeting = Vec::new();
        for (i, (a, face)) in faces.iter().enumerate() {
            let others = faces[i + 1..].iter().filter(|(b, other)| b.module != a.module && face.meets(other));
            meeting.extend(others.map(|(b, _)| (*a, *b)));
        }
        meeting
    }

    fn refuse_overlap(&self) -> Result<(), PlaceError> {
        let parts = |module| (0..PARTS).map(move |part| (self.part(module, part), part));
        for second in 0..self.len() {
            for first in 0..second {
                for (a, p) in parts(first) {
                    for (b, q) in parts(second) {
                        if let Some(depth) = penetration((&a, p), (&b, q), PENETRATION) {
                            return Err(PlaceError::Overlap { modules: [first, second], depth });
                        }
                    }
                }
            }
        }
        Ok(())
    }
}

/// Returns for each of `count` modules the lowest number of the modules in its piece of the robot.
pub(crate) fn components(count: usize, connections: &BTreeSet<Connection>) -> Vec<usize> {
    let mut piece: Vec<usize> = (0..count).collect();
    for &(a, b) in connections {
        let (p, q) = (piece[a.module as usize], piece[b.module as usize]);
        let (low, high) = (p.min(q), p.max(q));
        piece.iter_mut().filter(|c| **c == high).for_each(|c| *c = low);
    }
    piece
}
