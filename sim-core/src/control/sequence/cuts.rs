//! Connections that a segment cuts.

use super::Reading;
use super::program::{Segment, Turn};
use crate::model::mtran::Port;
use crate::model::mtran::{Configuration, Connection};
use std::collections::BTreeSet;

/// Returns the connections that a segment cuts at its beginning. All modules of the segment must exist.
pub(super) fn cut_connections(
    configuration: &Configuration,
    segment: &Segment,
    reading: Reading,
) -> BTreeSet<Connection> {
    let named: BTreeSet<Port> = segment.connections.iter().copied().collect();
    let changes = |turn: &Turn| configuration.angles()[turn.module as usize] != turn.angles;
    let turns = segment.turns.iter().filter(|turn| reading != Reading::Changed || changes(turn));
    let moving: BTreeSet<(u32, u8)> = turns.map(|turn| (turn.module, 1 - turn.base)).collect();
    let is_cut = |&&(a, b): &&Connection| {
        let either = named.contains(&a) || named.contains(&b);
        [a, b].iter().any(|face| {
            let keeps = if reading == Reading::MovingFace { named.contains(face) } else { either };
            moving.contains(&(face.module, face.part)) && !keeps
        })
    };
    configuration.connections().iter().filter(is_cut).copied().collect()
}
