//! Colours: greys, and colours of the palette of M. Okabe and K. Ito, which people with any kind of colour blindness
//! can distinguish.

/// Colour of text and of axis titles.
pub(super) const INK: &str = "#222222";
/// Colour of secondary text.
pub(super) const FAINT: &str = "#6b6b6b";
/// Colour of frames.
pub(super) const FRAME: &str = "#9a9a9a";
/// Colour of grid lines behind the data.
pub(super) const GRID: &str = "#e6e6e6";
/// Colour of obstacles, which the robot must not touch.
pub(super) const OBSTACLE: &str = "#4a4a4a";
/// Colour of terrain, which the robot may touch and stand on.
pub(super) const TERRAIN: &str = "#d3c19c";
/// Colour of the most important part of a picture.
pub(super) const ACCENT: &str = "#d55e00";
/// Main colour of the data, in contrast to the accent.
pub(super) const BASE: &str = "#0072b2";

/// Colours of numbered items. The accent and black are not among them, so that they can highlight.
pub(super) const SERIES: [&str; 6] = ["#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#8c6d1f"];

/// Returns the colour of the i-th item. After six items the colours repeat, with other dashes ([`dashes`]).
pub(super) fn series(i: usize) -> &'static str {
    SERIES[i % SERIES.len()]
}

/// Returns the dash attribute of the i-th item; empty (solid) for the first six.
pub(super) fn dashes(i: usize) -> &'static str {
    ["", " stroke-dasharray=\"7 4\"", " stroke-dasharray=\"2 4\"", " stroke-dasharray=\"9 3 2 3\""]
        [i / SERIES.len() % 4]
}
