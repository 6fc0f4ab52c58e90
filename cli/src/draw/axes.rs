//! Axes: ranges, round ticks, and the frame that maps data to the sheet.

use super::canvas::{Anchor, Canvas, Type, stroke};
use super::palette::{FAINT, FRAME, GRID};

/// Interval of finite numbers, low < high.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Range {
    pub low: f64,
    pub high: f64,
}

impl Range {
    /// Returns the range of the finite values; `None` if there are none. Equal values get room on both sides.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let sane = |v: &f64| v.is_finite() && v.abs() < 1e200;
        let mut range: Option<Self> = None;
        for v in values.into_iter().filter(sane) {
            let (low, high) = range.map_or((v, v), |r| (r.low.min(v), r.high.max(v)));
            range = Some(Self { low, high });
        }
        range.map(Self::widened)
    }

    /// Adds room around values that are (nearly) equal.
    fn widened(self) -> Self {
        let size = self.low.abs().max(self.high.abs());
        if self.span() > 1e-9 * size {
            return self;
        }
        let room = if size == 0.0 { 1.0 } else { 0.1 * size };
        Self { low: self.low - room, high: self.high + room }
    }

    pub fn span(self) -> f64 {
        self.high - self.low
    }

    /// Adds a share of the span at both ends.
    pub fn padded(self, share: f64) -> Self {
        let room = share * self.span();
        Self { low: self.low - room, high: self.high + room }
    }

    /// Extends the range to 0 if `low` is positive and below half of `high`, so that heights can be compared by eye.
    pub fn with_near_zero(self) -> Self {
        if self.low > 0.0 && self.low < 0.5 * self.high { Self { low: 0.0, ..self } } else { self }
    }

    /// Returns about `most` (at least 2) round numbers inside the range: multiples of 1, 2 or 5 times a power of ten.
    pub fn ticks(self, most: usize) -> Ticks {
        let rough = self.span() / most.max(2) as f64;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= rough).unwrap_or(10.0 * power);
        self.multiples(step)
    }

    /// Same as [`Range::ticks`], with whole numbers only.
    pub fn whole_ticks(self, most: usize) -> Ticks {
        let ticks = self.ticks(most);
        if ticks.step < 1.0 { self.multiples(1.0) } else { ticks }
    }

    fn multiples(self, step: f64) -> Ticks {
        // Tolerance for rounding: 0.3 is not a multiple of 0.1 in binary.
        let (first, last) = ((self.low / step - 1e-9).ceil(), (self.high / step + 1e-9).floor());
        let count = if last >= first { (last - first) as usize + 1 } else { 0 };
        Ticks {
            step,
            values: (0..count.min(1000)).map(|i| (first + i as f64) * step + 0.0).collect(),
            logarithmic: false,
        }
    }
}

/// Round numbers for the ticks of an axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ticks {
    pub step: f64,
    pub values: Vec<f64>,
    /// True if the values are exponents of ten.
    pub logarithmic: bool,
}

impl Ticks {
    /// Formats a tick with as many decimals as the step needs, and with the minus sign "−".
    pub fn label(&self, value: f64) -> String {
        if self.logarithmic {
            let number = 10f64.powf(value);
            let decimals = (-value - 1e-9).ceil().max(0.0) as usize;
            return with_minus(if (-4.0..6.0).contains(&value) {
                format!("{number:.decimals$}")
            } else {
                format!("{number:.0e}")
            });
        }
        let largest = self.values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        if largest >= 1e6 || self.step < 1e-4 {
            return with_minus(format!("{value:.1e}"));
        }
        let decimals = (-self.step.log10()).ceil().max(0.0) as usize;
        with_minus(format!("{value:.decimals$}"))
    }
}

/// Formats a number with about three significant digits, and with the minus sign "−".
pub(super) fn number(value: f64) -> String {
    let decimals = match value.abs() {
        v if v >= 1e6 || (v < 1e-3 && v > 0.0) => return with_minus(format!("{value:.2e}")),
        v if v >= 100.0 => 0,
        v if v >= 10.0 => 1,
        _ => 2,
    };
    with_minus(format!("{value:.decimals$}"))
}

fn with_minus(text: String) -> String {
    match text.strip_prefix('-') {
        // "-0.00" becomes "0.00".
        Some(rest) if rest.chars().all(|c| matches!(c, '0' | '.')) => rest.to_owned(),
        Some(_) => text.replace('-', "−"),
        None => text.replace('-', "−"),
    }
}

