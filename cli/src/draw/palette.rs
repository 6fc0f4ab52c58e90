//! Colours: the eight of M. Okabe and K. Ito, which people with any kind of colour blindness tell apart, and greys.

/// Text, axes' titles.
pub(super) const INK: &str = "#222222";
/// What is said in passing.
pub(super) const FAINT: &str = "#6b6b6b";
/// Frames.
pub(super) const FRAME: &str = "#9a9a9a";
/// Lines behind the data.
pub(super) const GRID: &str = "#e6e6e6";
/// What must not be touched.
pub(super) const OBSTACLE: &str = "#4a4a4a";
/// What may be touched and stood on.
pub(super) const TERRAIN: &str = "#d3c19c";
/// The one thing to look at first.
pub(super) const ACCENT: &str = "#d55e00";
/// What it stands out from.
pub(super) const BASE: &str = "#0072b2";

/// For things that are told apart by number. The accent and black stay free for what stands out among them.
pub(super) const SERIES: [&str; 6] = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#8c6d1f"];

/// A colour for the i-th thing; after six they come again, with other dashes ([`dashes`]).
pub(super) fn series(i: usize) -> &'static str {
    SERIES[i % SERIES.len()]
}

/// The dash attribute that goes with [`series`]; empty (solid) for the first six.
pub(super) fn dashes(i: usize) -> &'static str {
    ["", " stroke-dasharray=\"7 4\"", " stroke-dasharray=\"2 4\"", " stroke-dasharray=\"9 3 2 3\""]
        [i / SERIES.len() % 4]
}
