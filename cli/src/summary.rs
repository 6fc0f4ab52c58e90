//! A result in a few lines, for people.

use crate::console::{self, count, score, score_with};
use crate::output::{Candidate, Finished, PlanFile, ResultFile, Spread};
use sim_core::base::score::Direction;
use std::path::Path;

/// What came out, where it is and what to do with it.
pub fn text(finished: &Finished, folder: &Path) -> String {
    match finished {
        Finished::Evolved(result) => evolved(result, folder),
        Finished::Planned(result) => planned(result, folder),
    }
}

fn planned(result: &PlanFile, folder: &Path) -> String {
    let spread = |spread: &Spread, unit: &str| match spread.deviation {
        Some(deviation) => format!("{} ± {}", score(spread.mean), score_with(Some(deviation), unit)),
        None => score_with(Some(spread.mean), unit),
    };
    let reached = result.reached.map_or_else(
        || "the environment has no goal".to_owned(),
        |reached| format!("{reached} of {} trees reached the goal", result.trees),
    );
    let mut lines = vec![format!("{}: {reached}", result.name)];
    let told = [
        ("distance to goal", &result.distance, "mu"),
        ("coverage", &result.coverage, "%"),
        ("gaits of a plan", &result.plan_gaits, ""),
        ("length of a plan", &result.plan_length, "mu"),
    ];
    lines.extend(
        told.iter().filter_map(|(what, value, unit)| Some(format!("  {what:18} {}", spread(value.as_ref()?, unit)))),
    );
    if let Some(best) = &result.best {
        let gaits: Vec<String> = best.gaits.iter().map(u32::to_string).collect();
        let distance =
            best.distance.map_or_else(String::new, |d| format!(", {} from the goal", score_with(Some(d), "mu")));
        lines.push(format!(
            "  best plan          tree {}: {} gaits, {}{distance}",
            best.tree,
            best.gaits.len(),
            console::seconds(best.gaits.len() as f64 * best.gait_seconds)
        ));
        lines.push(format!("                     gaits {}", gaits.join(" ")));
    }
    let stop = if result.stop_at_goal { "ending at the goal" } else { "to the last one" };
    lines.push(format!(
        "  trees              {} by {} of at most {} iterations, {stop}; {}",
        result.trees, result.algorithm, result.iterations, result.engine
    ));
    let counts = &result.counts;
    lines.push(format!(
        "  took               {}: {} rollouts, {} of simulated time",
        console::seconds(result.wall_seconds),
        count(counts.rollouts),
        console::seconds(counts.simulated_seconds)
    ));
    lines.push(format!("  result digest      {}", result.result_digest));
    let (quoted, map) = (console::quoted(folder.display()), folder.join("map.png"));
    lines.push(format!(
        "  files              {}: result.json, plans.csv, plan.csv, paths.csv, plans.json, tree.json,",
        folder.display()
    ));
    lines.push("                     gaits.json, trajectories/; pictures map, gaits (.svg, .png)".to_owned());
    lines.push(format!("  next               look at {}", console::quoted(map.display())));
    lines.push(format!("                     evogait verify {quoted}"));
    lines.join("\n")
}

fn evolved(result: &ResultFile, folder: &Path) -> String {
    let mut lines = Vec::new();
    match &result.winner {
        None => lines.push(format!("{}: every evaluation failed, so there is no winner", result.name)),
        Some(winner) => lines.extend(scores(result, winner)),
    }
    let counts = &result.counts;
    lines.push(format!(
        "  took               {}: {} evaluations{}, {} rollouts, {} of simulated time; finish {} rollouts",
        console::seconds(result.wall_seconds),
        count(counts.evaluations),
        if counts.failed_evaluations > 0 {
            format!(" ({} failed)", count(counts.failed_evaluations))
        } else {
            String::new()
        },
        count(counts.rollouts),
        console::seconds(counts.simulated_seconds),
        count(result.finish.rollouts),
    ));
    lines.push(format!("  result digest      {}", result.result_digest));
    let (quoted, map) = (console::quoted(folder.display()), folder.join("map.png"));
    let folder = folder.display();
    if result.winner.is_some() {
        lines.push(format!(
            "  files              {folder}: result.json, history.csv, gaits.json, trajectories/, tree.json,"
        ));
        let tables = if result.archive.is_empty() { "" } else { "archive.csv, " };
        lines.push(format!(
            "                     {tables}report.json; pictures map, gaits, convergence, primitives (.svg, .png)"
        ));
        lines.push(format!("  next               look at {}", console::quoted(map.display())));
        lines.push(format!("                     evogait replay {quoted} --gait 1"));
        lines.push(format!("                     evogait verify {quoted}"));
        lines.push(format!("                     evogait plan {quoted} --environment reuse-2"));
    } else {
        lines.push(format!("  files              {folder}: result.json, history.csv, job.toml"));
        lines.push(
            "  next               look at `evogait robot` and at the gaits' bounds: the robot can't stand".to_owned(),
        );
    }
    lines.join("\n")
}

