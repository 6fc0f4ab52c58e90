//! Pictures of results.
//!
//! Each picture is a function from data to a [`Picture`], which has an SVG and a PNG form. Fonts are embedded and text
//! becomes outlines, so a picture is the same on every machine. A picture without usable data (none, or NaN only) is
//! readable and has a note in its frame. One point and equal values are drawn, too.
//!
//! `canvas` writes SVG, `axes` maps numbers to the sheet, `legend` writes titles and keys above the data. Every other
//! file draws one picture.

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

/// Generation of a search: a row of `history.csv`. Scores are in the unit of the fitness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HistoryRow {
    /// Index of the generation, from 0.
    pub generation: u32,
    /// Least score.
    pub min: f64,
    /// First quartile.
    pub lower_quartile: f64,
    /// Median score.
    pub median: f64,
    /// Third quartile.
    pub upper_quartile: f64,
    /// Greatest score.
    pub max: f64,
    /// Best score of this and all earlier generations; `None` while all evaluations have failed.
    pub best_so_far: Option<f64>,
}

/// Returns the turn from one heading to another, rad, in ±π.
fn turn(from: f64, to: f64) -> f64 {
    let full = std::f64::consts::TAU;
    let turn = (to - from).rem_euclid(full);
    if turn > full / 2.0 { turn - full } else { turn }
}
