//! `evogait replay`: simulates a stored gait or plan again.

use crate::arguments::{Replay, ReplayWhat};
use crate::console;
use crate::error::Error;
use crate::inputs;
use crate::output::{self, REPORT, Stored, atomic, mode_word};
use sim_core::report::{self, GaitTrace, PathTrace};
use sim_core::search::Scored;

/// Simulates the gait or plan, prints its facts and writes its samples.
pub fn run(args: Replay) -> Result<(), Error> {
    let stored = Stored::read(&args.folder)?;
    // Recorded before the simulation, so that --out can't overwrite an input.
    inputs::record(&args.folder.join(REPORT));
    if let Some(path) = &args.out {
        inputs::refuse(path)?;
    }
    let (text, csv) = match args.what {
        ReplayWhat::Gait(gait) => replay_gait(&stored, gait)?,
        ReplayWhat::Plan => replay_plan(&stored)?,
    };
    match &args.out {
        Some(path) => {
            atomic::write_file(path, csv.as_bytes())?;
            console::say(&format!("{text}\n  samples in {}", path.display()))
        }
        None => console::say(&text),
    }
}

fn replay_gait(stored: &Stored, gait: usize) -> Result<(String, String), Error> {
    let count = stored.job.gaits().count as usize;
    if gait >= count {
        let message =
            format!("--gait {} is out of range: {} has gaits 1 to {count}", gait + 1, stored.folder.display());
        return Err(Error::Usage { message });
    }
    let traces = report::gaits(&stored.job, &winner(stored)?.genotype);
    let trace = &traces[gait];
    let same = stored.report()?.gaits.get(gait).is_some_and(|kept| kept == trace);
    Ok((gait_text(stored, gait, trace, same), output::gait_csv(trace)))
}

fn winner(stored: &Stored) -> Result<Scored, Error> {
    let no_winner = || Error::NoWinner { folder: stored.folder.clone() };
    Ok(stored.result.winner.as_ref().ok_or_else(no_winner)?.scored())
}

fn compared(same: bool) -> &'static str {
    if same { "the same bits as stored" } else { "NOT the stored bits: run `evogait verify --full`" }
}

fn gait_text(stored: &Stored, gait: usize, trace: &GaitTrace, same: bool) -> String {
    let mut lines = vec![format!("gait {} of {}, simulated from the settled start", gait + 1, stored.result.name)];
    if let Some(d) = output::displacement(trace) {
        lines.push(format!(
            "  leads {} mu ahead and {} mu to the left (distance {} mu), turns by {} rad",
            console::score(d.x),
            console::score(d.y),
            console::score(d.distance),
            console::score(d.yaw)
        ));
    }
    lines.push(format!("  {} samples of {} joints, {}", trace.samples.len(), trace.joints.len(), compared(same)));
    if let Some(why) = &trace.unstable {
        lines.push(format!("  unstable: {why}"));
    }
    lines.join("\n")
}

fn replay_plan(stored: &Stored) -> Result<(String, String), Error> {
    let kept = stored.report()?;
    let (tree, paths) = report::plan(&stored.job, &winner(stored)?, &|| false)
        .map_err(|_| Error::Interrupted { hint: String::new() })?;
    let gaits: Vec<String> = tree
        .best_path
        .iter()
        .filter_map(|&node| tree.nodes.get(node)?.gait)
        .map(|gait| (gait + 1).to_string())
        .collect();
    let mut lines = vec![format!(
        "the best path of {}: {} gaits, {} s",
        stored.result.name,
        gaits.len(),
        console::score(gaits.len() as f64 * stored.job.gaits().duration)
    )];
    lines.push(format!("  gaits        {}", gaits.join(" ")));
    lines.extend(paths.iter().map(path_text));
    lines.push(format!("  {}", compared(kept.paths == paths)));
    Ok((lines.join("\n"), output::paths_csv(&paths)))
}

fn path_text(path: &PathTrace) -> String {
    let [x, y] = path.way.last().copied().unwrap_or_default();
    format!(
        "  {:12} ends at ({}, {}) mu, {} mu from the pose in the tree",
        mode_word(path.mode),
        console::score(x),
        console::score(y),
        console::score(path.end_error)
    )
}