/// Rectangle for the data on the sheet, with the ranges of its axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    /// Left edge, px.
    pub left: f64,
    /// Upper edge, px.
    pub top: f64,
    /// Width, px.
    pub width: f64,
    /// Height, px.
    pub height: f64,
    /// Range of the x axis.
    pub x: Range,
    /// Range of the y axis.
    pub y: Range,
}

impl Frame {
    /// Returns the place of a pair of numbers on the sheet, px.
    pub fn at(&self, x: f64, y: f64) -> [f64; 2] {
        [
            self.left + (x - self.x.low) / self.x.span() * self.width,
            self.top + (self.y.high - y) / self.y.span() * self.height,
        ]
    }

    /// Returns a line of points, px. A point that is not finite splits the line. A point closer than 0.5 px to the one
    /// before is omitted.
    pub fn line(&self, points: impl IntoIterator<Item = [f64; 2]>) -> Vec<Vec<[f64; 2]>> {
        let mut lines: Vec<Vec<[f64; 2]>> = vec![Vec::new()];
        let mut skipped: Option<[f64; 2]> = None;
        for [x, y] in points {
            let place = self.at(x, y);
            // The second test excludes finite numbers that are far outside the sheet.
            let usable = x.is_finite() && y.is_finite() && place.iter().all(|v| v.abs() < 1e5);
            let open = lines.len() - 1;
            if !usable {
                lines[open].extend(skipped.take());
                if !lines[open].is_empty() {
                    lines.push(Vec::new());
                }
                continue;
            }
            match lines[open].last() {
                Some(last) if (last[0] - place[0]).hypot(last[1] - place[1]) < 0.5 => skipped = Some(place),
                _ => {
                    lines[open].push(place);
                    skipped = None;
                }
            }
        }
        let open = lines.len() - 1;
        lines[open].extend(skipped);
        lines.retain(|l| !l.is_empty());
        lines
    }

    /// Draws grid, ticks, border and titles. An axis that is `None` gets no ticks.
    pub fn draw(&self, canvas: &mut Canvas, x: Option<(&Ticks, &str)>, y: Option<(&Ticks, &str)>) {
        let (right, bottom) = (self.left + self.width, self.top + self.height);
        let tick = Type::TICK.coloured(FAINT);
        if let Some((ticks, title)) = x {
            for &v in &ticks.values {
                let px = self.at(v, self.y.low)[0];
                canvas.line([px, self.top], [px, bottom], &stroke(GRID, 1.0));
                canvas.line([px, bottom], [px, bottom + 4.0], &stroke(FRAME, 1.0));
                canvas.text([px, bottom + 18.0], &ticks.label(v), tick.anchored(Anchor::Middle));
            }
            let middle = [self.left + self.width / 2.0, bottom + 40.0];
            canvas.text(middle, title, Type::LABEL.anchored(Anchor::Middle));
        }
        if let Some((ticks, title)) = y {
            let mut widest: f64 = 0.0;
            for &v in &ticks.values {
                let py = self.at(self.x.low, v)[1];
                canvas.line([self.left, py], [right, py], &stroke(GRID, 1.0));
                canvas.line([self.left - 4.0, py], [self.left, py], &stroke(FRAME, 1.0));
                let label = ticks.label(v);
                widest = widest.max(super::picture::width(&label, tick));
                canvas.text([self.left - 8.0, py + 4.0], &label, tick.anchored(Anchor::End));
            }
            let middle = [self.left - 8.0 - widest - 12.0, self.top + self.height / 2.0];
            canvas.text(middle, title, Type::LABEL.anchored(Anchor::Middle).upright());
        }
        canvas.rect(self.left, self.top, self.width, self.height, &format!("fill=\"none\" {}", stroke(FRAME, 1.0)));
    }

    /// Writes a note in the middle of the frame, for a picture without data.
    pub fn say(&self, canvas: &mut Canvas, what: &str) {
        let middle = [self.left + self.width / 2.0, self.top + self.height / 2.0 + 5.0];
        canvas.text(middle, what, Type { size: 15.0, ..Type::LABEL }.coloured(FAINT).anchored(Anchor::Middle).halo());
    }
}
