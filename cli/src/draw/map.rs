//! Map with the tree of a planner, as in Figs. 6 and 10 of paper 000.

use super::Picture;
use super::axes::{Frame, Range, number};
use super::canvas::{Canvas, fill, stroke};
use super::legend::{Key, MARGIN, heading, legend};
use super::palette::{ACCENT, BASE, FRAME, INK, OBSTACLE, TERRAIN, dashes, series};
use sim_core::model::environment::{Block, Environment};
use sim_core::report::{NodeRecord, TreeRecord};
use std::collections::BTreeSet;

const WIDTH: f64 = 920.0;
const LEFT: f64 = 76.0;
/// Largest size of the map, px.
const MOST: [f64; 2] = [WIDTH - LEFT - MARGIN, 640.0];
/// Least width and height of the frame, for maps that are very long and thin, px.
const LEAST: f64 = 140.0;

/// Draws obstacles, terrain, start, goal, nodes and the best path, and the tree's edges and the pivot's paths coloured
/// by gait. x and y have the same scale. `fitness_label` is the subtitle, such as "coverage 32.3 %".
pub fn map(environment: &Environment, tree: &TreeRecord, title: &str, fitness_label: &str) -> Picture {
    let mut canvas = Canvas::new();
    // An edge is drawn straight, and may cross an obstacle that the robot walked around.
    let note = match tree.nodes.len() {
        0 => "no data: the tree is empty",
        1 => "the tree has only the start: no gait added a node",
        _ => "edges and best path are drawn straight from node to node",
    };
    let said: Vec<&str> = [fitness_label, note].into_iter().filter(|s| !s.is_empty()).collect();
    let frame = ground(&mut canvas, environment, title, &said.join(" · "), &keys(environment, tree));
    edges(&mut canvas, &frame, tree);
    nodes(&mut canvas, &frame, tree);
    path(&mut canvas, &frame, tree);
    finish(canvas, environment, &frame)
}

/// Draws title, keys, axes, obstacles and terrain of a map. Shapes drawn later are clipped at the frame, until
/// [`finish`].
pub(super) fn ground(canvas: &mut Canvas, environment: &Environment, title: &str, said: &str, keys: &[Key]) -> Frame {
    let top = heading(canvas, title, said, WIDTH);
    let top = legend(canvas, keys, top, WIDTH) + 6.0;
    let frame = frame(environment, top);

    frame.draw(canvas, None, None);
    let (x, y) = (frame.x.ticks(12), frame.y.ticks(((frame.height / 55.0) as usize).max(3)));
    frame.draw(canvas, Some((&x, "x, mu")), Some((&y, "y, mu")));
    let [w, h] = environment.size;
    let corners = [[-w / 2.0, -h / 2.0], [w / 2.0, -h / 2.0], [w / 2.0, h / 2.0], [-w / 2.0, h / 2.0]];
    let outline: Vec<_> = corners.iter().map(|c| frame.at(c[0], c[1])).collect();
    canvas.polygon(&outline, &format!("fill=\"none\" {}", stroke(INK, 1.2)));

    let [x, y] = [frame.left, frame.top];
    canvas.raw(&format!(
        "<clipPath id=\"map\"><rect x=\"{x}\" y=\"{y}\" width=\"{}\" height=\"{}\"/></clipPath><g clip-path=\"url(#map)\">",
        frame.width, frame.height
    ));
    for block in &environment.terrain {
        canvas.polygon(&footprint(block, &frame), &terrain_paint(block.top / highest(environment)));
    }
    for block in &environment.obstacles {
        canvas.polygon(&footprint(block, &frame), &fill(OBSTACLE));
    }
    frame
}

