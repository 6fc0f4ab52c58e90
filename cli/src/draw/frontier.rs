//! What speed costs: engine settings by speed against rank correlation and error.

use super::Picture;
use super::axes::{Frame, Range, Ticks};
use super::canvas::{Anchor, Canvas, Type, fill, stroke};
use super::legend::{Key, heading, legend};
use super::palette::{FAINT, INK, series};

const WIDTH: f64 = 1080.0;
const HEIGHT: f64 = 520.0;
/// Between the two frames, room for the second one's ticks and title.
const GAP: f64 = 96.0;

/// An engine setting. Triples are the lower end of an interval, the value, the upper end.
#[derive(Clone, Debug, PartialEq)]
pub struct FrontierPoint {
    /// Such as "30x8".
    pub name: String,
    /// Simulated s a CPU s.
    pub speed: f64,
    /// Rank correlation with the reference.
    pub correlation: Option<[f64; 3]>,
    /// Median error, mu.
    pub error: Option<[f64; 3]>,
}

/// The settings on one kind of gaits.
#[derive(Clone, Debug, PartialEq)]
pub struct FrontierSet {
    /// Such as "evolved gaits".
    pub name: String,
    /// The settings.
    pub points: Vec<FrontierPoint>,
    /// Simulated s a CPU s.
    pub reference_speed: f64,
    /// What the reference reaches against itself.
    pub ceiling_correlation: f64,
    /// What the reference reaches against itself, mu.
    pub ceiling_error: f64,
}

/// Two frames over speed (logarithmic): rank correlation, and median error (logarithmic). The reference's speed is an
/// upright line, the ceiling of each kind of gaits a level one. Values that are not finite are left out.
pub fn frontier(sets: &[FrontierSet], title: &str, subtitle: &str) -> Picture {
    let mut canvas = Canvas::new();
    let top = heading(&mut canvas, title, subtitle, WIDTH);
    let mut keys: Vec<Key> = Vec::new();
    for (i, set) in sets.iter().enumerate() {
        let paint = fill(series(i));
        keys.push(Key::new(set.name.clone(), move |canvas, at| canvas.circle(at, 5.0, &paint)));
        keys.push(Key::line(format!("{}: the ceiling", set.name), ceiling_paint(i)));
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

    let (left, width) = (76.0, (WIDTH - 76.0 - GAP - 32.0) / 2.0);
    let height = HEIGHT - top - 60.0;
    let frames = [
        Frame { left, top, width, height, x: speed, y: correlation },
        Frame { left: left + width + GAP, top, width, height, x: speed, y: error },
    ];
    let across = speed.powers_of_ten(6);
    let titles = ["Spearman's rank correlation of distance", "median position error, mu"];
    for (frame, (y, name)) in frames.iter().zip([correlation.ticks(7), error.powers_of_ten(6)].iter().zip(titles)) {
        frame.draw(&mut canvas, Some((&across, "simulated s a CPU s")), Some((y, name)));
    }
    for (i, set) in sets.iter().enumerate() {
        let at = log10(set.reference_speed);
        for (frame, ceiling) in frames.iter().zip([set.ceiling_correlation, log10(set.ceiling_error)]) {
            level(&mut canvas, frame, ceiling, &ceiling_paint(i));
            upright(&mut canvas, frame, at, &reference_paint());
        }
    }
    for (i, set) in sets.iter().enumerate() {
        for point in &set.points {
            let error = point.error.map(|triple| triple.map(log10));
            for (frame, triple) in frames.iter().zip([point.correlation, error]) {
                // Sets of the same setting have nearly the same speed: only the first is named.
                let name = if i == 0 { point.name.as_str() } else { "" };
                mark(&mut canvas, frame, log10(point.speed), triple, series(i), name);
            }
        }
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

/// What is not positive has no place on a logarithmic axis.
fn log10(value: f64) -> f64 {
    if value > 0.0 { value.log10() } else { f64::NAN }
}

fn level(canvas: &mut Canvas, frame: &Frame, y: f64, paint: &str) {
    canvas.polylines(&frame.line([[frame.x.low, y], [frame.x.high, y]]), paint);
}

fn upright(canvas: &mut Canvas, frame: &Frame, x: f64, paint: &str) {
    canvas.polylines(&frame.line([[x, frame.y.low], [x, frame.y.high]]), paint);
}

fn mark(canvas: &mut Canvas, frame: &Frame, x: f64, triple: Option<[f64; 3]>, colour: &str, name: &str) {
    let Some([low, value, high]) = triple else { return };
    canvas.polylines(&frame.line([[x, low.max(frame.y.low)], [x, high]]), &stroke(colour, 1.75));
    // A point that has no place on the sheet gives no line either.
    for at in frame.line([[x, value]]).concat() {
        canvas.circle(at, 5.0, &format!("{} stroke=\"#ffffff\" stroke-width=\"1\"", fill(colour)));
        let style = Type::TICK.coloured(FAINT).halo();
        // Names stand on the side where there is room.
        let right = at[0] < frame.left + 0.75 * frame.width;
        let (shift, anchor) = if right { (9.0, Anchor::Start) } else { (-9.0, Anchor::End) };
        canvas.text([at[0] + shift, at[1] + 4.0], name, style.anchored(anchor));
    }
}

impl Range {
    /// Round numbers of a logarithmic axis, whose range is one of powers of ten: 1, 2 and 5 times each, or each alone.
    pub(super) fn powers_of_ten(self, most: usize) -> Ticks {
        let steps: &[f64] = match (self.span() * 3.0) as usize {
            n if n <= most => &[1.0, 2.0, 5.0],
            _ => &[1.0],
        };
        let powers = self.low.floor().max(-300.0) as i32..=self.high.ceil().min(300.0) as i32;
        let values = powers.flat_map(|p| steps.iter().map(move |s| f64::from(p) + s.log10()));
        let mut values: Vec<f64> = values.filter(|v| (self.low..=self.high).contains(v)).collect();
        while values.len() > most.max(2) {
            values = values.into_iter().step_by(2).collect();
        }
        Ticks { step: 1.0, values, logarithmic: true }
    }
}
