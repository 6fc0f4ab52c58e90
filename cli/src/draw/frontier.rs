//! Trade-off of engine settings: speed against rank correlation and error.

use super::Picture;
use super::axes::{Frame, Range, Ticks};
use super::canvas::{Canvas, Type, fill, stroke};
use super::legend::{Key, heading, legend};
use super::palette::{FAINT, INK, series};
use super::picture::width;

const WIDTH: f64 = 1080.0;
const HEIGHT: f64 = 520.0;
/// Gap between the two frames, with room for the ticks and the title of the second one, px.
const GAP: f64 = 96.0;
/// Radius of a point, px.
const RADIUS: f64 = 5.0;

/// Engine setting. Triples are (lower end of the interval, value, upper end).
#[derive(Clone, Debug, PartialEq)]
pub struct FrontierPoint {
    /// Name, such as "30x8".
    pub name: String,
    /// Simulated seconds per CPU second.
    pub speed: f64,
    /// Rank correlation with the reference setting.
    pub correlation: Option<[f64; 3]>,
    /// Median position error, mu.
    pub error: Option<[f64; 3]>,
}

/// Engine settings, measured on one kind of gaits.
#[derive(Clone, Debug, PartialEq)]
pub struct FrontierSet {
    /// Kind of gaits, such as "evolved gaits".
    pub name: String,
    /// Settings with their measurements.
    pub points: Vec<FrontierPoint>,
    /// Speed of the reference setting, simulated seconds per CPU second.
    pub reference_speed: f64,
    /// Rank correlation of the reference setting with itself from a disturbed start.
    pub ceiling_correlation: f64,
    /// Median position error of the reference setting against itself from a disturbed start, mu.
    pub ceiling_error: f64,
}

/// Draws two frames over speed (logarithmic): rank correlation, and median error (logarithmic). The speed of the
/// reference is a vertical line, the ceiling of each kind of gaits a horizontal one. Values that are not finite are
/// omitted.
pub fn frontier(sets: &[FrontierSet], title: &str, subtitle: &str) -> Picture {
    let mut canvas = Canvas::new();
    let top = heading(&mut canvas, title, subtitle, WIDTH);
    let mut keys: Vec<Key> = Vec::new();
    for (i, set) in sets.iter().enumerate() {
        let paint = fill(series(i));
        keys.push(Key::new(set.name.clone(), move |canvas, at| canvas.circle(at, 5.0, &paint)));
        keys.push(Key::line(format!("{}: ceiling", set.name), ceiling_paint(i)));
    }
    keys.push(Key::line("speed of the reference", reference_paint()));
    let top = legend(&mut canvas, &keys, top, WIDTH) + 10.0;

    let points = || sets.iter().flat_map(|s| &s.points);
    let speeds = points().map(|p| p.speed).chain(sets.iter().map(|s| s.reference_speed));
    let speed = Range::of(speeds.map(log10)).unwrap_or(Range { low: 1.0, high: 3.0 }).padded(0.08);
    let ends = |triple: Option<[f64; 3]>| triple.into_iter().flatten();
    let correlations = points().flat_map(|p| ends(p.correlation)).chain(sets.iter().map(|s| s.ceiling_correlation));
    let correlation = Range::of(correlations.chain([1.0])).map_or(Range { low: 0.0, high: 1.0 }, |r| Range {
        low: r.low - 0.08 * r.span(),
        high: r.high + 0.04 * r.span(),
    });
    let errors = points().flat_map(|p| ends(p.error)).chain(sets.iter().map(|s| s.ceiling_error));
    let error = Range::of(errors.map(log10)).unwrap_or(Range { low: -2.0, high: 0.0 }).padded(0.06);

    let (left, wide) = (76.0, (WIDTH - 76.0 - GAP - 32.0) / 2.0);
    let height = HEIGHT - top - 60.0;
    let frames = [
        Frame { left, top, width: wide, height, x: speed, y: correlation },
        Frame { left: left + wide + GAP, top, width: wide, height, x: speed, y: error },
    ];
    let across = speed.powers_of_ten(8);
    let titles = ["Spearman's rank correlation of distance", "median position error, mu"];
    for (frame, (y, name)) in frames.iter().zip([correlation.ticks(7), error.powers_of_ten(8)].iter().zip(titles)) {
        frame.draw(&mut canvas, Some((&across, "simulated seconds per CPU second")), Some((y, name)));
    }
    for (i, set) in sets.iter().enumerate() {
        let at = log10(set.reference_speed);
        for (frame, ceiling) in frames.iter().zip([set.ceiling_correlation, log10(set.ceiling_error)]) {
            level(&mut canvas, frame, ceiling, &ceiling_paint(i));
            upright(&mut canvas, frame, at, &reference_paint());
        }
    }
    for (frame, of_error) in frames.iter().zip([false, true]) {
        let place = |p: &FrontierPoint| {
            let triple = if of_error { p.error.map(|t| t.map(log10)) } else { p.correlation };
            (log10(p.speed), triple)
        };
        let mut named = Vec::new();
        for (i, set) in sets.iter().enumerate() {
            for point in &set.points {
                let (x, triple) = place(point);
                mark(&mut canvas, frame, x, triple, series(i));
                // The points of a setting have nearly the same speed in all sets: only the first one gets a name.
                let name = if i == 0 { point.name.as_str() } else { "" };
                let at = frame.line(triple.map(|[_, value, _]| [x, value])).concat();
                named.extend(at.first().map(|at| (*at, name)));
            }
        }
        names(&mut canvas, frame, &named);
    }
    if points().next().is_none() {
        frames.iter().for_each(|frame| frame.say(&mut canvas, "no data: no setting was compared"));
    }
    Picture::new(canvas.finish(WIDTH, HEIGHT), WIDTH as u32, HEIGHT as u32)
}

