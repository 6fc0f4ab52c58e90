//! Rust side of `tests/peers/standing.py`: random robots, each turned to four headings. For each robot and heading it
//! prints a line of JSON with the reason for which a job refuses the robot, if any.
//!
//! Lengths are in mu, angles in degrees.

use clap::{Parser, ValueEnum};
use serde::Serialize;
use sim_core::base::random::{Purpose, Stream};
use sim_core::exchange::Format;
use sim_core::job::{JobSpec, Reference};
use sim_core::model::{BodySpec, BoxSpec, HingeSpec, PoseSpec, Robot, RobotSpec};
use sim_core::physics::{EngineChoice, Physics, Scale};
use sim_core::problem::Job;
use std::collections::BTreeMap;

/// Headings that each robot is turned to, about z.
const HEADINGS: [f64; 4] = [0.0, 90.0, 37.0, 211.0];
/// Least and greatest number of modules (or boxes) of a robot.
const MODULES: (u32, u32) = (2, 8);
const BOXES: (u32, u32) = (2, 6);
/// Distance between two boxes that share a hinge, mu.
const GAP: f64 = 0.02;
/// Small job. Only its robot matters.
const JOB: &str = r#"
name = "standing"
robot = "quadropod"
environment = "empty"
gaits = { count = 3, duration = 6.0 }
planner = { iterations = 40 }
fitness = { kind = "coverage", cell = 1.0 }
optimiser = { kind = "pso", particles = 8, generations = 6 }
finish = { archive = 5, seeds = 5 }
"#;

