//! Top view of the pivot's path under each gait, as in Figs. 4, 5 and 8 of paper 000.

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

/// Draws the path of the pivot from the start, with one line per gait. The ends are labelled 1, 2, 3, …; arrows show
/// the heading at the start and at each end. x and y, in mu from the start, have the same scale.
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
    // The sheet includes the start and at least 0.5 mu around it, so that small motions look small.
    let with_start = |r: Range| Range { low: r.low.min(-0.5), high: r.high.max(0.5) };
    let (x, y) = found
        .map_or((with_start(Range { low: 0.0, high: 1.0 }), with_start(Range { low: 0.0, high: 1.0 })), |(x, y)| {
            (with_start(x).padded(0.08), with_start(y).padded(0.08))
        });
    let (width, height) = (WIDTH - LEFT - 30.0, SIDE);
    // Equal scales: the axis with spare room gets a larger range.
    let scale = (width / x.span()).min(height / y.span());
    let grown = |r: Range, px: f64| r.padded((px / scale / r.span() - 1.0) / 2.0);
    // Paths along x get a lower frame, without empty space.
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

/// Formats distance and rotation between the ends, such as "5.31 mu, −12°".
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

/// Writes numbers beside the ends. Where ends are close, numbers are moved apart and get a line to their end.
fn label_ends(canvas: &mut Canvas, frame: &Frame, gaits: &[GaitTrace], ways: &[Vec<[f64; 2]>]) {
    let lines: Vec<Vec<[f64; 2]>> = ways.iter().map(|way| frame.line(way.iter().copied()).concat()).collect();
    let start = frame.at(0.0, 0.0);
    let mut labels = Labels { frame, start, traces: lines.concat(), taken: vec![(start, 17.0)] };
    for (i, line) in lines.iter().enumerate() {
        let Some(&end) = line.last() else { continue };
        canvas.circle(end, 4.5, &format!("{} {}", fill(series(i)), stroke("#ffffff", 1.2)));
        labels.taken.push((end, 17.0));
        let yaw = gaits[i].samples.last().map_or(f64::NAN, |s| s.yaw);
        if yaw.is_finite() {
            let (sin, cos) = yaw.sin_cos();
            let tip = [end[0] + 18.0 * cos, end[1] - 18.0 * sin];
            canvas.arrow(end, tip, 2.0, series(i));
            labels.taken.push((tip, 13.0));
        }
    }
    for (i, line) in lines.iter().enumerate() {
        let Some(&end) = line.last() else { continue };
        let place = labels.place(end);
        labels.taken.push((place, 20.0));
        if (place[0] - end[0]).hypot(place[1] - end[1]) > 38.0 {
            canvas.line(end, place, &stroke(FAINT, 0.8));
        }
        let style = Type { size: 15.0, ..Type::LABEL }.bold().coloured(series(i)).anchored(Anchor::Middle).halo();
        canvas.text([place[0], place[1] + 5.5], &(i + 1).to_string(), style);
    }
}

/// Occupied places on the sheet, for the placement of labels; all in px.
struct Labels<'a> {
    frame: &'a Frame,
    start: [f64; 2],
    /// Points of all traces: labels avoid them if they can.
    traces: Vec<[f64; 2]>,
    /// Points with the distance that labels must keep from them.
    taken: Vec<([f64; 2], f64)>,
}

impl Labels<'_> {
    /// Returns the nearest free place to `end`. Among places at the same distance, the one nearest to the direction
    /// from the start to `end` comes first. Places on traces are the second choice, places on other marks the last.
    fn place(&self, end: [f64; 2]) -> [f64; 2] {
        let ahead = (end[1] - self.start[1]).atan2(end[0] - self.start[0]);
        let turns = [0.0, 0.7, -0.7, 1.4, -1.4, 2.1, -2.1, 2.8];
        let places = [20.0, 27.0, 34.0, 46.0, 58.0, 70.0, 82.0].into_iter().flat_map(|distance| {
            turns.map(|turn| {
                let (sin, cos) = (ahead + turn).sin_cos();
                [end[0] + distance * cos, end[1] + distance * sin]
            })
        });
        let far = |a: &[f64; 2], b: &[f64; 2], room: f64| (a[0] - b[0]).hypot(a[1] - b[1]) >= room;
        let free = |p: &[f64; 2]| self.inside(p) && self.taken.iter().all(|(t, room)| far(t, p, *room));
        let clear = |p: &[f64; 2]| free(p) && self.traces.iter().all(|t| far(t, p, 10.0));
        let first = |fits: &dyn Fn(&[f64; 2]) -> bool| places.clone().find(fits);
        first(&clear).or_else(|| first(&free)).or_else(|| first(&|p| self.inside(p))).unwrap_or(end)
    }

    fn inside(&self, [x, y]: &[f64; 2]) -> bool {
        let (right, bottom) = (self.frame.left + self.frame.width, self.frame.top + self.frame.height);
        *x > self.frame.left + 10.0 && *x < right - 10.0 && *y > self.frame.top + 10.0 && *y < bottom - 10.0
    }
}
