//! Headings and legends. Both are above the data, never on it.

use super::canvas::{Canvas, Type};
use super::palette::FAINT;
use super::picture::{fitted, width};

/// Left and right margin of headings and legends, px.
pub(super) const MARGIN: f64 = 24.0;
/// Height of a row of the legend, px.
const ROW: f64 = 22.0;
/// Width of a sample in the legend, px.
const SAMPLE: f64 = 26.0;

/// Function that draws a sample around a point, in a box of 26 × 12 px.
type Sample = Box<dyn Fn(&mut Canvas, [f64; 2])>;

/// Entry of a legend: a sample of a mark, and its meaning.
pub(super) struct Key {
    label: String,
    sample: Sample,
}

impl Key {
    pub fn new(label: impl Into<String>, sample: impl Fn(&mut Canvas, [f64; 2]) + 'static) -> Self {
        Self { label: label.into(), sample: Box::new(sample) }
    }

    /// Creates a key with a short line as its sample.
    pub fn line(label: impl Into<String>, attributes: String) -> Self {
        Self::new(label, move |canvas, [x, y]| canvas.line([x - 12.0, y], [x + 12.0, y], &attributes))
    }

    /// Creates a key with a small filled rectangle as its sample.
    pub fn area(label: impl Into<String>, attributes: String) -> Self {
        Self::new(label, move |canvas, [x, y]| canvas.rect(x - 11.0, y - 6.0, 22.0, 12.0, &attributes))
    }
}

/// Writes the title and, if not empty, the subtitle below it. Returns the y of the free space below, px.
pub(super) fn heading(canvas: &mut Canvas, title: &str, subtitle: &str, sheet: f64) -> f64 {
    let room = sheet - 2.0 * MARGIN;
    canvas.text([MARGIN, 32.0], &fitted(title, Type::TITLE, room), Type::TITLE);
    if subtitle.is_empty() {
        return 44.0;
    }
    canvas.text([MARGIN, 53.0], &fitted(subtitle, Type::LABEL, room), Type::LABEL.coloured(FAINT));
    64.0
}

/// Draws the keys in rows from `top`. Returns the y of the free space below, px.
pub(super) fn legend(canvas: &mut Canvas, keys: &[Key], top: f64, sheet: f64) -> f64 {
    let (mut x, mut y) = (MARGIN, top + ROW / 2.0);
    for key in keys {
        let label = fitted(&key.label, Type::TICK, sheet - 2.0 * MARGIN - SAMPLE);
        let needed = SAMPLE + 6.0 + width(&label, Type::TICK);
        if x > MARGIN && x + needed > sheet - MARGIN {
            (x, y) = (MARGIN, y + ROW);
        }
        (key.sample)(canvas, [x + SAMPLE / 2.0, y]);
        canvas.text([x + SAMPLE + 6.0, y + 4.5], &label, Type::TICK);
        x += needed + 20.0;
    }
    if keys.is_empty() { top } else { y + ROW / 2.0 + 6.0 }
}
