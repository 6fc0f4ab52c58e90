//! Scatter plot of pairs of numbers that should be equal.

use super::Picture;
use super::axes::{Frame, Range};
use super::canvas::{Canvas, fill, stroke};
use super::legend::{Key, heading, legend};
use super::palette::{FAINT, series};

const WIDTH: f64 = 640.0;
const HEIGHT: f64 = 680.0;

/// Pairs of one kind, with one colour.
#[derive(Clone, Debug, PartialEq)]
pub struct ScatterSet {
    /// Name, such as "random genotypes".
    pub name: String,
    /// Pairs (x, y), both in the same unit.
    pub points: Vec<[f64; 2]>,
}

/// Draws points over the same range of x and y, with the line x = y. Values that are not finite are omitted.
pub fn scatter(sets: &[ScatterSet], title: &str, subtitle: &str, x: &str, y: &str) -> Picture {
    let mut canvas = Canvas::new();
    let equals = format!("{} stroke-dasharray=\"7 4\"", stroke(FAINT, 1.5));
    let paint = |i: usize| format!("{} fill-opacity=\"0.75\"", fill(series(i)));
    let top = heading(&mut canvas, title, subtitle, WIDTH);
    let keys = sets.iter().enumerate().map(|(i, set)| {
        let paint = paint(i);
        Key::new(set.name.clone(), move |canvas, at| canvas.circle(at, 4.0, &paint))
    });
    let keys: Vec<Key> = keys.chain([Key::line("equal values", equals.clone())]).collect();
    let top = legend(&mut canvas, &keys, top, WIDTH) + 8.0;

    let values = sets.iter().flat_map(|s| s.points.iter().flatten().copied());
    let found = Range::of(values);
    let range = found.map_or(Range { low: 0.0, high: 1.0 }, |r| r.padded(0.04));
    let frame = Frame { left: 84.0, top, width: WIDTH - 84.0 - 32.0, height: HEIGHT - top - 60.0, x: range, y: range };
    let ticks = range.ticks(7);
    frame.draw(&mut canvas, Some((&ticks, x)), Some((&ticks, y)));
    canvas.polylines(&frame.line([[range.low, range.low], [range.high, range.high]]), &equals);
    for (i, set) in sets.iter().enumerate() {
        for &point in &set.points {
            // `line` is empty for a point that has no place on the sheet.
            for at in frame.line([point]).concat() {
                canvas.circle(at, 4.0, &paint(i));
            }
        }
    }
    if found.is_none() {
        frame.say(&mut canvas, "no data: there are no scores");
    }
    Picture::new(canvas.finish(WIDTH, HEIGHT), WIDTH as u32, HEIGHT as u32)
}
