//! `evogait bench soundness`: search for faults that an engine does not report.

use super::subject::{self, Machine};
use crate::arguments::{BenchSoundness, cores};
use crate::console::{self, count, table};
use crate::error::Error;
use crate::progress::Pieces;
use serde::Serialize;
use sim_core::engines::engine;
use sim_core::physics::{Physics, Scale};
use study::clock::timed;
use study::setting::PhysicsSetting;
use study::soundness::{Soundness, of_robot};
use study::threads::in_order;

/// Number of rollouts of each robot.
const EACH: u32 = 64;

#[derive(Serialize)]
struct View {
    setting: PhysicsSetting,
    scale: Scale,
    /// Duration of a rollout, s.
    duration: f64,
    seed: u64,
    robots: u32,
    machine: Machine,
    /// Wall time, s.
    seconds: f64,
    found: Soundness,
}

/// Simulates the robots and prints the result.
///
/// # Errors
/// If a rollout left a bound and the engine did not report it.
pub fn run(args: BenchSoundness, quiet: bool) -> Result<(), Error> {
    subject::check(&[args.setting], args.duration)?;
    let scale: Scale = args.scale.into();
    let physics = args.setting.apply(&Physics::of(args.setting.engine, scale));
    let robots = args.rollouts.div_ceil(EACH);
    let threads = args.threads.unwrap_or_else(cores) as usize;
    let progress = Pieces::new("robots", robots.into(), quiet);
    let (parts, spent) = timed(|| {
        in_order(robots as usize, threads, |i| {
            let index = i as u32;
            let rollouts = EACH.min(args.rollouts - index * EACH);
            let found = of_robot(engine(args.setting.engine), &physics, (args.seed, index), rollouts, args.duration);
            progress.one_done();
            found
        })
    });
    drop(progress);
    let mut found = Soundness::default();
    parts.iter().for_each(|part| found.add(part));
    let view = View {
        setting: args.setting,
        scale,
        duration: args.duration,
        seed: args.seed,
        robots,
        machine: Machine::here(),
        seconds: spent.wall,
        found,
    };
    if args.json {
        console::say_json(&view)?
    } else {
        console::say(&text(&view))?
    }
    let unreported: u64 = view.found.unreported.values().sum();
    if unreported > 0 {
        return Err(Error::Unsound { rollouts: unreported });
    }
    Ok(())
}

fn text(view: &View) -> String {
    let found = &view.found;
    let bounds = ["finite", "speed", "penetration", "energy", "work"];
    let number = |counts: &std::collections::BTreeMap<String, u64>, bound: &str| {
        count(counts.get(bound).copied().unwrap_or_default())
    };
    let rows: Vec<Vec<String>> = bounds
        .iter()
        .map(|bound| vec![(*bound).to_owned(), number(&found.reported, bound), number(&found.unreported, bound)])
        .collect();
    format!(
        "{}: {} rollouts of {} s of {} random robots, {:.0} simulated s in {:.0} s ({})\n{}",
        view.setting,
        count(found.rollouts),
        view.duration,
        count(view.robots.into()),
        found.simulated,
        view.seconds,
        view.machine.line(),
        table(&["bound", "reported by the engine", "left unreported"], &rows)
    )
}
