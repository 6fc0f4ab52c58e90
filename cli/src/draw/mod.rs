//! The pictures of a report.
//!
//! Each is a function from data to a [`Picture`], which gives SVG and PNG. Fonts are embedded and text becomes outlines,
//! so a picture is the same on every machine. Whatever the data (none, one point, all equal, NaN), there is a readable
//! picture that says so.
//!
//! `canvas` writes SVG, `axes` turns numbers into places, `legend` writes what stands above the data; every other file is
//! one picture.

mod axes;
mod boxes;
mod canvas;
mod comparison;
mod convergence;
mod frontier;
mod legend;
mod map;
mod palette;
mod paths;
mod picture;
mod robot;
mod scatter;
#[cfg(test)]
mod tests;
mod traces;

pub use boxes::gait_boxes;
pub use comparison::comparison;
pub use convergence::convergence;
pub use frontier::{FrontierPoint, FrontierSet, frontier};
pub use map::map;
pub use paths::{DrawnPath, paths};
pub use picture::{DrawError, PNG_SCALE, Picture};
pub use robot::{DrawnBox, robot};
pub use scatter::{ScatterSet, scatter};
pub use traces::gait_traces;

/// A generation of a search, as `history.csv` has it. Scores in the fitness's unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HistoryRow {
    /// From 0.
    pub generation: u32,
    /// Least score.
    pub min: f64,
    /// A quarter of the scores is not greater.
    pub lower_quartile: f64,
    /// The middle score.
    pub median: f64,
    /// A quarter of the scores is not less.
    pub upper_quartile: f64,
    /// Greatest score.
    pub max: f64,
    /// Best score of this and all earlier generations; `None` while all have failed.
    pub best_so_far: Option<f64>,
}

/// The turn from one heading to another, rad, in ±π.
fn turn(from: f64, to: f64) -> f64 {
    let full = std::f64::consts::TAU;
    let turn = (to - from).rem_euclid(full);
    if turn > full / 2.0 { turn - full } else { turn }
}
