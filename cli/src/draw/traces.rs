//! How each gait moves the robot's pivot, from above, as in Figs. 4, 5 and 8 of the paper.

use super::Picture;
use super::axes::{Frame, Range, number};
use super::canvas::{Anchor, Canvas, Type, fill, stroke};
use super::legend::{Key, heading, legend};
use super::map::start_mark;
use super::palette::{FAINT, dashes, series};
use sim_core::report::GaitTrace;

const WIDTH: f64 = 760.0;
const SIDE: f64 = 580.0;
const LEFT: f64 = 84.0;

/// The pivot's way from the start, one line a gait, ends labelled 1, 2, 3, … and an arrow for the heading at the start and
/// at each end. x and y, in mu from the start, have the same scale.
pub fn gait_traces(gaits: &[GaitTrace], title: &str) -> Picture {
    let mut canvas = Canvas::new();
    let top = heading(&mut canvas, title, "top view; the arrows show the heading at the start and at the ends", WIDTH);
    let keys: Vec<Key> = gaits
        .iter()
        .enumerate()
        .map(|(i, gait)| Key::line(format!("{}: {}", i + 1, summary(gait)), trace_paint(i)))
        .collect();
    let top = legend(&mut canvas, &keys, top, WIDTH) + 6.0;

    let ways: Vec<Vec<[f64; 2]>> = gaits.iter().map(from_start).collect();
    let every = || ways.iter().flatten();
    let found = Range::of(every().map(|p| p[0])).zip(Range::of(every().map(|p| p[1])));
    // The start belongs on the sheet, and a robot that hardly moves must not look as if it did.
    let with_start = |r: Range| Range { low: r.low.min(-0.5), high: r.high.max(0.5) };
    let (x, y) = found
        .map_or((with_start(Range { low: 0.0, high: 1.0 }), with_start(Range { low: 0.0, high: 1.0 })), |(x, y)| {
            (with_start(x).padded(0.08), with_start(y).padded(0.08))
        });
    let (width, height) = (WIDTH - LEFT - 30.0, SIDE);
    // Equal scales: the axis with room to spare shows more.
    let scale = (width / x.span()).min(height / y.span());
    let grown = |r: Range, px: f64| r.padded((px / scale / r.span() - 1.0) / 2.0);
    // A way that is long but narrow gets a frame to match, not a square with nothing in it.
    let height = (y.span() * scale).clamp(220.0, height);
    let frame = Frame { left: LEFT, top, width, height, x: grown(x, width), y: grown(y, height) };
    frame.draw(
        &mut canvas,
        Some((&frame.x.ticks(9), "x from the start, mu")),
        Some((&frame.y.ticks(((height / 60.0) as usize).max(3)), "y from the start, mu")),
    );

    for (i, way) in ways.iter().enumerate() {
        canvas.polylines(&frame.line(way.iter().copied()), &trace_paint(i));
    }
    let yaw = gaits.iter().find_map(|g| g.samples.first()).map(|s| s.yaw).filter(|yaw| yaw.is_finite());
    if found.is_some() {
        start_mark(&mut canvas, frame.at(0.0, 0.0), yaw.unwrap_or(0.0));
    } else {
        frame.say(&mut canvas, "no data: no gait was traced");
    }
    label_ends(&mut canvas, &frame, gaits, &ways);
    let height = (top + height + 56.0).ceil();
    Picture::new(canvas.finish(WIDTH, height), WIDTH as u32, height as u32)
}

fn trace_paint(i: usize) -> String {
    format!("{}{}", stroke(series(i), 1.7), dashes(i))
}

fn from_start(gait: &GaitTrace) -> Vec<[f64; 2]> {
    let Some(start) = gait.samples.first() else { return Vec::new() };
    gait.samples.iter().map(|s| [s.position[0] - start.position[0], s.position[1] - start.position[1]]).collect()
}

/// Distance and rotation between the ends, such as "5.31 mu, −12°".
fn summary(gait: &GaitTrace) -> String {
    let (Some(first), Some(last)) = (gait.samples.first(), gait.samples.last()) else { return "no data".into() };
    let distance = (last.position[0] - first.position[0]).hypot(last.position[1] - first.position[1]);
    let rotation = super::turn(first.yaw, last.yaw).to_degrees();
    if !distance.is_finite() || !rotation.is_finite() {
        return "no data".into();
    }
    let unstable = if gait.unstable.is_some() { " (unstable)" } else { "" };
    let sign = if rotation.round() > 0.0 { "+" } else { "" };
    format!("{} mu, {sign}{}°{unstable}", number(distance), format!("{:.0}", rotation.round() + 0.0).replace('-', "−"))
}

/// Numbers beside the ends, moved apart where ends are close, with a line to what they name.
fn label_ends(canvas: &mut Canvas, frame: &Frame, gaits: &[GaitTrace], ways: &[Vec<[f64; 2]>]) {
    let ends: Vec<(usize, [f64; 2])> = ways
        .iter()
        .enumerate()
        .filter_map(|(i, way)| frame.line(way.iter().copied()).last().and_then(|l| l.last().copied()).map(|p| (i, p)))
        .collect();
    let start = frame.at(0.0, 0.0);
    // What labels keep away from, and how far, px.
    let mut taken: Vec<([f64; 2], f64)> = vec![(start, 17.0)];
    taken.extend(ends.iter().map(|e| (e.1, 17.0)));
    for &(i, end) in &ends {
        canvas.circle(end, 4.5, &format!("{} {}", fill(series(i)), stroke("#ffffff", 1.2)));
        let yaw = gaits[i].samples.last().map_or(f64::NAN, |s| s.yaw);
        if yaw.is_finite() {
            let (sin, cos) = yaw.sin_cos();
            let tip = [end[0] + 18.0 * cos, end[1] - 18.0 * sin];
            canvas.arrow(end, tip, 2.0, series(i));
            taken.push((tip, 13.0));
        }
    }
    for &(i, end) in &ends {
        let place = free_place(end, start, &taken, frame);
        taken.push((place, 20.0));
        if (place[0] - end[0]).hypot(place[1] - end[1]) > 38.0 {
            canvas.line(end, place, &stroke(FAINT, 0.8));
        }
        let style = Type { size: 15.0, ..Type::LABEL }.bold().coloured(series(i)).anchored(Anchor::Middle).halo();
        canvas.text([place[0], place[1] + 5.5], &(i + 1).to_string(), style);
    }
}

/// A place for a label near `end`: ahead of it as seen from the start if that is free, else the nearest that is.
fn free_place(end: [f64; 2], start: [f64; 2], taken: &[([f64; 2], f64)], frame: &Frame) -> [f64; 2] {
    let ahead = (end[1] - start[1]).atan2(end[0] - start[0]);
    let turns = [0.0, 0.7, -0.7, 1.4, -1.4, 2.1, -2.1, 2.8];
    let inside = |[x, y]: [f64; 2]| {
        x > frame.left + 10.0
            && x < frame.left + frame.width - 10.0
            && y > frame.top + 10.0
            && y < frame.top + frame.height - 10.0
    };
    let places = [20.0, 27.0, 34.0, 46.0, 58.0, 70.0, 82.0].into_iter().flat_map(|distance| {
        turns.map(|turn| {
            let (sin, cos) = (ahead + turn).sin_cos();
            [end[0] + distance * cos, end[1] + distance * sin]
        })
    });
    let free = |p: &[f64; 2]| inside(*p) && taken.iter().all(|(t, room)| (t[0] - p[0]).hypot(t[1] - p[1]) >= *room);
    places.clone().find(free).or_else(|| places.clone().find(|p| inside(*p))).unwrap_or(end)
}
