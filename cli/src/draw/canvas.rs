//! Canvas: collects shapes as SVG source.
//!
//! Callers pass SVG attributes as text, so the look of a picture is visible in its own file. Coordinates are in px,
//! with y downwards, and must be finite: each picture removes other values before it maps its data.

use super::palette::INK;
use std::fmt::Write as _;

/// Position of a text relative to its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

/// Style of a text.
#[derive(Clone, Copy, Debug)]
pub(super) struct Type {
    /// Font size, px.
    pub size: f64,
    pub bold: bool,
    pub colour: &'static str,
    pub anchor: Anchor,
    /// Rotated by 90° to the left: for titles of y axes.
    pub upright: bool,
    /// Drawn with a white outline, so that it is readable on top of data.
    pub halo: bool,
}

impl Type {
    pub const TITLE: Self = Self { size: 17.0, bold: true, ..Self::LABEL };
    /// Style of subtitles, axis titles and labels of marks.
    pub const LABEL: Self =
        Self { size: 13.0, bold: false, colour: INK, anchor: Anchor::Start, upright: false, halo: false };
    pub const TICK: Self = Self { size: 12.0, ..Self::LABEL };

    pub fn anchored(self, anchor: Anchor) -> Self {
        Self { anchor, ..self }
    }

    pub fn bold(self) -> Self {
        Self { bold: true, ..self }
    }

    pub fn coloured(self, colour: &'static str) -> Self {
        Self { colour, ..self }
    }

    pub fn upright(self) -> Self {
        Self { upright: true, ..self }
    }

    pub fn halo(self) -> Self {
        Self { halo: true, ..self }
    }
}

/// SVG source under construction.
pub(super) struct Canvas {
    body: String,
}

impl Canvas {
    pub fn new() -> Self {
        Self { body: String::new() }
    }

    /// Returns the whole document, on white.
    pub fn finish(self, width: f64, height: f64) -> String {
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" font-family=\"Inter\">\
             <rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>{}</svg>",
            self.body
        )
    }

    /// Adds source that is not a shape: definitions, groups.
    pub fn raw(&mut self, source: &str) {
        self.body.push_str(source);
    }

    pub fn rect(&mut self, x: f64, y: f64, width: f64, height: f64, attributes: &str) {
        let _ = write!(
            self.body,
            "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" {attributes}/>",
            px(x),
            px(y),
            px(width),
            px(height)
        );
    }

    pub fn line(&mut self, from: [f64; 2], to: [f64; 2], attributes: &str) {
        self.polylines(&[vec![from, to]], attributes);
    }

    /// Adds several open lines as one shape, so that a translucent stroke is not darker where lines cross.
    pub fn polylines(&mut self, lines: &[Vec<[f64; 2]>], attributes: &str) {
        self.path(lines, false, attributes);
    }

    pub fn polygon(&mut self, points: &[[f64; 2]], attributes: &str) {
        self.path(&[points.to_vec()], true, attributes);
    }

    fn path(&mut self, lines: &[Vec<[f64; 2]>], closed: bool, attributes: &str) {
        let mut data = String::new();
        for line in lines.iter().filter(|l| l.len() >= 2) {
            for (i, [x, y]) in line.iter().enumerate() {
                let _ = write!(data, "{}{} {}", if i == 0 { 'M' } else { 'L' }, px(*x), px(*y));
            }
            if closed {
                data.push('Z');
            }
        }
        if !data.is_empty() {
            let ends = if closed { "" } else { "fill=\"none\" stroke-linejoin=\"round\" stroke-linecap=\"round\" " };
            let _ = write!(self.body, "<path d=\"{data}\" {ends}{attributes}/>");
        }
    }

    pub fn circle(&mut self, [x, y]: [f64; 2], radius: f64, attributes: &str) {
        let _ = write!(self.body, "<circle cx=\"{}\" cy=\"{}\" r=\"{}\" {attributes}/>", px(x), px(y), px(radius));
    }

    /// Adds a text with the anchor of its baseline at the point.
    pub fn text(&mut self, [x, y]: [f64; 2], text: &str, style: Type) {
        let anchor = match style.anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let (x, y) = (px(x), px(y));
        let weight = if style.bold { 600 } else { 400 };
        let turn = if style.upright { format!(" transform=\"rotate(-90 {x} {y})\"") } else { String::new() };
        let halo = if style.halo {
            " stroke=\"#ffffff\" stroke-width=\"3.5\" stroke-linejoin=\"round\" paint-order=\"stroke\""
        } else {
            ""
        };
        let _ = write!(
            self.body,
            "<text x=\"{x}\" y=\"{y}\" font-size=\"{}\" font-weight=\"{weight}\" fill=\"{}\" text-anchor=\"{anchor}\"\
             {halo}{turn}>{}</text>",
            style.size,
            style.colour,
            escape(text)
        );
    }

    /// Adds an arrow with its tip at `to`. `width` is the width of the shaft, px.
    pub fn arrow(&mut self, from: [f64; 2], to: [f64; 2], width: f64, colour: &str) {
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let length = dx.hypot(dy);
        if length < 1e-9 {
            return;
        }
        let (ux, uy) = (dx / length, dy / length);
        let head = (4.0 * width).min(length);
        let neck = [to[0] - ux * head, to[1] - uy * head];
        let side = head * 0.45;
        self.line(from, neck, &stroke(colour, width));
        self.polygon(
            &[to, [neck[0] - uy * side, neck[1] + ux * side], [neck[0] + uy * side, neck[1] - ux * side]],
            &fill(colour),
        );
    }
}

/// Returns the attribute `fill="…"`.
pub(super) fn fill(colour: &str) -> String {
    format!("fill=\"{colour}\"")
}

/// Returns the attributes of a stroke with a colour and a width in px.
pub(super) fn stroke(colour: &str, width: f64) -> String {
    format!("stroke=\"{colour}\" stroke-width=\"{width}\"")
}

/// Rounds a coordinate to 0.01 px: a coarser step is visible in thin lines, a finer one is not.
fn px(value: f64) -> f64 {
    // Adding 0 converts −0 to 0.
    (value * 100.0).round() / 100.0 + 0.0
}

/// Escapes a text for XML. Control characters, which XML does not allow, become spaces.
fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push(' '),
            c => out.push(c),
        }
    }
    out
}