#[derive(Parser)]
struct Arguments {
    /// Kind of parts that the robots consist of
    kind: PoseKind,
    /// Index of the first robot
    first: u32,
    /// Number of robots
    count: u32,
    /// Seed of the random robots
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

#[derive(Clone, Copy, PartialEq, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
enum PoseKind {
    Modules,
    Boxes,
}

#[derive(Serialize)]
struct Answer {
    kind: PoseKind,
    index: u32,
    heading: f64,
    /// Robot file.
    toml: String,
    /// Robot as `evogait robot FILE --format mjcf` writes it.
    mjcf: String,
    /// Reason for which a job refuses the robot, by `physics.engine`; null if the job accepts the robot.
    refused: BTreeMap<&'static str, Option<String>>,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments = Arguments::parse();
    for index in arguments.first..arguments.first + arguments.count {
        let kind = arguments.kind;
        let drawn = match kind {
            PoseKind::Modules => modules(&mut Stream::new(arguments.seed, Purpose::Sample, index, 0, 3)),
            PoseKind::Boxes => boxes(&mut Stream::new(arguments.seed, Purpose::Sample, index, 0, 4)),
        };
        for heading in HEADINGS {
            let spec = turned(&drawn, heading);
            let robot = Robot::compile(&spec)?;
            let engines = [("auto", EngineChoice::Auto), ("lockstep", EngineChoice::Lockstep)];
            let answer = Answer {
                kind,
                index,
                heading,
                toml: toml::to_string(&spec)?,
                mjcf: Format::Mjcf.write(&robot, &Physics::of_scale(Scale::Paper)).expect("MJCF describes all robots"),
                refused: engines.map(|(name, engine)| (name, refusal(&spec, engine))).into(),
            };
            println!("{}", serde_json::to_string(&answer)?);
        }
    }
    Ok(())
}

fn refusal(robot: &RobotSpec, engine: EngineChoice) -> Option<String> {
    let mut job: JobSpec = toml::from_str(JOB).expect("JOB is a valid job file");
    job.robot = Reference::Inline(Box::new(robot.clone()));
    job.physics.engine = engine;
    Job::new(job).err().map(|invalid| invalid.to_string())
}

/// Returns a random tree of modules of all shipped kinds, docked at random faces and turns, lying on any of its six
/// sides.
fn modules(stream: &mut Stream) -> RobotSpec {
    const COSMO: [&str; 10] =
        ["back", "front", "a-left", "a-right", "a-top", "a-bottom", "b-left", "b-right", "b-top", "b-bottom"];
    const BLOCK: [&str; 6] = ["back", "front", "left", "right", "top", "bottom"];
    let faces = |kind: &str| if kind == "block" { &BLOCK[..] } else { &COSMO[..] };
    let count = MODULES.0 + stream.below(MODULES.1 - MODULES.0 + 1);
    let side = [[0, 0], [90, 0], [180, 0], [270, 0], [0, 90], [0, 270]][stream.below(6) as usize];
    let mut kinds = vec!["cosmo"];
    let mut text = format!(
        "name = \"modules\"\npivot = \"m0\"\n[[module]]\nname = \"m0\"\nkind = \"cosmo\"\n\
         pose = {{ rotation = [{}, {}, 0] }}\n",
        side[0], side[1]
    );
    while kinds.len() < count as usize {
        let mut pick = |list: &[&'static str]| list[stream.below(list.len() as u32) as usize];
        let kind = pick(&["cosmo", "cosmo", "block"]);
        let own = pick(faces(kind));
        let to = stream.below(kinds.len() as u32) as usize;
        let face = faces(kinds[to])[stream.below(faces(kinds[to]).len() as u32) as usize];
        let (name, turn) = (kinds.len(), 90 * stream.below(4));
        let longer = format!(
            "{text}[[module]]\nname = \"m{name}\"\nkind = \"{kind}\"\n\
             attach = {{ to = \"m{to}\", port = \"{face}\", own = \"{own}\", turn = {turn} }}\n"
        );
        // An overlapping module is refused; the loop then draws another one.
        if Robot::compile(&toml::from_str(&longer).expect("the generated text is a valid robot file")).is_ok() {
            text = longer;
            kinds.push(kind);
        }
    }
    toml::from_str(&text).expect("the generated text is a valid robot file")
}

/// Returns a random tree of boxes. Each is connected by a hinge to a side of another box; some are turned against it.
fn boxes(stream: &mut Stream) -> RobotSpec {
    loop {
        let spec = some_boxes(stream);
        // Robots with overlapping boxes are refused; the loop then draws another one.
        if Robot::compile(&spec).is_ok() {
            return spec;
        }
    }
}

fn some_boxes(stream: &mut Stream) -> RobotSpec {
    struct Placed {
        center: [f64; 3],
        rotation: [f64; 4],
        half: [f64; 3],
        /// Origin of the body's frame.
        origin: [f64; 3],
    }
    let mut placed: Vec<Placed> = Vec::new();
    let mut bodies = Vec::new();
    for i in 0..BOXES.0 + stream.below(BOXES.1 - BOXES.0 + 1) {
        let half = [0; 3].map(|_| stream.uniform(0.05, 0.3));
        let carrier = (i > 0).then(|| stream.below(i) as usize);
        let along = carrier.map_or([0.0, 0.0, 0.0, 1.0], |c| placed[c].rotation);
        let rotation = match stream.below(5) {
            0 => quaternion([0; 4].map(|_| stream.uniform(-1.0, 1.0))),
            1 => about_z(stream.uniform(0.0, 360.0)),
            _ => along,
        };
        let mut hinge = None;
        let (mut origin, mut center) = ([0.0; 3], [0.0; 3]);
        if let Some(c) = carrier {
            let carrier = &placed[c];
            let (side, sign) = (stream.below(3) as usize, if stream.below(2) == 0 { 1.0 } else { -1.0 });
            let mut on_side: [f64; 3] = std::array::from_fn(|k| stream.uniform(-0.5, 0.5) * carrier.half[k]);
            on_side[side] = sign * (carrier.half[side] + GAP / 2.0);
            let outward = rotated(carrier.rotation, std::array::from_fn(|k| if k == side { sign } else { 0.0 }));
            let seen = rotated(inverse(rotation), outward);
            let depth = GAP / 2.0 + (0..3).map(|k| seen[k].abs() * half[k]).sum::<f64>();
            origin = sum(carrier.center, rotated(carrier.rotation, on_side));
            center = sum(origin, outward.map(|v| v * depth));
            let axis = match stream.below(4) {
                3 => rotated(quaternion([0; 4].map(|_| stream.uniform(-1.0, 1.0))), [1.0, 0.0, 0.0]),
                k => rotated(carrier.rotation, std::array::from_fn(|j| if j == k as usize { 1.0 } else { 0.0 })),
            };
            let anchor = sum(origin, carrier.origin.map(|v| -v));
            hinge = Some(HingeSpec {
                name: format!("h{i}"),
                parent: format!("b{c}"),
                anchor,
                axis,
                limits: None,
                speed: None,
                torque: None,
            });
        }
        let mass = stream.uniform(0.2, 2.0);
        let square = half.map(|h| 4.0 * h * h * mass / 12.0);
        let moments = [square[1] + square[2], square[0] + square[2], square[0] + square[1]];
        let place = sum(center, origin.map(|v| -v));
        bodies.push(BodySpec {
            name: format!("b{i}"),
            mass,
            center_of_mass: place,
            inertia: inertia_in(rotation, [moments[0], moments[1], moments[2], 0.0, 0.0, 0.0]),
            hinge,
            boxes: vec![BoxSpec { center: place, rotation, half }],
            capsules: Vec::new(),
        });
        placed.push(Placed { center, rotation, half, origin });
    }
    let mut spec: RobotSpec =
        toml::from_str("name = \"boxes\"\npivot = \"b0\"").expect("the text is a valid robot file");
    spec.bodies = bodies;
    spec
}

/// Returns the whole robot turned about z.
fn turned(robot: &RobotSpec, degrees: f64) -> RobotSpec {
    let mut robot = robot.clone();
    let turn = about_z(degrees);
    for body in &mut robot.bodies {
        body.center_of_mass = rotated(turn, body.center_of_mass);
        body.inertia = inertia_in(turn, body.inertia);
        if let Some(hinge) = &mut body.hinge {
            hinge.anchor = rotated(turn, hinge.anchor);
            hinge.axis = rotated(turn, hinge.axis);
        }
        for part in &mut body.boxes {
            part.center = rotated(turn, part.center);
            part.rotation = quaternion(product(turn, part.rotation));
        }
    }
    for module in &mut robot.modules {
        if let Some(PoseSpec { rotation, .. }) = &mut module.pose {
            *rotation = turns_about_x_y_z(degrees, *rotation);
        }
    }
    robot
}

/// Returns turns about the own x, then y, then z axis, degrees, equal to the given turns followed by one about the
/// world's z.
fn turns_about_x_y_z(about_world: f64, [x, y, z]: [f64; 3]) -> [f64; 3] {
    let half = |degrees: f64| (degrees.to_radians() / 2.0).sin_cos();
    let ((sx, cx), (sy, cy)) = (half(x), half(y));
    let own = product(product([sx, 0.0, 0.0, cx], [0.0, sy, 0.0, cy]), about_z(z));
    let all = product(about_z(about_world), own);
    let [a, b, c] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|axis| rotated(all, axis));
    let sine = c[0].clamp(-1.0, 1.0);
    // At gimbal lock x and z turn about the same axis: x gets the whole turn.
    let (x, z) =
        if sine.abs() > 1.0 - 1e-12 { (b[2].atan2(b[1]), 0.0) } else { ((-c[1]).atan2(c[2]), (-b[0]).atan2(a[0])) };
    // Rounding keeps whole degrees whole, so quarter turns are exact.
    [x, sine.asin(), z].map(|angle| (angle.to_degrees() * 1e6).round() / 1e6)
}

fn sum(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] + b[k])
}

