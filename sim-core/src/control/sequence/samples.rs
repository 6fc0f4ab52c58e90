//! Random programs and texts for tests.

use super::program::{Item, MAX_MODULE, MAX_SEGMENTS, MAX_TIMES, Program, Segment, Turn};
use crate::model::mtran::{Angle, Port};
use proptest::prelude::*;
use std::collections::BTreeSet;

fn module() -> impl Strategy<Value = u32> {
    prop_oneof![0..4u32, 0..=MAX_MODULE]
}

fn angle() -> impl Strategy<Value = Angle> {
    (-Angle::MOST..=Angle::MOST).prop_map(|steps| Angle::of_steps(steps).unwrap())
}

fn turn() -> impl Strategy<Value = Turn> {
    (module(), 0..2u8, [angle(), angle()]).prop_map(|(module, base, angles)| Turn { module, base, angles })
}

fn port() -> impl Strategy<Value = Port> {
    (module(), 0..2u8, 0..3u8).prop_map(|(module, part, face)| Port { module, part, face })
}

/// Random segments: a module is turned at most once, a face is named at most once.
fn segment() -> impl Strategy<Value = Item> {
    let operations = (prop::collection::vec(turn(), 0..6), prop::collection::vec(port(), 0..6));
    operations.prop_map(|(mut turns, mut connections)| {
        let (mut modules, mut faces) = (BTreeSet::new(), BTreeSet::new());
        turns.retain(|turn| modules.insert(turn.module));
        connections.retain(|port| faces.insert(*port));
        Item::Segment(Segment { turns, connections })
    })
}

/// Random valid programs, with loops up to a depth and about so many items.
fn program_up_to(depth: u32, items: u32) -> impl Strategy<Value = Program> {
    let times = prop_oneof![8 => 1..4u32, 1 => 1..=MAX_TIMES];
    let item = segment().prop_recursive(depth, items, 4, move |inner| {
        (times.clone(), prop::collection::vec(inner, 1..4)).prop_map(|(times, items)| Item::Loop { times, items })
    });
    let program = prop::collection::vec(item, 1..4).prop_map(|items| Program { items });
    program.prop_filter("too many segments", |program| program.count() <= MAX_SEGMENTS)
}

/// Random valid programs, with loops up to depth 6.
pub fn program() -> impl Strategy<Value = Program> {
    program_up_to(6, 30)
}

/// Random pieces of the language, and random characters.
fn piece() -> impl Strategy<Value = String> {
    let known = prop::sample::select(vec![
        "{",
        "}",
        "[",
        "]",
        ",",
        ";",
        "#",
        "\n",
        "L",
        "m",
        "c",
        "0",
        "1",
        "45",
        "-90",
        "−",
        "°",
        " ",
        "c [1 1] 0",
        "L 2 {",
    ]);
    prop_oneof![9 => known.prop_map(str::to_owned), 1 => any::<char>().prop_map(String::from)]
}

/// Random texts of pieces.
pub fn pieces() -> impl Strategy<Value = String> {
    prop::collection::vec(piece(), 0..24).prop_map(|pieces| pieces.concat())
}

/// Random texts: printed programs with some characters replaced by pieces.
pub fn mutated() -> impl Strategy<Value = String> {
    let change = (any::<prop::sample::Index>(), 0..6usize, piece());
    (program_up_to(2, 6), prop::collection::vec(change, 0..4)).prop_map(|(program, changes)| {
        let mut text: Vec<char> = program.to_string().chars().collect();
        for (place, removed, piece) in changes {
            let start = place.index(text.len() + 1);
            let end = text.len().min(start + removed);
            text.splice(start..end, piece.chars());
        }
        text.into_iter().collect()
    })
}
