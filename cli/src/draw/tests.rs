//! Tests of the pictures. `cargo run -p cli --example draw -- FOLDER` draws all of them for inspection by eye.

use super::axes::{Frame, Range, number};
use super::boxes::Summary;
use super::canvas::Type;
use super::picture::{fitted, width};
use super::*;
use resvg::{tiny_skia, usvg};
use sim_core::model::environment::{Block, Environment, Goal, Start};
use sim_core::report::{GaitTrace, NodeRecord, TraceSample, TreeRecord};

fn row(generation: u32, v: f64) -> HistoryRow {
    HistoryRow {
        generation,
        min: v - 1.0,
        lower_quartile: v - 0.5,
        median: v,
        upper_quartile: v + 0.5,
        max: v + 1.0,
        best_so_far: Some(v + 1.0),
    }
}

fn environment() -> Environment {
    Environment {
        name: "test".into(),
        description: String::new(),
        size: [48.0, 27.0],
        start: Start { x: -12.0, y: 0.0, yaw: 0.0 },
        goal: Some(Goal::at(3.0, 0.0, 1.0)),
        obstacles: vec![Block { center: [0.0, 0.0], size: [4.0, 4.0], base: 0.0, top: 4.0, yaw: 0.3 }],
        terrain: vec![Block { center: [9.0, 0.0], size: [4.0, 4.0], base: 0.0, top: 0.6, yaw: 0.0 }],
    }
}

fn node(x: f64, y: f64, parent: Option<usize>, gait: Option<usize>) -> NodeRecord {
    NodeRecord { x, y, z: 0.5, yaw: 0.1 * x, parent, gait, way: Vec::new() }
}

fn trace(end: f64) -> GaitTrace {
    let sample = |time: f64, x: f64| TraceSample {
        time,
        targets: Vec::new(),
        angles: Vec::new(),
        position: [x, 0.5 * x, 0.5],
        rotation: [0.0, 0.0, 0.0, 1.0],
        yaw: x,
    };
    let samples = vec![sample(0.0, 0.0), sample(1.0, end)];
    GaitTrace { parameters: Vec::new(), joints: Vec::new(), samples, unstable: None }
}

fn cube(x: f64, y: f64, z: f64, module: &str) -> DrawnBox {
    let (rotation, half) = ([0.0, 0.0, 0.0, 1.0], [0.5; 3]);
    DrawnBox { center: [x, y, z], rotation, half, outline: None, module: module.into(), failed: module == "bad" }
}

fn frontier_set(speeds: &[f64]) -> FrontierSet {
    let around = |v: f64| Some([v - 0.01, v, v + 0.02]);
    let point = |&speed: &f64| FrontierPoint {
        name: format!("{speed}"),
        speed,
        correlation: around(1.0 - speed / 1e4),
        error: around(speed / 1e4),
    };
    let points = speeds.iter().map(point).collect();
    let (name, reference_speed) = ("gaits".to_owned(), 40.0);
    FrontierSet { name, points, reference_speed, ceiling_correlation: 0.999, ceiling_error: 1e-4 }
}

/// Draws every picture from valid data, no data, one point, equal points, and NaN, infinite and huge numbers.
fn all() -> Vec<Picture> {
    let odd = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300, 1e-300, -0.0];
    let odd_marks: Vec<[f64; 2]> = odd.iter().map(|v| [0.0, *v]).collect();
    let odd_rows: Vec<HistoryRow> = odd.iter().enumerate().map(|(i, v)| row(i as u32, *v)).collect();
    let sound = TreeRecord {
        nodes: vec![
            node(-12.0, 0.0, None, None),
            node(-9.0, 1.0, Some(0), Some(0)),
            node(-10.0, 3.0, Some(0), Some(1)),
        ],
        best_path: vec![0, 1],
    };
    let broken = TreeRecord {
        nodes: odd
            .iter()
            .map(|v| node(*v, 0.0, Some(99), Some(40)))
            .chain([node(f64::NAN, 1.0, Some(0), Some(0))])
            .collect(),
        best_path: vec![7, 8, 9],
    };
    let mut trees = vec![TreeRecord::default(), sound.clone(), broken];
    trees.push(TreeRecord { nodes: sound.nodes[..1].to_vec(), best_path: vec![0] });
    let mut pictures = vec![
        convergence(&[], &[], "none", "coverage, %"),
        convergence(&[row(0, 3.0)], &[[0.0, 2.5]], "one", "coverage, %"),
        convergence(&[row(0, 3.0), row(1, 3.0)], &[[0.0, 3.0]], "equal", "coverage, %"),
        convergence(&odd_rows, &odd_marks, "odd <&> \u{1} \"title\"", "what?"),
        comparison(&[], "none", "coverage, %"),
        comparison(&[("a".into(), vec![row(0, 3.0)]), ("b".into(), Vec::new())], "one", "coverage, %"),
        comparison(&[("odd".into(), odd_rows.clone()), ("sound".into(), vec![row(0, 1.0), row(1, 4.0)])], "odd", "?"),
        gait_traces(&[], "none"),
        gait_traces(&[trace(0.0)], "at rest"),
        gait_traces(&odd.map(trace), "odd"),
        gait_traces(&[trace(3.0), trace(3.0), trace(-1.0)], "sound"),
        robot(&[], "none", ""),
        robot(
            &[cube(0.0, 0.0, 0.5, "a"), cube(1.0, 0.0, 0.5, "bad"), cube(0.0, 0.0, 0.5, "same place")],
            "sound",
            "3 modules",
        ),
        robot(&odd.map(|v| cube(v, 0.0, 0.0, "odd")), "odd", "odd"),
    ];
    let odd_pairs = |by: f64| odd.iter().map(|v| [*v, v + by]).collect::<Vec<_>>();
    let scattered = |points: &[[f64; 2]]| [ScatterSet { name: "genomes".into(), points: points.to_vec() }];
    pictures.extend([
        scatter(&[], "none", "", "x", "y"),
        scatter(&scattered(&[[1.0, 1.0]]), "one", "", "x", "y"),
        scatter(&scattered(&[[1.0, 2.0], [3.0, 2.5], [0.0, 0.0]]), "sound", "two lines", "x", "y"),
        scatter(&scattered(&odd_pairs(1.0)), "odd", "", "x", "y"),
    ]);
    pictures.extend([
        frontier(&[], "none", ""),
        frontier(&[frontier_set(&[300.0]), frontier_set(&[300.0, 900.0]), frontier_set(&[])], "sound", ""),
        frontier(&[frontier_set(&odd)], "odd", ""),
    ]);
    for tree in &trees {
        pictures.push(map(&environment(), tree, "map", "coverage 3 %"));
        pictures.push(gait_boxes(tree, 3, "boxes"));
        pictures.push(gait_boxes(tree, 0, "no gaits"));
    }
    let thin = Environment { size: [10_000.0, 1.0], goal: None, ..environment() };
    pictures.push(map(&thin, &sound, "thin", ""));
    pictures
}

