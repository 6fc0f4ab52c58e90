//! Map with the paths of all runs of one motion.

use super::Picture;
use super::canvas::{Canvas, fill, stroke};
use super::legend::Key;
use super::map::{finish, first_keys, ground, last_keys};
use super::palette::{ACCENT, BASE, INK};
use sim_core::model::environment::Environment;

/// Path of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnPath {
    /// Path of the pivot, (x, y), mu.
    pub points: Vec<[f64; 2]>,
    /// True if the run succeeded.
    pub good: bool,
}

/// Draws the paths of the repeats, coloured by success, and on top the path with nothing varied and the planned ends of
/// the plan's steps. x and y have the same scale. `said` is the subtitle.
pub fn paths(
    environment: &Environment,
    planned: &[[f64; 2]],
    unvaried: &DrawnPath,
    repeats: &[DrawnPath],
    title: &str,
    said: &str,
) -> Picture {
    let mut canvas = Canvas::new();
    let (good, bad): (Vec<&DrawnPath>, Vec<&DrawnPath>) = repeats.iter().partition(|path| path.good);
    let mut keys = first_keys(environment);
    if !planned.is_empty() {
        keys.push(Key::new("planned end of a step", planned_mark));
    }
    keys.push(Key::line("nothing varied", stroke(INK, 2.4)));
    for (label, paths, colour) in [("success", &good, BASE), ("no success", &bad, ACCENT)] {
        if !paths.is_empty() {
            keys.push(Key::line(format!("repeat: {label} ({})", paths.len()), repeat_paint(colour)));
            keys.push(Key::new("its end", move |canvas, at| canvas.circle(at, 3.0, &fill(colour))));
        }
    }
    keys.extend(last_keys(environment));
    let frame = ground(&mut canvas, environment, title, said, &keys);
    for (paths, colour) in [(&good, BASE), (&bad, ACCENT)] {
        let lines: Vec<_> = paths.iter().flat_map(|path| frame.line(path.points.iter().copied())).collect();
        canvas.polylines(&lines, &repeat_paint(colour));
        for end in paths.iter().filter_map(|path| path.points.last()) {
            canvas.circle(frame.at(end[0], end[1]), 3.0, &format!("{} fill-opacity=\"0.8\"", fill(colour)));
        }
    }
    let line = frame.line(unvaried.points.iter().copied());
    canvas.polylines(&line, &stroke("#ffffff", 4.4));
    canvas.polylines(&line, &stroke(INK, 2.4));
    for [x, y] in planned {
        planned_mark(&mut canvas, frame.at(*x, *y));
    }
    finish(canvas, environment, &frame)
}

fn repeat_paint(colour: &str) -> String {
    format!("stroke-opacity=\"0.55\" {}", stroke(colour, 1.1))
}

fn planned_mark(canvas: &mut Canvas, at: [f64; 2]) {
    canvas.circle(at, 3.4, &format!("fill=\"#ffffff\" {}", stroke(INK, 1.6)));
}