/// Draws goal and start on top, and completes the picture.
pub(super) fn finish(mut canvas: Canvas, environment: &Environment, frame: &Frame) -> Picture {
    let height = (frame.top + frame.height + 56.0).ceil();
    canvas.raw("</g>");
    if let Some(goal) = &environment.goal {
        let at = frame.at(goal.x, goal.y);
        let radius = goal.radius / frame.x.span() * frame.width;
        canvas.circle(at, radius, &format!("fill=\"none\" stroke-dasharray=\"4 3\" {}", stroke(ACCENT, 1.5)));
        star(&mut canvas, at);
    }
    let start = &environment.start;
    start_mark(&mut canvas, frame.at(start.x, start.y), start.yaw);
    Picture::new(canvas.finish(WIDTH, height), WIDTH as u32, height as u32)
}

/// Returns the largest frame with equal scales that holds the map. It is larger than a map that is very long and thin.
fn frame(environment: &Environment, top: f64) -> Frame {
    let [w, h] = environment.size;
    let scale = (MOST[0] / w).min(MOST[1] / h);
    let width = (w * scale).max(LEAST);
    let height = (h * scale).max(LEAST);
    let around = |px: f64| Range { low: -px / scale / 2.0, high: px / scale / 2.0 };
    Frame { left: LEFT + (MOST[0] - width) / 2.0, top, width, height, x: around(width), y: around(height) }
}

/// Returns the first keys of the legend: start and goal.
pub(super) fn first_keys(environment: &Environment) -> Vec<Key> {
    let mut keys = vec![Key::new("start", |canvas, [x, y]| start_mark(canvas, [x - 6.0, y], 0.0))];
    if environment.goal.is_some() {
        keys.push(Key::new("goal", star));
    }
    keys
}

/// Returns the last keys of the legend: obstacles and terrain.
pub(super) fn last_keys(environment: &Environment) -> Vec<Key> {
    let mut keys = Vec::new();
    if !environment.obstacles.is_empty() {
        keys.push(Key::area("obstacle", fill(OBSTACLE)));
    }
    if !environment.terrain.is_empty() {
        let label =
            format!("terrain: may be touched (up to {} mu high; darker is higher)", number(highest(environment)));
        keys.push(Key::area(label, terrain_paint(0.6)));
    }
    keys
}

fn keys(environment: &Environment, tree: &TreeRecord) -> Vec<Key> {
    let mut keys = first_keys(environment);
    let gaits: BTreeSet<usize> = tree.nodes.iter().filter_map(|n| n.gait).collect();
    keys.extend(gaits.iter().map(|&g| Key::line(format!("gait {}", g + 1), edge_paint(g))));
    if tree.nodes.iter().any(|n| n.way.len() > 2) {
        keys.push(Key::line("path of the pivot", stroke(FRAME, 0.7)));
    }
    if !tree.nodes.is_empty() {
        keys.push(Key::new(format!("node ({} in total)", tree.nodes.len()), |canvas, at| {
            canvas.circle(at, 2.2, &fill(INK));
        }));
    }
    if tree.best_path.len() > 1 {
        keys.push(Key::line(format!("best path ({} gaits)", tree.best_path.len() - 1), stroke(INK, 3.2)));
    }
    keys.extend(last_keys(environment));
    keys
}

/// Returns the paint of terrain; `height` is a fraction of the highest terrain.
fn terrain_paint(height: f64) -> String {
    format!("{} fill-opacity=\"{:.2}\" {}", fill(TERRAIN), 0.15 + 0.85 * height, stroke(FRAME, 0.75))
}

/// Returns the height of the highest terrain, mu.
fn highest(environment: &Environment) -> f64 {
    environment.terrain.iter().map(|b| b.top).fold(f64::MIN_POSITIVE, f64::max)
}

fn footprint(block: &Block, frame: &Frame) -> Vec<[f64; 2]> {
    let (sin, cos) = block.yaw.sin_cos();
    [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]
        .map(|[u, v]| [u * block.size[0], v * block.size[1]])
        .map(|[u, v]| frame.at(block.center[0] + cos * u - sin * v, block.center[1] + sin * u + cos * v))
        .to_vec()
}

