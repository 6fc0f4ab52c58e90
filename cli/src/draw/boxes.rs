//! Box plots of the distance and rotation of each gait, as in Fig. 7 of paper 000.

use super::Picture;
use super::axes::{Frame, Range};
use super::canvas::{Anchor, Canvas, Type, fill, stroke};
use super::legend::{Key, heading, legend};
use super::palette::{BASE, FAINT, FRAME, INK};
use sim_core::report::TreeRecord;

const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 470.0;

/// Draws two panels of box plots over the edges of the tree, with one box per gait: planar distance between the ends of
/// the edge (mu), and rotation (degrees, left is positive). Gaits are ordered by their median distance, longest first,
/// and labelled by their number. `gaits` is k: a gait without edges gets an empty place.
pub fn gait_boxes(tree: &TreeRecord, gaits: usize, title: &str) -> Picture {
    let mut order: Vec<(usize, Vec<Motion>)> = (0..gaits).map(|gait| (gait, motions(tree, gait))).collect();
    let median = |m: &[Motion]| Summary::of(m.iter().map(|m| m.distance)).map_or(f64::NEG_INFINITY, |s| s.median);
    order.sort_by(|a, b| median(&b.1).total_cmp(&median(&a.1)));

    let edges: usize = order.iter().map(|(_, m)| m.len()).sum();
    let mut canvas = Canvas::new();
    let subtitle = format!("over the {edges} edges of the tree; gaits ordered by median distance");
    let top = heading(&mut canvas, title, &subtitle, WIDTH);
    let keys = [
        Key::new("median", |canvas, [x, y]| canvas.line([x - 11.0, y], [x + 11.0, y], &stroke(INK, 2.2))),
        Key::area("middle half (quartiles)", box_paint()),
        Key::new("farthest value within 1.5 box heights", |canvas, [x, y]| {
            canvas.line([x, y - 7.0], [x, y + 7.0], &stroke(INK, 1.2));
            canvas.line([x - 5.0, y - 7.0], [x + 5.0, y - 7.0], &stroke(INK, 1.2));
        }),
        Key::new("outlier", |canvas, at| canvas.circle(at, 2.6, &outlier_paint())),
    ];
    let top = legend(&mut canvas, &keys, top, WIDTH) + 6.0;
    panel(&mut canvas, 78.0, top, &order, "travelled distance, mu", true, |m| m.distance);
    panel(&mut canvas, 78.0 + WIDTH / 2.0, top, &order, "rotation, degrees (left is positive)", false, |m| m.rotation);
    Picture::new(canvas.finish(WIDTH, HEIGHT), WIDTH as u32, HEIGHT as u32)
}

/// Distance and rotation along an edge of the tree.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Motion {
    /// Planar distance between the ends, mu.
    distance: f64,
    /// Change of heading, degrees, in ±180.
    rotation: f64,
}

fn motions(tree: &TreeRecord, gait: usize) -> Vec<Motion> {
    let motion = |node: &sim_core::report::NodeRecord| {
        let parent = node.parent.and_then(|p| tree.nodes.get(p))?;
        let distance = (node.x - parent.x).hypot(node.y - parent.y);
        let rotation = super::turn(parent.yaw, node.yaw).to_degrees();
        (distance.is_finite() && rotation.is_finite()).then_some(Motion { distance, rotation })
    };
    tree.nodes.iter().filter(|n| n.gait == Some(gait)).filter_map(motion).collect()
}

/// Numbers of a box plot: quartiles by linear interpolation, whiskers to the farthest value within 1.5 box heights.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Summary {
    pub lower_whisker: f64,
    pub lower_quartile: f64,
    pub median: f64,
    pub upper_quartile: f64,
    pub upper_whisker: f64,
    pub outliers: Vec<f64>,
}

