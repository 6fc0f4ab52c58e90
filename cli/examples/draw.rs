//! Draws the pictures from artificial data, for inspection by eye: `cargo run -p cli --example draw -- FOLDER`.

// This example uses only a part of the module.
#[allow(dead_code, unused_imports)]
#[path = "../src/draw/mod.rs"]
mod draw;

use draw::{DrawnBox, HistoryRow, Picture};
use sim_core::base::random::{Purpose, Stream};
use sim_core::model::environment::{Block, Environment, Goal, Start};
use sim_core::report::{GaitTrace, NodeRecord, TraceSample, TreeRecord};
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("no folder given: run `draw FOLDER`")?;
    std::fs::create_dir_all(&folder)?;
    for (name, picture) in pictures() {
        save(Path::new(&folder), name, &picture)?;
    }
    Ok(())
}

fn save(folder: &Path, name: &str, picture: &Picture) -> Result<(), Box<dyn std::error::Error>> {
    std::fs::write(folder.join(format!("{name}.svg")), picture.svg())?;
    std::fs::write(folder.join(format!("{name}.png")), picture.png()?)?;
    Ok(())
}

fn pictures() -> Vec<(&'static str, Picture)> {
    let three = gaits(3);
    let column = environment(true);
    let tree = tree(&column, &moves(&three), 150);
    let many = gaits(14);
    vec![
        (
            "convergence",
            draw::convergence(&history(150), &audits(&history(150)), "quadropod-empty: convergence", "coverage, %"),
        ),
        ("convergence-one", draw::convergence(&history(1), &[], "One generation", "coverage, %")),
        ("convergence-none", draw::convergence(&[], &[], "No generation", "coverage, %")),
        (
            "convergence-equal",
            draw::convergence(&[flat(0, 5.0), flat(1, 5.0), flat(2, 5.0)], &[[0.0, 5.0]], "All equal", "distance, mu"),
        ),
        (
            "convergence-gaps",
            draw::convergence(&gappy(), &[], "With generations that failed", "distance to the goal, mu"),
        ),
        ("map", draw::map(&column, &tree, "quadropod-column: the winner's tree", "coverage 23.4 %")),
        ("map-none", draw::map(&environment(false), &TreeRecord::default(), "An empty tree", "coverage 0 %")),
        ("map-stairs", draw::map(&stairs(), &TreeRecord::default(), "Stairs", "")),
        ("map-thin", draw::map(&thin(), &TreeRecord::default(), "A corridor", "")),
        ("gaits", draw::gait_traces(&three, "quadropod-empty: gaits")),
        ("gaits-many", draw::gait_traces(&many, "Fourteen gaits")),
        ("gaits-none", draw::gait_traces(&[], "No gaits")),
        ("boxes", draw::gait_boxes(&tree, 4, "quadropod-column: distance and rotation of the gaits")),
        ("boxes-none", draw::gait_boxes(&TreeRecord::default(), 3, "No edges")),
        ("boxes-many", draw::gait_boxes(&self::tree(&column, &moves(&many), 40), 14, "Fourteen gaits")),
        ("robot", draw::robot(&quadropod(), "quadropod, E2: two failed modules", "10 modules")),
        ("robot-turned", draw::robot(&turned(), "Boxes at odd angles", "8 modules")),
        ("robot-none", draw::robot(&[], "No robot", "0 modules")),
    ]
}

/// Returns audits of the global bests; their scores without reuse are 5 % lower.
fn audits(history: &[HistoryRow]) -> Vec<[f64; 2]> {
    let rows = history.iter().filter_map(|r| Some((f64::from(r.generation), r.best_so_far?)));
    let mut best = f64::NEG_INFINITY;
    let mut marks = Vec::new();
    for (generation, score) in rows {
        if score > best {
            best = score;
            marks.push([generation, 0.95 * score]);
        }
    }
    marks
}

