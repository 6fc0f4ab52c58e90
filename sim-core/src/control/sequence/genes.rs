//! Segments as genes: a fixed number of choices a segment, so that a program is a sequence of equal parts (Yoshida et
//! al. 2003, section 3.1: "one gene corresponds to one segment").

use super::program::{Item, Program, Segment, Turn};
use crate::genotype::{Gene, NamedGene};
use crate::model::mtran::{Angle, Port};

/// Greatest number of turns of a segment; no more than the robot has modules.
pub const MAX_TURNS: usize = 3;
/// Greatest number of connections of a segment.
pub const MAX_CONNECTIONS: usize = 3;

/// Genes of a turn: module, base part, and the steps of both angles.
const OF_TURN: usize = 4;
/// Genes of a connection: module, part, face.
const OF_CONNECTION: usize = 3;
/// Number of angles: −90° to 90° in steps of 30°.
const ANGLES: u32 = 2 * Angle::MOST as u32 + 1;

/// Layout of the genes of a segment for a number of modules.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Genes {
    modules: usize,
}

impl Genes {
    /// Returns the layout for a robot of so many modules.
    pub fn of(modules: usize) -> Self {
        Self { modules }
    }

    fn turns(self) -> usize {
        MAX_TURNS.min(self.modules)
    }

    /// Returns the number of genes of a segment.
    pub fn count(self) -> usize {
        OF_TURN * self.turns() + OF_CONNECTION * MAX_CONNECTIONS
    }

    /// Returns the genes of a segment. Module 0 means that the operation is absent, module m + 1 is module m.
    pub fn named(self) -> Vec<NamedGene> {
        let gene = |name: String, options: u32| NamedGene { name, unit: "", gene: Gene::Choice { options } };
        let module = self.modules as u32 + 1;
        let turn = |i: usize| {
            [("module", module), ("base", 2), ("angle0", ANGLES), ("angle1", ANGLES)]
                .map(|(name, options)| gene(format!("turn{i}.{name}"), options))
        };
        let connection = |i: usize| {
            [("module", module), ("part", 2), ("face", 3)]
                .map(|(name, options)| gene(format!("connection{i}.{name}"), options))
        };
        (1..=self.turns()).flat_map(turn).chain((1..=MAX_CONNECTIONS).flat_map(connection)).collect()
    }

    /// Returns the segment of some genes. A second turn of a module and a second connection of a face are left out.
    pub fn segment(self, genes: &[f64]) -> Segment {
        let (turns, connections) = genes.split_at(OF_TURN * self.turns());
        let mut segment = Segment::default();
        for turn in turns.chunks_exact(OF_TURN) {
            let [module, base, first, second] = [0, 1, 2, 3].map(|i| turn[i] as u32);
            let angle = |gene: u32| Angle::of_steps(gene as i8 - Angle::MOST).unwrap_or_default();
            let absent = module == 0 || segment.turns.iter().any(|other| other.module == module - 1);
            if !absent {
                let angles = [first, second].map(angle);
                segment.turns.push(Turn { module: module - 1, base: base as u8, angles });
            }
        }
        for connection in connections.chunks_exact(OF_CONNECTION) {
            let [module, part, face] = [0, 1, 2].map(|i| connection[i] as u32);
            let port = Port { module: module.wrapping_sub(1), part: part as u8, face: face as u8 };
            if module > 0 && !segment.connections.contains(&port) {
                segment.connections.push(port);
            }
        }
        segment
    }

    /// Returns the genes of a segment; `None` if it has more operations than the layout.
    pub fn of_segment(self, segment: &Segment) -> Option<Vec<f64>> {
        if segment.turns.len() > self.turns() || segment.connections.len() > MAX_CONNECTIONS {
            return None;
        }
        let mut genes = vec![0.0; self.count()];
        for (turn, to) in segment.turns.iter().zip(genes.chunks_exact_mut(OF_TURN)) {
            let step = |angle: Angle| f64::from(angle.steps() + Angle::MOST);
            let [first, second] = turn.angles;
            to.copy_from_slice(&[f64::from(turn.module) + 1.0, f64::from(turn.base), step(first), step(second)]);
        }
        let connections = genes[OF_TURN * self.turns()..].chunks_exact_mut(OF_CONNECTION);
        for (port, to) in segment.connections.iter().zip(connections) {
            to.copy_from_slice(&[f64::from(port.module) + 1.0, f64::from(port.part), f64::from(port.face)]);
        }
        Some(genes)
    }

    /// Returns the program of a genotype: its segments, one after the other.
    pub fn program(self, genotype: &[f64]) -> Program {
        Program { items: genotype.chunks_exact(self.count()).map(|genes| Item::Segment(self.segment(genes))).collect() }
    }
}
