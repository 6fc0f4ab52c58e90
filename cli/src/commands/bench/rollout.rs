//! `evogait bench rollout`: speed of physics.

use super::subject::{self, Machine};
use crate::arguments::BenchRollout;
use crate::console::{self, table};
use crate::error::Error;
use crate::progress::Pieces;
use serde::Serialize;
use sim_core::physics::EngineKind;
use study::gaits;
use study::speed::{self, SpeedRow};

#[derive(Serialize)]
struct View {
    robot: String,
    gaits: u32,
    /// Duration of a gait, s.
    duration: f64,
    seed: u64,
    machine: Machine,
    settings: Vec<SpeedRow>,
}

/// Measures the settings and prints the result.
pub fn run(args: BenchRollout, quiet: bool) -> Result<(), Error> {
    let own = subject::own(&args.subject, EngineKind::Rapier);
    let settings = if args.settings.is_empty() { vec![own] } else { args.settings };
    subject::check(&[own], args.duration)?;
    subject::check(&settings, args.duration)?;
    let job = subject::job(&args.subject, None, own, args.duration, args.seed)?;
    subject::supported(&settings, &job)?;
    let motions = subject::compiled(&job, &gaits::random(&job, args.gaits, args.seed))?;
    let progress = Pieces::new("gaits", motions.len() as u64, quiet);
    let rows = speed::measure(&job, &settings, &motions, &|| progress.one_done());
    drop(progress);
    let view = View {
        robot: job.robot_spec().name.clone(),
        gaits: args.gaits,
        duration: args.duration,
        seed: args.seed,
        machine: Machine::here(),
        settings: rows,
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