fn history(generations: u32) -> Vec<HistoryRow> {
    let mut random = Stream::new(1, Purpose::Sample, 0, 0, 0);
    let mut best: f64 = 0.0;
    (0..generations)
        .map(|generation| {
            let middle = 6.0 + 18.0 * (1.0 - (-f64::from(generation) / 40.0).exp()) + random.normal();
            let max = middle + 5.0 + 2.0 * random.normal().abs();
            best = best.max(max);
            HistoryRow {
                generation,
                min: (middle - 8.0 - random.normal().abs()).max(0.0),
                lower_quartile: middle - 2.5 - random.unit(),
                median: middle,
                upper_quartile: middle + 2.0 + random.unit(),
                max,
                best_so_far: Some(best),
            }
        })
        .collect()
}

fn flat(generation: u32, v: f64) -> HistoryRow {
    HistoryRow { generation, min: v, lower_quartile: v, median: v, upper_quartile: v, max: v, best_so_far: Some(v) }
}

fn gappy() -> Vec<HistoryRow> {
    let mut rows = history(30);
    for i in [0, 1, 2, 9, 11, 20, 21] {
        rows[i] = HistoryRow { best_so_far: rows[i].best_so_far.filter(|_| i > 2), ..flat(i as u32, f64::NAN) };
    }
    rows
}

fn environment(column: bool) -> Environment {
    let block = Block { center: [0.0, 0.0], size: [4.0, 4.0], base: 0.0, top: 4.0, yaw: 0.0 };
    Environment {
        name: "column".into(),
        description: String::new(),
        size: [48.0, 27.0],
        start: Start { x: -12.0, y: 0.0, yaw: 0.0 },
        goal: column.then_some(Goal::at(15.0, 3.0, 1.0)),
        obstacles: if column { vec![block] } else { Vec::new() },
        terrain: Vec::new(),
    }
}

fn stairs() -> Environment {
    let stair = |i: usize| Block {
        center: [-3.0 + 3.0 * i as f64 + 1.5, 0.0],
        size: [3.0, 20.0],
        base: 0.0,
        top: 0.6 * (i + 1) as f64,
        yaw: 0.0,
    };
    let turned = Block { center: [-8.0, 7.0], size: [4.0, 1.0], base: 0.0, top: 1.0, yaw: 0.5 };
    Environment {
        size: [30.0, 20.0],
        goal: Some(Goal::at(13.0, 0.0, 1.5)),
        terrain: (0..5).map(stair).collect(),
        obstacles: vec![turned],
        ..environment(false)
    }
}

fn thin() -> Environment {
    Environment { size: [300.0, 4.0], start: Start { x: -140.0, y: 0.0, yaw: 0.3 }, ..environment(false) }
}

fn gaits(count: usize) -> Vec<GaitTrace> {
    (0..count)
        .map(|g| {
            let mut random = Stream::new(7, Purpose::Sample, 0, g as u32, 0);
            let speed = if g == 2 { 0.01 } else { random.uniform(0.02, 0.2) };
            let turn = random.uniform(-0.06, 0.06);
            let (mut x, mut y, mut yaw) = (-12.0, 0.0, 0.0f64);
            let samples = (0..=300)
                .map(|i| {
                    let time = f64::from(i) * 0.1;
                    let sway = 0.12 * (4.0 * time).sin();
                    let sample = TraceSample {
                        time,
                        targets: Vec::new(),
                        angles: Vec::new(),
                        position: [x - sway * yaw.sin(), y + sway * yaw.cos(), 0.5],
                        rotation: [0.0, 0.0, (yaw / 2.0).sin(), (yaw / 2.0).cos()],
                        yaw,
                    };
                    x += 0.1 * speed * yaw.cos();
                    y += 0.1 * speed * yaw.sin();
                    yaw += 0.1 * turn;
                    sample
                })
                .collect();
            let unstable = (g == 5).then(|| "speed above 50 mu/s at 3.2 s".to_owned());
            GaitTrace { parameters: Vec::new(), joints: Vec::new(), samples, unstable }
        })
        .collect()
}

/// Returns the relative paths of the gaits, with one point per second.
fn moves(gaits: &[GaitTrace]) -> Vec<Vec<[f64; 3]>> {
    let relative = |s: &TraceSample| [s.position[0] + 12.0, s.position[1], s.yaw];
    gaits.iter().map(|g| g.samples.iter().step_by(10).map(relative).collect()).collect()
}