#[test]
fn every_svg_is_valid_without_text_or_nan() {
    for picture in all() {
        let svg = picture.svg();
        let tree = usvg::Tree::from_str(&svg, &usvg::Options::default()).unwrap();
        let (width, height) = picture.size();
        assert_eq!((tree.size().width(), tree.size().height()), (width as f32, height as f32));
        assert!(!svg.contains("<text") && !svg.contains("NaN") && !svg.contains("inf"));
    }
}

#[test]
fn every_png_has_expected_size_and_dark_pixels() {
    for picture in all() {
        let pixels = tiny_skia::Pixmap::decode_png(&picture.png().unwrap()).unwrap();
        let (width, height) = picture.size();
        assert_eq!((pixels.width(), pixels.height()), (width * PNG_SCALE, height * PNG_SCALE));
        let dark = pixels.pixels().iter().filter(|p| p.red() < 100 && p.alpha() == 255).count();
        assert!(dark > 100, "only {dark} dark pixels");
    }
}

#[test]
fn same_data_gives_same_bytes() {
    for (first, second) in all().into_iter().zip(all()) {
        assert_eq!(first, second);
        assert_eq!(first.svg(), second.svg());
        assert_eq!(first.png().unwrap(), second.png().unwrap());
    }
}

/// The goal's star is drawn at the place of (3, −5) on the axes.
#[test]
fn goal_is_drawn_at_its_axis_coordinates() {
    let goal = Some(Goal::at(3.0, -5.0, 0.01));
    let environment = Environment { goal, obstacles: Vec::new(), terrain: Vec::new(), ..environment() };
    let picture = map(&environment, &TreeRecord::default(), "title", "subtitle");
    let pixels = tiny_skia::Pixmap::decode_png(&picture.png().unwrap()).unwrap();
    let scale = f64::from(PNG_SCALE);
    // From the bottom upwards: 56 px of labels, then the frame, which is 820 px wide and 820 · 27 / 48 px high.
    let bottom = f64::from(picture.size().1) - 56.0;
    let top = bottom - 820.0 * 27.0 / 48.0;
    let expected = [76.0 + (3.0 + 24.0) / 48.0 * 820.0, top + (13.5 + 5.0) / 27.0 * (bottom - top)];
    // Pixels with the accent colour inside the frame: the legend has another star.
    let accent = (0xd5, 0x5e, 0x00);
    let star: Vec<(u32, u32)> = (top as u32 * PNG_SCALE..pixels.height())
        .flat_map(|y| (0..pixels.width()).map(move |x| (x, y)))
        .filter(|&(x, y)| pixels.pixel(x, y).is_some_and(|p| (p.red(), p.green(), p.blue()) == accent))
        .collect();
    let middle = |of: fn(&(u32, u32)) -> u32| {
        let (low, high) = (star.iter().map(of).min().unwrap(), star.iter().map(of).max().unwrap());
        f64::from(low + high + 1) / 2.0 / scale
    };
    let found = [middle(|p| p.0), middle(|p| p.1)];
    // The centre of a star is slightly above the middle of its vertical extent.
    assert!(
        (found[0] - expected[0]).abs() < 1.0 && (found[1] - expected[1]).abs() < 2.0,
        "star at {found:?}, expected at {expected:?}"
    );
}