fn ceiling_paint(set: usize) -> String {
    format!("{} stroke-dasharray=\"7 4\"", stroke(series(set), 1.5))
}

fn reference_paint() -> String {
    format!("{} stroke-dasharray=\"2 4\"", stroke(INK, 1.5))
}

/// Returns the logarithm; NaN for a value that is not positive, which a logarithmic axis can't show.
fn log10(value: f64) -> f64 {
    if value > 0.0 { value.log10() } else { f64::NAN }
}

fn level(canvas: &mut Canvas, frame: &Frame, y: f64, paint: &str) {
    canvas.polylines(&frame.line([[frame.x.low, y], [frame.x.high, y]]), paint);
}

fn upright(canvas: &mut Canvas, frame: &Frame, x: f64, paint: &str) {
    canvas.polylines(&frame.line([[x, frame.y.low], [x, frame.y.high]]), paint);
}

fn mark(canvas: &mut Canvas, frame: &Frame, x: f64, triple: Option<[f64; 3]>, colour: &str) {
    let Some([low, value, high]) = triple else { return };
    canvas.polylines(&frame.line([[x, low.max(frame.y.low)], [x, high]]), &stroke(colour, 1.75));
    // `line` is empty for a point that has no place on the sheet.
    for at in frame.line([[x, value]]).concat() {
        canvas.circle(at, RADIUS, &format!("{} stroke=\"#ffffff\" stroke-width=\"1\"", fill(colour)));
    }
}

/// Writes names beside their points. Each name gets the first side on which it covers no other name and no point; if
/// there is none, the first on which it covers no other name.
fn names(canvas: &mut Canvas, frame: &Frame, points: &[([f64; 2], &str)]) {
    let style = Type::TICK.coloured(FAINT).halo();
    let around = |[x, y]: [f64; 2], half: [f64; 2]| [x - half[0], y - half[1], x + half[0], y + half[1]];
    let mut taken: Vec<[f64; 4]> = points.iter().map(|(at, _)| around(*at, [RADIUS; 2])).collect();
    for (at, name) in points.iter().filter(|(_, name)| !name.is_empty()) {
        let half = [width(name, style) / 2.0, 7.0];
        let (beside, above) = (half[0] + RADIUS + 4.0, half[1] + RADIUS + 2.0);
        let sides = [[beside, 0.0], [-beside, 0.0], [0.0, -above], [0.0, above], [beside, -above], [-beside, above]];
        let boxes = sides.map(|[dx, dy]| around([at[0] + dx, at[1] + dy], half));
        let inside = |b: &[f64; 4]| b[0] > frame.left && b[2] < frame.left + frame.width && b[1] > frame.top;
        let apart = |a: &[f64; 4], b: &[f64; 4]| a[2] < b[0] || b[2] < a[0] || a[3] < b[1] || b[3] < a[1];
        let free_of = |taken: &[[f64; 4]]| boxes.iter().find(|b| inside(b) && taken.iter().all(|t| apart(t, b)));
        let free = free_of(&taken).or_else(|| free_of(&taken[points.len()..]));
        let [left, top, ..] = *free.unwrap_or(&boxes[0]);
        canvas.text([left, top + 11.0], name, style);
        taken.push([left, top, left + 2.0 * half[0], top + 2.0 * half[1]]);
    }
}

impl Range {
    /// Returns at most `most` ticks of a logarithmic axis. The range has exponents of ten; the ticks are 1, 2 and 5
    /// times each power of ten, or only the powers if those are too many.
    pub(super) fn powers_of_ten(self, most: usize) -> Ticks {
        let powers = || self.low.floor().max(-300.0) as i32..=self.high.ceil().min(300.0) as i32;
        let of = |steps: &[f64]| -> Vec<f64> {
            let values = powers().flat_map(|p| steps.iter().map(move |s| f64::from(p) + s.log10()));
            values.filter(|v| (self.low..=self.high).contains(v)).collect()
        };
        let fine = of(&[1.0, 2.0, 5.0]);
        let mut values = if fine.len() <= most { fine } else { of(&[1.0]) };
        while values.len() > most.max(2) {
            values = values.into_iter().step_by(2).collect();
        }
        Ticks { step: 1.0, values, logarithmic: true }
    }
}
