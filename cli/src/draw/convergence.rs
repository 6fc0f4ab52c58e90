//! Convergence of a search: the scores of each generation, and the best so far.

use super::axes::{Frame, Range, number};
use super::canvas::{Canvas, Type, fill, stroke};
use super::legend::{Key, heading, legend};
use super::palette::{ACCENT, BASE, INK};
use super::{HistoryRow, Picture};

const WIDTH: f64 = 880.0;
const HEIGHT: f64 = 500.0;
/// Limit on the number of generations drawn: the sheet has no more columns of pixels. Longer histories are thinned.
const MOST_ROWS: usize = 1500;

/// Draws the best score so far, and the median, quartile band and range of the scores over generations. `audited` has
/// (generation, score without reuse) of each new best of the search; they are drawn as crosses. `label` is the name and
/// unit of the score, such as "coverage, %". Values that are not finite are omitted, and interrupt lines and bands.
pub fn convergence(history: &[HistoryRow], audited: &[[f64; 2]], title: &str, label: &str) -> Picture {
    let rows = thinned(history);
    let mut canvas = Canvas::new();
    let range_paint = format!("{} fill-opacity=\"0.10\"", fill(BASE));
    let quartile_paint = format!("{} fill-opacity=\"0.25\"", fill(BASE));
    let (median_paint, best_paint) = (stroke(BASE, 1.75), stroke(ACCENT, 2.75));

    let top = heading(&mut canvas, title, "", WIDTH);
    let cross_paint = stroke(INK, 1.5);
    let mut keys = vec![
        Key::line("best so far", best_paint.clone()),
        Key::line("median of the generation", median_paint.clone()),
        Key::area("middle half of the generation (quartiles)", quartile_paint.clone()),
        Key::area("range of the generation (min to max)", range_paint.clone()),
    ];
    if !audited.is_empty() {
        let paint = cross_paint.clone();
        let sample = move |canvas: &mut Canvas, at| canvas.polylines(&cross(at), &paint);
        keys.insert(1, Key::new("new best, scored without reuse", sample));
    }
    let top = legend(&mut canvas, &keys, top, WIDTH) + 6.0;

    let values = rows
        .iter()
        .flat_map(|r| [r.min, r.lower_quartile, r.median, r.upper_quartile, r.max, r.best_so_far.unwrap_or(f64::NAN)])
        .chain(audited.iter().map(|[_, score]| *score));
    let found = Range::of(values);
    let y = scores_axis(found);
    let generation = |r: &HistoryRow| f64::from(r.generation);
    let x = match (rows.first(), rows.last()) {
        (Some(first), Some(last)) if generation(last) > generation(first) => {
            Range { low: generation(first), high: generation(last) }
        }
        (Some(only), _) => Range { low: generation(only) - 1.0, high: generation(only) + 1.0 },
        _ => Range { low: 0.0, high: 1.0 },
    };
    let frame = Frame { left: 84.0, top, width: WIDTH - 84.0 - 84.0, height: HEIGHT - top - 60.0, x, y };
    let mut generations = x.whole_ticks(10);
    // A single generation gets no ticks for its neighbours.
    generations.values.retain(|v| rows.len() != 1 || *v == generation(rows[0]));
    frame.draw(&mut canvas, Some((&generations, "generation")), Some((&y.ticks(7), label)));

    band(&mut canvas, &frame, &rows, |r| (r.min, r.max), &range_paint);
    band(&mut canvas, &frame, &rows, |r| (r.lower_quartile, r.upper_quartile), &quartile_paint);
    series(&mut canvas, &frame, rows.iter().map(|r| [generation(r), r.median]), BASE, &median_paint);
    let best = |r: &HistoryRow| r.best_so_far.unwrap_or(f64::NAN);
    series(&mut canvas, &frame, steps(rows.iter().map(|r| [generation(r), best(r)])), ACCENT, &best_paint);

    for [generation, score] in audited.iter().filter(|at| at.iter().all(|v| v.is_finite())) {
        canvas.polylines(&cross(frame.at(*generation, *score)), &cross_paint);
    }

    if let Some(last) = rows.last().filter(|r| best(r).is_finite()) {
        let [px, py] = frame.at(generation(last), best(last));
        canvas.text([px + 8.0, py + 4.5], &number(best(last)), Type::LABEL.bold().coloured(ACCENT).halo());
    }
    if found.is_none() {
        frame.say(
            &mut canvas,
            if rows.is_empty() { "no data: no generation has finished" } else { "no data: all evaluations failed" },
        );
    }
    Picture::new(canvas.finish(WIDTH, HEIGHT), WIDTH as u32, HEIGHT as u32)
}

/// Returns the range of the axis for scores with the given range.
pub(super) fn scores_axis(found: Option<Range>) -> Range {
    found.map_or(Range { low: 0.0, high: 1.0 }, |r| {
        let padded = r.with_near_zero().padded(0.05);
        // An axis of scores that are not negative ends at 0.
        if r.low >= 0.0 { Range { low: padded.low.max(0.0), ..padded } } else { padded }
    })
}

/// Returns every n-th row and the last, at most about [`MOST_ROWS`].
fn thinned(history: &[HistoryRow]) -> Vec<&HistoryRow> {
    let every = history.len().div_ceil(MOST_ROWS).max(1);
    history.iter().enumerate().filter(|(i, _)| i % every == 0 || i + 1 == history.len()).map(|(_, r)| r).collect()
}

/// Returns the lines of a small cross around a place on the sheet.
fn cross([x, y]: [f64; 2]) -> [Vec<[f64; 2]>; 2] {
    let r = 4.0;
    [vec![[x - r, y - r], [x + r, y + r]], vec![[x - r, y + r], [x + r, y - r]]]
}

/// Converts points to a staircase: a value holds until the next one.
pub(super) fn steps(points: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
    let mut stairs: Vec<[f64; 2]> = Vec::new();
    for [x, y] in points {
        if let Some(&[_, before]) = stairs.last() {
            stairs.push([x, before]);
        }
        stairs.push([x, y]);
    }
    stairs
}

/// Draws a line; a point without finite neighbours becomes a dot.
fn series(canvas: &mut Canvas, frame: &Frame, points: impl IntoIterator<Item = [f64; 2]>, colour: &str, paint: &str) {
    let lines = frame.line(points);
    canvas.polylines(&lines, paint);
    for alone in lines.iter().filter(|l| l.len() == 1) {
        canvas.circle(alone[0], 4.0, &fill(colour));
    }
}

/// Draws the area between two values, in pieces where both are finite. A piece of one generation becomes a bar.
fn band(
    canvas: &mut Canvas,
    frame: &Frame,
    rows: &[&HistoryRow],
    values: impl Fn(&HistoryRow) -> (f64, f64),
    paint: &str,
) {
    let usable = |r: &&HistoryRow| {
        let (low, high) = values(r);
        low.is_finite() && high.is_finite()
    };
    for piece in rows.chunk_by(|a, b| usable(a) == usable(b)).filter(|p| usable(&p[0])) {
        let edge = |r: &&HistoryRow, v: f64| frame.at(f64::from(r.generation), v);
        let lower = piece.iter().map(|r| edge(r, values(r).0));
        let upper = piece.iter().rev().map(|r| edge(r, values(r).1));
        let mut outline: Vec<[f64; 2]> = lower.chain(upper).collect();
        if let [[x, low], [_, high]] = outline[..] {
            outline = vec![[x - 7.0, low], [x + 7.0, low], [x + 7.0, high], [x - 7.0, high]];
        }
        canvas.polygon(&outline, paint);
    }
}
