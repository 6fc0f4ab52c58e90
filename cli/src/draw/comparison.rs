//! Comparison of several searches: the best score so far of each.

use super::axes::{Frame, Range, number};
use super::canvas::{Canvas, Type, fill, stroke};
use super::convergence::{scores_axis, steps};
use super::legend::{Key, heading, legend};
use super::palette::{dashes, series};
use super::{HistoryRow, Picture};

const WIDTH: f64 = 880.0;
const HEIGHT: f64 = 500.0;

/// Draws the best score so far over generations, with one line per run. `label` is the name and unit of the score, such
/// as "coverage, %".
pub fn comparison(runs: &[(String, Vec<HistoryRow>)], title: &str, label: &str) -> Picture {
    let mut canvas = Canvas::new();
    let paint = |i: usize| format!("{}{}", stroke(series(i), 2.25), dashes(i));
    let keys: Vec<Key> = runs.iter().enumerate().map(|(i, (name, _))| Key::line(name.clone(), paint(i))).collect();
    let top = heading(&mut canvas, title, "best score so far", WIDTH);
    let top = legend(&mut canvas, &keys, top, WIDTH) + 6.0;

    let best = |row: &HistoryRow| row.best_so_far.unwrap_or(f64::NAN);
    let all = || runs.iter().flat_map(|(_, rows)| rows);
    let found = Range::of(all().map(best));
    let x = Range::of(all().map(|row| f64::from(row.generation))).unwrap_or(Range { low: 0.0, high: 1.0 });
    let y = scores_axis(found);
    let frame = Frame { left: 84.0, top, width: WIDTH - 84.0 - 84.0, height: HEIGHT - top - 60.0, x, y };
    frame.draw(&mut canvas, Some((&x.whole_ticks(10), "generation")), Some((&y.ticks(7), label)));
    for (i, (_, rows)) in runs.iter().enumerate() {
        let lines = frame.line(steps(rows.iter().map(|row| [f64::from(row.generation), best(row)])));
        canvas.polylines(&lines, &paint(i));
        for alone in lines.iter().filter(|line| line.len() == 1) {
            canvas.circle(alone[0], 4.0, &fill(series(i)));
        }
        if let Some(last) = rows.last().filter(|row| best(row).is_finite()) {
            let [px, py] = frame.at(f64::from(last.generation), best(last));
            canvas.text([px + 8.0, py + 4.5], &number(best(last)), Type::LABEL.coloured(series(i)).halo());
        }
    }
    if found.is_none() {
        frame.say(&mut canvas, "no data: all evaluations failed");
    }
    Picture::new(canvas.finish(WIDTH, HEIGHT), WIDTH as u32, HEIGHT as u32)
}