/// Returns the paint of an edge, which is straight between its nodes and shows the structure of the tree.
fn edge_paint(gait: usize) -> String {
    format!("stroke-opacity=\"0.9\" {}{}", stroke(series(gait), 1.6), dashes(gait))
}

/// Returns the paint of the pivot's path along an edge. Robots sway, so the paths fill the sheet: they are drawn
/// faintly.
fn way_paint(gait: usize) -> String {
    format!("stroke-opacity=\"0.35\" {}", stroke(series(gait), 0.7))
}

/// Returns the straight line from a node's parent to the node.
fn chord(tree: &TreeRecord, node: &NodeRecord) -> Option<[[f64; 2]; 2]> {
    let parent = tree.nodes.get(node.parent?)?;
    Some([[parent.x, parent.y], [node.x, node.y]])
}

fn edges(canvas: &mut Canvas, frame: &Frame, tree: &TreeRecord) {
    let gaits: BTreeSet<usize> = tree.nodes.iter().filter_map(|n| n.gait).collect();
    let of = |gait: usize| tree.nodes.iter().filter(move |n| n.gait == Some(gait));
    for &gait in &gaits {
        let ways: Vec<_> = of(gait).flat_map(|n| frame.line(n.way.iter().copied())).collect();
        canvas.polylines(&ways, &way_paint(gait));
    }
    for &gait in &gaits {
        let chords: Vec<_> = of(gait).filter_map(|n| chord(tree, n)).flat_map(|c| frame.line(c)).collect();
        canvas.polylines(&chords, &edge_paint(gait));
    }
}

fn nodes(canvas: &mut Canvas, frame: &Frame, tree: &TreeRecord) {
    // Dots are smaller in larger trees, so that they do not overlap too much.
    let radius = (40.0 / (tree.nodes.len() as f64).sqrt()).clamp(1.0, 2.4);
    for node in tree.nodes.iter().filter(|n| n.x.is_finite() && n.y.is_finite()) {
        canvas.circle(frame.at(node.x, node.y), radius, &format!("{} fill-opacity=\"0.75\"", fill(INK)));
    }
}

fn path(canvas: &mut Canvas, frame: &Frame, tree: &TreeRecord) {
    let on_path = |i: &usize| tree.nodes.get(*i);
    let points = tree.best_path.iter().filter_map(on_path).map(|n| [n.x, n.y]);
    let lines = frame.line(points);
    canvas.polylines(&lines, &stroke("#ffffff", 5.6));
    canvas.polylines(&lines, &stroke(INK, 3.2));
    for node in tree.best_path.iter().skip(1).filter_map(on_path).filter(|n| n.x.is_finite() && n.y.is_finite()) {
        canvas.circle(frame.at(node.x, node.y), 3.4, &format!("fill=\"#ffffff\" {}", stroke(INK, 1.6)));
    }
}

/// Draws a dot with an arrow in the direction of the heading.
pub(super) fn start_mark(canvas: &mut Canvas, at: [f64; 2], yaw: f64) {
    let (sin, cos) = yaw.sin_cos();
    canvas.circle(at, 7.0, &fill("#ffffff"));
    canvas.circle(at, 5.0, &fill(BASE));
    canvas.arrow(at, [at[0] + 22.0 * cos, at[1] - 22.0 * sin], 2.6, BASE);
}

fn star(canvas: &mut Canvas, [x, y]: [f64; 2]) {
    let point = |i: usize| {
        let (sin, cos) = (i as f64 * std::f64::consts::PI / 5.0).sin_cos();
        let radius = if i.is_multiple_of(2) { 9.0 } else { 3.8 };
        [x + radius * sin, y - radius * cos]
    };
    let outline: Vec<_> = (0..10).map(point).collect();
    canvas.polygon(&outline, &format!("{} {} paint-order=\"stroke\"", fill(ACCENT), stroke("#ffffff", 2.5)));
}