impl Summary {
    /// Computes the numbers of finite values; `None` without values.
    pub fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = values.collect();
        sorted.sort_by(f64::total_cmp);
        let last = sorted.len().checked_sub(1)?;
        let quantile = |q: f64| {
            let place = q * last as f64;
            let (below, share) = (place as usize, place.fract());
            sorted[below] + share * (sorted[(below + 1).min(last)] - sorted[below])
        };
        let (lower_quartile, median, upper_quartile) = (quantile(0.25), quantile(0.5), quantile(0.75));
        let reach = 1.5 * (upper_quartile - lower_quartile);
        let within = |v: &&f64| **v >= lower_quartile - reach && **v <= upper_quartile + reach;
        Some(Self {
            lower_whisker: sorted.iter().find(within).map_or(lower_quartile, |v| v.min(lower_quartile)),
            lower_quartile,
            median,
            upper_quartile,
            upper_whisker: sorted.iter().rev().find(within).map_or(upper_quartile, |v| v.max(upper_quartile)),
            outliers: sorted.iter().filter(|v| !within(v)).copied().collect(),
        })
    }
}

fn box_paint() -> String {
    format!("{} fill-opacity=\"0.30\" {}", fill(BASE), stroke(BASE, 1.3))
}

fn outlier_paint() -> String {
    format!("fill=\"none\" {}", stroke(FAINT, 1.1))
}

fn panel(
    canvas: &mut Canvas,
    left: f64,
    top: f64,
    gaits: &[(usize, Vec<Motion>)],
    label: &str,
    from_zero: bool,
    value: impl Fn(&Motion) -> f64,
) {
    let found = Range::of(gaits.iter().flat_map(|(_, m)| m.iter().map(&value)));
    let y = found.map_or(Range { low: 0.0, high: 1.0 }, |r| {
        if from_zero { Range { low: 0.0, high: r.high + 0.06 * r.high.max(1e-9) } } else { r.padded(0.06) }
    });
    let x = Range { low: -0.5, high: gaits.len().max(1) as f64 - 0.5 };
    let frame = Frame { left, top, width: WIDTH / 2.0 - 78.0 - 24.0, height: HEIGHT - top - 68.0, x, y };
    frame.draw(canvas, None, Some((&y.ticks(7), label)));
    if !from_zero && y.low < 0.0 && y.high > 0.0 {
        canvas.line(frame.at(x.low, 0.0), frame.at(x.high, 0.0), &stroke(FRAME, 1.2));
    }

    let bottom = frame.top + frame.height;
    let slot = frame.width / x.span();
    let half = (0.28 * slot).min(28.0);
    // Below narrow slots there is room for the gait numbers only.
    let roomy = slot >= 52.0;
    for (place, (gait, motions)) in gaits.iter().enumerate() {
        let middle = frame.at(place as f64, y.low)[0];
        let number = Type { size: if slot < 16.0 { 9.0 } else { 12.0 }, ..Type::TICK }.anchored(Anchor::Middle);
        canvas.text([middle, bottom + 17.0], &(gait + 1).to_string(), number.bold());
        if roomy {
            let count = match motions.len() {
                1 => "1 edge".to_owned(),
                n => format!("{n} edges"),
            };
            canvas.text([middle, bottom + 33.0], &count, Type { size: 11.0, ..number }.coloured(FAINT));
        }
        if let Some(summary) = Summary::of(motions.iter().map(&value)) {
            draw_box(canvas, &frame, place as f64, half, &summary);
        }
    }
    let title = [frame.left + frame.width / 2.0, bottom + if roomy { 52.0 } else { 40.0 }];
    canvas.text(title, "gait", Type::LABEL.anchored(Anchor::Middle));
    if found.is_none() {
        frame.say(canvas, "no data: the tree has no edges");
    }
}

fn draw_box(canvas: &mut Canvas, frame: &Frame, place: f64, half: f64, summary: &Summary) {
    let at = |v: f64| frame.at(place, v);
    let thin = stroke(INK, 1.2);
    for (from, to) in [(summary.lower_quartile, summary.lower_whisker), (summary.upper_quartile, summary.upper_whisker)]
    {
        let ([x, y0], [_, y1]) = (at(from), at(to));
        canvas.line([x, y0], [x, y1], &thin);
        canvas.line([x - half / 2.0, y1], [x + half / 2.0, y1], &thin);
    }
    let ([x, upper], [_, lower]) = (at(summary.upper_quartile), at(summary.lower_quartile));
    canvas.rect(x - half, upper, 2.0 * half, lower - upper, &box_paint());
    let [_, median] = at(summary.median);
    canvas.line([x - half, median], [x + half, median], &stroke(INK, 2.2));
    for &v in &summary.outliers {
        canvas.circle(at(v), 2.6, &outlier_paint());
    }
}