#[test]
fn frame_maps_ranges_linearly_to_the_sheet() {
    let (x, y) = (Range { low: -2.0, high: 6.0 }, Range { low: 10.0, high: 20.0 });
    let frame = Frame { left: 50.0, top: 20.0, width: 400.0, height: 100.0, x, y };
    assert_eq!(frame.at(-2.0, 20.0), [50.0, 20.0]);
    assert_eq!(frame.at(6.0, 10.0), [450.0, 120.0]);
    assert_eq!(frame.at(2.0, 15.0), [250.0, 70.0]);
    let nan = [f64::NAN, 0.0];
    assert_eq!(frame.line([[-2.0, 20.0], nan, nan, [6.0, 10.0], [2.0, 15.0]]).len(), 2);
}

#[test]
fn ticks_are_round_numbers_inside_the_range() {
    for low in [-1e5, -31.4, -1.0, -0.003, 0.0, 1e-6, 0.7, 12.0, 98765.4] {
        for span in [1e-3, 0.013, 0.5, 1.0, 3.3, 27.0, 48.0, 150.0, 99_999.0] {
            let range = Range { low, high: low + span };
            for most in [3, 7, 12] {
                let ticks = range.ticks(most);
                let slack = 1e-6 * ticks.step;
                let inside = |v: &f64| *v >= range.low - slack && *v <= range.high + slack;
                assert!(ticks.values.iter().all(inside), "{range:?}: {ticks:?}");
                assert!((1..=most + 1).contains(&ticks.values.len()), "{range:?}, {most}: {ticks:?}");
                let leading = ticks.step / 10f64.powf(ticks.step.log10().floor() + 0.0);
                let round = [1.0, 2.0, 5.0, 10.0].iter().any(|m| (leading - m).abs() < 1e-6);
                assert!(round, "{}", ticks.step);
                let whole = |v: &f64| (v / ticks.step - (v / ticks.step).round()).abs() < 1e-6;
                assert!(ticks.values.iter().all(whole));
                let mut labels: Vec<String> = ticks.values.iter().map(|v| ticks.label(*v)).collect();
                labels.dedup();
                assert_eq!(labels.len(), ticks.values.len(), "{labels:?}");
            }
        }
    }
    assert!(Range { low: 0.0, high: 2.0 }.whole_ticks(10).values == [0.0, 1.0, 2.0]);
}

#[test]
fn numbers_are_formatted_with_minus_signs() {
    let ticks = Range { low: -1.0, high: 1.0 }.ticks(8);
    assert_eq!(ticks.label(-0.5), "−0.5");
    assert_eq!(ticks.label(-0.0), "0.0");
    assert_eq!([number(32.345), number(-0.001), number(1234.5), number(4.794)], ["32.3", "0.00", "1234", "4.79"]);
    assert_eq!(number(2.5e-7), "2.50e−7");
}

#[test]
fn box_plot_numbers_match_hand_computed_values() {
    let summary = Summary::of([1.0, 2.0, 3.0, 4.0, 100.0].into_iter()).unwrap();
    assert_eq!((summary.lower_quartile, summary.median, summary.upper_quartile), (2.0, 3.0, 4.0));
    assert_eq!((summary.lower_whisker, summary.upper_whisker), (1.0, 4.0));
    assert_eq!(summary.outliers, [100.0]);
    assert_eq!(Summary::of([7.0].into_iter()).unwrap().upper_whisker, 7.0);
    assert_eq!(Summary::of(std::iter::empty()), None);
}

#[test]
fn turn_takes_the_shorter_direction() {
    for (from, to, expected) in [(0.0, 1.0, 1.0), (3.0, -3.0, std::f64::consts::TAU - 6.0), (1.0, 0.5, -0.5)] {
        assert!((turn(from, to) - expected).abs() < 1e-12);
    }
}

#[test]
fn long_text_is_cut_to_fit() {
    let long = "a-robot-with-a-very-long-name ".repeat(8);
    let cut = fitted(&long, Type::TITLE, 300.0);
    assert!(cut.ends_with('…') && width(&cut, Type::TITLE) <= 300.0);
    assert!(width(&cut, Type::TITLE) > 270.0);
    assert_eq!(fitted("short", Type::TITLE, 300.0), "short");
}

#[test]
fn logarithmic_ticks_are_round_numbers() {
    let labels = |low: f64, high: f64| {
        let ticks = Range { low: low.log10(), high: high.log10() }.powers_of_ten(8);
        ticks.values.iter().map(|v| ticks.label(*v)).collect::<Vec<_>>()
    };
    assert_eq!(labels(40.0, 700.0), ["50", "100", "200", "500"]);
    assert_eq!(labels(0.0009, 2.0), ["0.001", "0.01", "0.1", "1"]);
    assert_eq!(labels(0.003, 0.3), ["0.005", "0.01", "0.02", "0.05", "0.1", "0.2"]);
    assert_eq!(labels(0.04, 0.6), ["0.05", "0.1", "0.2", "0.5"]);
}
