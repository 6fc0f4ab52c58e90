//! Configurations of the paper's figures, segments, and a source of random numbers.

mod feasibility;
mod figures;
mod initial_states;
mod rules;

use sim_core::control::sequence::{Segment, Turn};
use sim_core::model::mtran::{Angle, Configuration, Port};

/// Fig. 2 of the paper.
pub const FIG_2: &str = "\
ID 0 p(0,0,0) z(0,1,0) y(-1,0,0) (0, 0)
ID 1 p(-1,1,0) z(-1,0,0) y(0,1,0) (0, 0)
ID 2 p(-1,-1,0) z(-1,0,0) y(0,-1,0) (0, 0)
";

/// Fig. 3 of the paper: three modules in a row, all angles 0.
pub const FIG_3: &str = "\
ID 0 p(0,0,0) z(0,0,1) y(0,1,0) (0, 0)
ID 1 p(0,2,0) z(0,0,1) y(0,1,0) (0, 0)
ID 2 p(0,4,0) z(0,0,1) y(0,1,0) (0, 0)
";

pub fn robot(text: &str) -> Configuration {
    Configuration::of_text(text).expect("a valid configuration")
}

pub fn port(module: u32, part: u8, face: u8) -> Port {
    Port { module, part, face }
}

pub fn angle(degrees: i64) -> Angle {
    Angle::of_degrees(degrees).expect("a multiple of 30°")
}

/// Returns the operation `m [module base] first, second`.
pub fn m(module: u32, base: u8, first: i64, second: i64) -> Turn {
    Turn { module, base, angles: [angle(first), angle(second)] }
}

pub fn segment(turns: &[Turn], connections: &[Port]) -> Segment {
    Segment { turns: turns.to_vec(), connections: connections.to_vec() }
}

/// Returns whole numbers below n from a seed, by SplitMix64.
pub fn source(seed: u64) -> impl FnMut(u32) -> u32 {
    let mut state = seed;
    move |n| {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        ((u128::from(z) * u128::from(n)) >> 64) as u32
    }
}

/// Draws a segment for a robot of `modules` modules: 1 to 3 turns of different modules, and 0 to 3 connections of any
/// faces, a face that is drawn twice counts once. Everything is uniform.
pub fn random_segment(modules: u32, below: &mut impl FnMut(u32) -> u32) -> Segment {
    let mut segment = Segment::default();
    let mut left: Vec<u32> = (0..modules).collect();
    for _ in 0..(1 + below(3)).min(modules) {
        let module = left.swap_remove(below(left.len() as u32) as usize);
        let mut draw = || Angle::of_steps(below(7) as i8 - 3).expect("within ±90°");
        let angles = [draw(), draw()];
        segment.turns.push(Turn { module, base: below(2) as u8, angles });
    }
    for _ in 0..below(4) {
        let named = port(below(modules), below(2) as u8, below(3) as u8);
        if !segment.connections.contains(&named) {
            segment.connections.push(named);
        }
    }
    segment
}
