//! Rust side of the comparisons in `tests/peers`: random gaits of a robot as tables of joint targets, and the rollouts
//! of our engines at any number of settings, as JSON on standard output.
//!
//! Lengths are in mu, angles in rad, times in s. Tables have one row every 5 ms. Targets are linear between the rows;
//! the last row is held.

use clap::Parser;
use serde::Serialize;
use sim_core::base::math::heading;
use sim_core::base::random::{Purpose, Stream};
use sim_core::control::{self, Controller, Hopf};
use sim_core::engines::engine;
use sim_core::exchange::Format;
use sim_core::model::{Robot, RobotSpec, State, catalogue};
use sim_core::physics::{EngineKind, Motion, Outcome, Physics, Request, Scale, TICK, Targets, settle};
use std::collections::BTreeMap;
use std::time::Instant;
use study::soundness::random_robot;

#[derive(Parser)]
struct Arguments {
    /// Name of a shipped robot; NAME:VARIANT for a variant with failed modules; random:INDEX for a random tree of 4 to
    /// 16 hinges
    robot: String,
    /// Number of random gaits; each has one Hopf oscillator per joint
    #[arg(long, default_value_t = 10)]
    gaits: u64,
    /// Seed of the gaits' parameters
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Length of a gait, s
    #[arg(long, default_value_t = 10.0)]
    duration: f64,
    /// Use gravity and motors of scale "real" instead of "paper"
    #[arg(long)]
    real: bool,
    /// Steps per second and substeps, such as 60x8 or 200x2-lockstep; may be given several times
    #[arg(long = "setting", value_parser = setting)]
    settings: Vec<EngineSetting>,
    /// Print the tables of joint targets
    #[arg(long)]
    tables: bool,
    /// Print only the robot as MJCF, as `evogait robot` writes it
    #[arg(long)]
    mjcf: bool,
}

/// Steps per second and substeps of an engine.
#[derive(Clone, Copy, Debug)]
struct EngineSetting {
    engine: EngineKind,
    steps: u32,
    substeps: u32,
}

impl EngineSetting {
    fn own(engine: EngineKind, scale: Scale) -> Self {
        let Physics { steps_per_second: steps, substeps, .. } = Physics::of(engine, scale);
        Self { engine, steps, substeps }
    }
}

impl Serialize for EngineSetting {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self { engine, steps, substeps } = self;
        match engine {
            EngineKind::Rapier => serializer.collect_str(&format_args!("{steps}x{substeps}")),
            EngineKind::Lockstep => serializer.collect_str(&format_args!("{steps}x{substeps}-lockstep")),
        }
    }
}

fn setting(text: &str) -> Result<EngineSetting, String> {
    let (numbers, engine) =
        text.strip_suffix("-lockstep").map_or((text, EngineKind::Rapier), |n| (n, EngineKind::Lockstep));
    let parts = numbers.split_once('x').and_then(|(a, b)| Some((a.parse().ok()?, b.parse().ok()?)));
    parts
        .filter(|(a, b)| *a > 0 && *b > 0)
        .map(|(steps, substeps)| EngineSetting { engine, steps, substeps })
        .ok_or_else(|| "a setting must be STEPSxSUBSTEPS, both at least 1, such as 60x8 or 200x2-lockstep".to_owned())
}

#[derive(Serialize)]
struct Answer {
    robot: String,
    scale: Scale,
    /// Settings that a job gets by default, by engine.
    default_settings: BTreeMap<&'static str, EngineSetting>,
    gravity: f32,
    joints: Vec<String>,
    bodies: Vec<BodyFacts>,
    start: Pose,
    free_fall: Drop,
    limp: Drop,
    tick: f64,
    duration: f64,
    /// Joint targets, indexed by gait, tick and joint.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    tables: Vec<Vec<Vec<f32>>>,
    runs: Vec<Run>,
}

#[derive(Serialize)]
struct BodyFacts {
    name: String,
    mass: f32,
    center_of_mass: [f32; 3],
    /// Inertia about the centre of mass, in the axes of the neutral configuration.
    inertia: [[f32; 3]; 3],
    boxes: usize,
}

#[derive(Serialize)]
struct Pose {
    position: [f32; 3],
    /// Quaternion (x, y, z, w).
    rotation: [f32; 4],
    yaw: f64,
    joints: Vec<f32>,
}

impl Pose {
    fn of(state: &State) -> Self {
        let (p, q) = (state.pivot.translation, state.pivot.rotation);
        Self { position: p.to_array(), rotation: q.to_array(), yaw: heading(q), joints: state.joints.clone() }
    }
}

/// Robot dropped from a height above its settled start.
#[derive(Serialize)]
struct Drop {
    lift: f32,
    seconds: f64,
    /// Height of the pivot at the end, mu.
    height: f32,
}