fn tree(environment: &Environment, moves: &[Vec<[f64; 3]>], iterations: u32) -> TreeRecord {
    let mut random = Stream::new(3, Purpose::Sample, 1, 0, 0);
    let root = NodeRecord { x: -12.0, y: 0.0, z: 0.5, yaw: 0.0, parent: None, gait: None, way: Vec::new() };
    let mut nodes = vec![root];
    for _ in 0..iterations {
        let (x, y) = (random.uniform(-24.0, 24.0), random.uniform(-13.5, 13.5));
        let far = |n: &NodeRecord, x: f64, y: f64| (n.x - x).hypot(n.y - y);
        let near = (0..nodes.len()).min_by(|&a, &b| far(&nodes[a], x, y).total_cmp(&far(&nodes[b], x, y))).unwrap_or(0);
        for (gait, steps) in moves.iter().enumerate() {
            let from = nodes[near].clone();
            let (sin, cos) = from.yaw.sin_cos();
            let jitter = 1.0 + 0.05 * random.normal();
            let place = |s: &[f64; 3]| {
                [from.x + jitter * (cos * s[0] - sin * s[1]), from.y + jitter * (sin * s[0] + cos * s[1])]
            };
            let way: Vec<[f64; 2]> = steps.iter().map(place).collect();
            let (Some(&[x, y]), Some(end)) = (way.last(), steps.last()) else { continue };
            let clear = |p: &[f64; 2]| {
                environment.contains(p[0], p[1]) && !environment.obstacles.iter().any(|o| o.covers(p[0], p[1], 0.5))
            };
            let own = far(&from, x, y);
            if way.iter().all(clear) && nodes.iter().enumerate().all(|(i, n)| i == near || far(n, x, y) > own) {
                let yaw = from.yaw + end[2] + 0.05 * random.normal();
                nodes.push(NodeRecord { x, y, z: 0.5, yaw, parent: Some(near), gait: Some(gait), way });
            }
        }
    }
    let farthest = (0..nodes.len()).max_by(|&a, &b| nodes[a].x.total_cmp(&nodes[b].x)).unwrap_or(0);
    let mut best_path = vec![farthest];
    while let Some(parent) = nodes[best_path[best_path.len() - 1]].parent {
        best_path.push(parent);
    }
    best_path.reverse();
    TreeRecord { nodes, best_path }
}

fn quadropod() -> Vec<DrawnBox> {
    let mut boxes = Vec::new();
    let mut module = |name: &str, x: f64, y: f64, along_x: bool, failed: bool| {
        for side in [-0.25, 0.25] {
            let center = if along_x { [x + side, y, 0.5] } else { [x, y + side, 0.5] };
            let half = if along_x { [0.24, 0.45, 0.45] } else { [0.45, 0.24, 0.45] };
            let rotation = [0.0, 0.0, 0.0, 1.0];
            boxes.push(DrawnBox { center, rotation, half, outline: None, module: name.into(), failed });
        }
    };
    module("body-1", -0.5, 0.0, true, false);
    module("body-2", 0.5, 0.0, true, false);
    for (leg, x, y) in [("fl", 1.5, 1.0), ("fr", 1.5, -1.0), ("rl", -1.5, 1.0), ("rr", -1.5, -1.0)] {
        module(&format!("{leg}-hip"), x, y * 0.6, false, leg == "fr");
        module(&format!("{leg}-knee"), x, y * 1.7, false, leg == "rl");
    }
    boxes
}

fn turned() -> Vec<DrawnBox> {
    let mut random = Stream::new(9, Purpose::Sample, 2, 0, 0);
    (0..8)
        .map(|i| {
            let angle: f64 = random.uniform(-1.0, 1.0);
            let rotation = match i % 3 {
                0 => [0.0, 0.0, (angle / 2.0).sin(), (angle / 2.0).cos()],
                1 => [(angle / 2.0).sin(), 0.0, 0.0, (angle / 2.0).cos()],
                _ => [0.0, (angle / 2.0).sin(), 0.0, (angle / 2.0).cos()],
            };
            DrawnBox {
                center: [f64::from(i / 2) * 2.0, f64::from(i % 2) * 2.2, 0.3 * f64::from(i)],
                rotation,
                half: [0.9, 0.5, 0.4],
                outline: None,
                module: format!("m{i}"),
                failed: false,
            }
        })
        .collect()
}