/// The winner's scores beside those of the first generation's best, and what else the finish found.
fn scores(result: &ResultFile, winner: &Candidate) -> Vec<String> {
    let unit = &result.score.unit;
    let with_unit = |value: Option<f64>| score_with(value, unit);
    let spread = |mean: Option<f64>, deviation: Option<f64>| match (mean, deviation) {
        (Some(mean), Some(deviation)) => format!("{} ± {}", score(mean), with_unit(Some(deviation))),
        (mean, _) => with_unit(mean),
    };
    let times = |ratio: Option<f64>| {
        let sense = match result.score.direction {
            Direction::Maximise => "",
            Direction::Minimise => ", less is better",
        };
        ratio.map_or_else(String::new, |r| format!("{} times{sense}", score(r)))
    };
    let first = result.first.as_ref();
    // What is told of both, in columns; a cell that nobody asked for stays empty.
    let row = |what: &str, of: &dyn Fn(&Candidate) -> String, ratio: Option<f64>| {
        let line = format!("  {what:18} {:18} {:18} {}", of(winner), first.map(of).unwrap_or_default(), times(ratio));
        line.trim_end().to_owned()
    };
    let known = |value: Option<f64>| if value.is_some() { with_unit(value) } else { String::new() };

    let mut lines = vec![
        format!(
            "{}: {} {} (generation {}, candidate {})",
            result.name,
            result.score.name,
            with_unit(Some(winner.fitness)),
            winner.generation,
            winner.candidate
        ),
        format!("  {:18} {:18} {:18}", "", "winner", "first generation").trim_end().to_owned(),
        row("search", &|c| with_unit(Some(c.fitness)), None),
        row(
            &format!("{} fresh seeds", winner.fresh.len()),
            &|c| spread(c.fresh_mean, c.fresh_deviation),
            result.fresh_ratio,
        ),
    ];
    if winner.reference.is_some() {
        lines.push(row("reference", &|c| spread(c.reference, c.reference_deviation), result.reference_ratio));
    }
    lines.push(row("without reuse", &|c| known(c.without_reuse), None));
    let engines = match &result.engines.reference {
        None => result.engines.search.clone(),
        Some(reference) => format!("{}; reference and friction on {reference}", result.engines.search),
    };
    lines.push(format!("  engine             {engines}"));
    if winner.less_friction.is_some() || winner.more_friction.is_some() {
        let (less, more) = (with_unit(winner.less_friction), with_unit(winner.more_friction));
        lines.push(format!("  friction ± 10 %    {less} with less, {more} with more, on the reference"));
    }
    if !result.archive.is_empty() {
        let best = result.archive.iter().find(|row| Some(row.search) == result.best_fitness);
        let chosen = match best {
            Some(best) if best.rank > 1 => format!(
                "; the search's best, {}, has {} there, rank {}",
                with_unit(Some(best.search)),
                with_unit(best.reference),
                best.rank
            ),
            _ => "; it is the search's best, too".to_owned(),
        };
        lines.push(format!("  chosen             best of {} on the reference{chosen}", result.archive.len()));
    }
    if let Some(audits) = &result.audits {
        lines.push(format!(
            "  audit              {} new bests, score with reuse − without: median {}, worst {}",
            audits.bests.len(),
            with_unit(audits.median_gap),
            with_unit(audits.worst_gap)
        ));
    }
    lines
}
