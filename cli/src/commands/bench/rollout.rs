//! `evogait bench rollout`: what physics costs.

use super::subject::{self, Machine};
use super::{gaits, rollouts, speed, turns};
use crate::arguments::BenchRollout;
use crate::console::{self, table};
use crate::error::Error;
use crate::progress::Pieces;
use serde::Serialize;
use sim_core::engines::engine;
use sim_core::physics::{Engine, EngineKind, Outcome, Physics, Request};
use study::clock::Spent;
use study::setting::Setting;
use study::statistics::Estimate;

#[derive(Serialize)]
struct View {
    robot: String,
    gaits: u32,
    /// s.
    duration: f64,
    seed: u64,
    machine: Machine,
    settings: Vec<Row>,
}

#[derive(Serialize)]
struct Row {
    setting: Setting,
    /// Simulated s a CPU s, with its 95 % interval over the gaits.
    simulated_per_cpu: Estimate,
    /// Simulated s a s on the wall.
    simulated_per_wall: f64,
    /// CPU time of a step, µs.
    step_us: f64,
    /// Rollouts that ended unstable.
    unstable: u32,
}

/// Measures and tells.
pub fn run(args: BenchRollout, quiet: bool) -> Result<(), Error> {
    let own = subject::own(&args.subject, EngineKind::Rapier);
    let settings = if args.settings.is_empty() { vec![own] } else { args.settings };
    subject::check(&[own], args.duration)?;
    subject::check(&settings, args.duration)?;
    let job = subject::job(&args.subject, None, own, args.duration, args.seed)?;
    subject::supported(&settings, &job)?;
    let physics: Vec<(&dyn Engine, Physics)> =
        settings.iter().map(|s| (engine(s.engine), s.apply(job.physics()))).collect();
    let motions = gaits::compiled(&job, &gaits::random(&job, args.gaits, args.seed))?;
    let progress = Pieces::new("gaits", motions.len() as u64, quiet);
    let mut spent: Vec<Vec<(f64, Spent)>> = vec![Vec::new(); settings.len()];
    let mut unstable = vec![0; settings.len()];
    for turn in turns(motions.len(), physics.iter().any(|(engine, _)| engine.lanes() > 1)) {
        let requests: Vec<Request<'_>> =
            motions[turn.clone()].iter().map(|motion| Request { start: job.start(), motion }).collect();
        for (i, (engine, physics)) in physics.iter().enumerate() {
            for (rollout, time) in rollouts(*engine, job.robot(), physics, &[], &requests) {
                spent[i].push((rollout.simulated_ms as f64 / 1000.0, time));
                unstable[i] += u32::from(rollout.outcome != Outcome::Completed);
            }
        }
        turn.for_each(|_| progress.one_done());
    }
    drop(progress);
    let row = |(i, setting): (usize, &Setting)| {
        let simulated: f64 = spent[i].iter().map(|(simulated, _)| simulated).sum();
        let mut total = Spent::default();
        spent[i].iter().for_each(|(_, time)| total += *time);
        Row {
            setting: *setting,
            simulated_per_cpu: speed(&spent[i]),
            simulated_per_wall: simulated / total.wall,
            step_us: 1e6 * total.cpu / (simulated * f64::from(setting.steps_per_second)),
            unstable: unstable[i],
        }
    };
    let view = View {
        robot: job.robot_spec().name.clone(),
        gaits: args.gaits,
        duration: args.duration,
        seed: args.seed,
        machine: Machine::here(),
        settings: settings.iter().enumerate().map(row).collect(),
    };
    if args.json { console::say_json(&view) } else { console::say(&text(&view)) }
}

fn text(view: &View) -> String {
    let rows: Vec<Vec<String>> = view
        .settings
        .iter()
        .map(|r| {
            let e = r.simulated_per_cpu;
            vec![
                r.setting.to_string(),
                format!("{:.0}", e.value),
                format!("{:.0} to {:.0}", e.low, e.high),
                format!("{:.0}", r.simulated_per_wall),
                format!("{:.1}", r.step_us),
                r.unstable.to_string(),
            ]
        })
        .collect();
    let head = ["setting", "simulated s / CPU s", "95 %", "/ wall s", "µs a step", "unstable"];
    format!(
        "{}: {} random gaits of {} s, one thread ({})\n{}",
        view.robot,
        view.gaits,
        view.duration,
        view.machine.line(),
        table(&head, &rows)
    )
}