#[derive(Serialize)]
struct Run {
    setting: EngineSetting,
    /// Wall-clock time and simulated time of all gaits together on one core, s.
    wall: f64,
    simulated: f64,
    ends: Vec<Option<Pose>>,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments = Arguments::parse();
    let robot = compiled(&arguments.robot)?;
    let scale = if arguments.real { Scale::Real } else { Scale::Paper };
    let physics = Physics::of_scale(scale);
    if arguments.mjcf {
        println!("{}", Format::Mjcf.write(&robot, &physics).expect("MJCF describes all robots"));
        return Ok(());
    }
    let rapier = engine(EngineKind::Rapier);
    // On rapier, some random trees never come to rest: they wobble where many corners touch the ground.
    let own = Physics::of(EngineKind::Lockstep, scale);
    let start = settle(rapier, &robot, &physics).or_else(|_| settle(engine(EngineKind::Lockstep), &robot, &own))?;

    let gaits: Vec<Motion> =
        (0..arguments.gaits).map(|i| gait(&robot, arguments.seed, i, arguments.duration)).collect();
    let runs = arguments.settings.iter().map(|&setting| {
        let physics = Physics { steps_per_second: setting.steps, substeps: setting.substeps, ..physics };
        let requests: Vec<Request<'_>> = gaits.iter().map(|motion| Request { start: &start, motion }).collect();
        let clock = Instant::now();
        let rollouts = engine(setting.engine).run(&robot, &physics, &[], &requests);
        let wall = clock.elapsed().as_secs_f64();
        let simulated = rollouts.iter().map(|r| r.simulated_ms as f64 / 1000.0).sum();
        let ends = rollouts.iter().map(|r| (r.outcome == Outcome::Completed).then(|| Pose::of(&r.end)));
        Run { setting, wall, simulated, ends: ends.collect() }
    });
    let runs = runs.collect();

    let let_go = |lift: f32, seconds: f64, physics: &Physics| {
        let mut above = start.clone();
        above.pivot.translation.z += lift;
        let motion = Motion::standing(robot.hinges.len(), seconds);
        let request = Request { start: &above, motion: &motion };
        let end = rapier.run(&robot, physics, &[], &[request]).swap_remove(0).end;
        Drop { lift, seconds, height: end.pivot.translation.z }
    };
    // One step per tick, so that both engines simulate the same time.
    let fine = Physics { steps_per_second: 200, ..physics };
    // Time of a free fall over 10 mu at any gravity, rounded down to ticks. The fall starts higher, so it ends in the
    // air.
    let fall = 0.005 * (200.0 * (20.0 / f64::from(physics.gravity)).sqrt()).floor();
    let answer = Answer {
        robot: arguments.robot.clone(),
        scale,
        default_settings: [EngineKind::Rapier, EngineKind::Lockstep]
            .map(|engine| (engine.name(), EngineSetting::own(engine, scale)))
            .into(),
        gravity: physics.gravity,
        joints: robot.joint_names(),
        bodies: robot.bodies.iter().map(facts).collect(),
        start: Pose::of(&start),
        free_fall: let_go(15.0, fall, &fine),
        limp: let_go(0.5, 4.0, &Physics { stiffness: 0.0, ..fine }),
        tick: TICK,
        duration: arguments.duration,
        tables: if arguments.tables { gaits.iter().map(|gait| rows(gait.targets())).collect() } else { Vec::new() },
        runs,
    };
    println!("{}", serde_json::to_string(&answer)?);
    Ok(())
}

fn compiled(name: &str) -> Result<Robot, Box<dyn std::error::Error>> {
    let (name, variant) = name.split_once(':').map_or((name, None), |(name, variant)| (name, Some(variant)));
    if let ("random", Some(index)) = (name, variant) {
        return Ok(random_robot(&mut Stream::new(1, Purpose::Sample, index.parse()?, 0, 2)));
    }
    let entry = catalogue::find(catalogue::robots(), name)
        .ok_or_else(|| format!("there is no robot named \"{name}\"; `evogait scenarios` lists the robots"))?;
    let spec: RobotSpec = toml::from_str(entry.toml)?;
    Ok(Robot::compile(&variant.map_or(Ok(spec.clone()), |variant| spec.variant(variant))?)?)
}

fn gait(robot: &Robot, seed: u64, index: u64, duration: f64) -> Motion {
    let mut stream = Stream::new(seed, Purpose::Sample, 0, index as u32, 0);
    let mut genotype = Vec::new();
    for _ in 0..robot.hinges.len() {
        genotype.extend(Hopf.parameters().iter().map(|p| stream.uniform(p.bounds.0, p.bounds.1)));
    }
    Hopf.compile(&control::Run::new(robot, duration), &genotype)
        .expect("a Hopf oscillator compiles at all parameters within its bounds")
}

fn rows(targets: &Targets) -> Vec<Vec<f32>> {
    targets.rows().map(<[f32]>::to_vec).collect()
}

fn facts(body: &sim_core::model::Body) -> BodyFacts {
    BodyFacts {
        name: body.name.clone(),
        mass: body.mass,
        center_of_mass: body.center_of_mass.to_array(),
        inertia: body.inertia,
        boxes: body.boxes.len(),
    }
}
