//! Poses of all links while the parts of some modules turn.

use super::program::Segment;
use crate::model::mtran::{Configuration, Connection, Frame, MEET, Port, components, link_of_part, part_of_link};
use std::collections::BTreeSet;

/// Robot whose connections stay rigid while its parts turn.
///
/// In each piece of the robot, one part stays where it is: the base part of the segment's first turned module of that
/// piece. A piece without a turned module stays where it is.
pub(super) struct Chain<'a> {
    start: &'a Configuration,
    /// Parts that stay where they are, (module, part), one a piece with turned modules.
    anchors: Vec<(usize, u8)>,
    /// Connections from a module with a known pose to one without, in the order of their use.
    tree: Vec<Joint>,
    /// All kept connections.
    all: Vec<Joint>,
}

/// Kept connection, with the pose of the second part in the first part's frame.
struct Joint {
    from: Port,
    to: Port,
    relative: Frame,
}

/// Connection that does not stay closed.
pub(super) struct Opened {
    /// The connection.
    pub connection: Connection,
    /// Distance of the second part from its rigid pose, mu.
    pub gap: f64,
    /// Angle of the second part from its rigid pose, rad, if it is small.
    pub turn: f64,
}

impl Joint {
    fn new(start: &Configuration, from: Port, to: Port) -> Self {
        let [a, b] = [from, to].map(|port| start.part(port.module as usize, port.part));
        Self { from, to, relative: a.inverse().then(&b) }
    }
}

impl<'a> Chain<'a> {
    /// Returns the chain of a configuration whose connections are reduced to `kept`.
    pub fn new(start: &'a Configuration, kept: &BTreeSet<Connection>, segment: &Segment) -> Self {
        let piece = components(start.len(), kept);
        let mut anchors: Vec<(usize, u8)> = Vec::new();
        for turn in &segment.turns {
            let module = turn.module as usize;
            if anchors.iter().all(|&(other, _)| piece[other] != piece[module]) {
                anchors.push((module, turn.base));
            }
        }
        let mut known = vec![false; start.len()];
        anchors.iter().for_each(|&(module, _)| known[module] = true);
        let mut queue: Vec<usize> = anchors.iter().map(|&(module, _)| module).collect();
        let mut tree = Vec::new();
        let mut next = 0;
        while let Some(&module) = queue.get(next) {
            next += 1;
            for &(a, b) in kept {
                let (from, to) = if a.module as usize == module { (a, b) } else { (b, a) };
                if from.module as usize == module && !known[to.module as usize] {
                    known[to.module as usize] = true;
                    queue.push(to.module as usize);
                    tree.push(Joint::new(start, from, to));
                }
            }
        }
        let all = kept.iter().map(|&(a, b)| Joint::new(start, a, b)).collect();
        Self { start, anchors, tree, all }
    }

    /// Returns the frames of all links at these angles in degrees.
    ///
    /// # Errors
    ///
    /// A kept connection would open: modules form a loop that these angles do not close.
    pub fn links(&self, degrees: &[[i32; 2]]) -> Result<Vec<Frame>, Opened> {
        let angle = |module: usize, part: u8| degrees[module][usize::from(part)];
        let mut links = self.start.links().to_vec();
        for &(module, part) in &self.anchors {
            links[module] = link_of_part(&self.start.part(module, part), part, angle(module, part));
        }
        let part_at = |links: &[Frame], port: Port| {
            let module = port.module as usize;
            part_of_link(&links[module], port.part, angle(module, port.part))
        };
        for joint in &self.tree {
            let module = joint.to.module as usize;
            let part = part_at(&links, joint.from).then(&joint.relative);
            links[module] = link_of_part(&part, joint.to.part, angle(module, joint.to.part));
        }
        for joint in &self.all {
            let expected = part_at(&links, joint.from).then(&joint.relative);
            let found = part_at(&links, joint.to);
            let gap = (expected.origin - found.origin).norm();
            let turn = (expected.rotation - found.rotation).norm() * std::f64::consts::FRAC_1_SQRT_2;
            if gap.max(turn) > MEET {
                return Err(Opened { connection: (joint.from, joint.to), gap, turn });
            }
        }
        Ok(links)
    }
}