fn about_z(degrees: f64) -> [f64; 4] {
    let (sine, cosine) = (degrees.to_radians() / 2.0).sin_cos();
    [0.0, 0.0, sine, cosine]
}

/// Scales the quaternion to unit length.
fn quaternion(q: [f64; 4]) -> [f64; 4] {
    let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    q.map(|v| v / length)
}

fn inverse([x, y, z, w]: [f64; 4]) -> [f64; 4] {
    [-x, -y, -z, w]
}

fn product([ax, ay, az, aw]: [f64; 4], [bx, by, bz, bw]: [f64; 4]) -> [f64; 4] {
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

fn rotated(q: [f64; 4], [x, y, z]: [f64; 3]) -> [f64; 3] {
    let [x, y, z, _] = product(product(q, [x, y, z, 0.0]), inverse(q));
    [x, y, z]
}

/// Returns R I Rᵀ for an inertia given as xx, yy, zz, xy, xz, yz.
fn inertia_in(q: [f64; 4], [xx, yy, zz, xy, xz, yz]: [f64; 6]) -> [f64; 6] {
    let rows = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]].map(|row| rotated(q, row));
    let columns: [[f64; 3]; 3] = std::array::from_fn(|j| rotated(q, [rows[0][j], rows[1][j], rows[2][j]]));
    let at = |i: usize, j: usize| columns[j][i];
    [at(0, 0), at(1, 1), at(2, 2), at(0, 1), at(0, 2), at(1, 2)]
}
