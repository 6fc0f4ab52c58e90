//! A result in a few lines, for people.

use crate::console::{self, count, score, score_with};
use crate::output::ResultFile;
use sim_core::score::Direction;
use std::path::Path;

/// What came out, where it is and what to do with it.
pub fn text(result: &ResultFile, folder: &Path) -> String {
    let unit = &result.score.unit;
    let with_unit = |value: Option<f64>| score_with(value, unit);
    let mut lines = Vec::new();
    match &result.winner {
        None => lines.push(format!("{}: every evaluation failed, so there is no winner", result.name)),
        Some(winner) => {
            lines.push(format!(
                "{}: {} {} (generation {}, candidate {})",
                result.name,
                result.score.name,
                with_unit(Some(winner.fitness)),
                winner.generation,
                winner.candidate
            ));
            let fresh = match (winner.fresh_mean, winner.fresh_deviation) {
                (Some(mean), Some(deviation)) => {
                    format!("{} ± {} (mean ± standard deviation)", score(mean), with_unit(Some(deviation)))
                }
                (mean, _) => with_unit(mean),
            };
            lines.push(format!("  on {} fresh seeds   {fresh}", winner.fresh.len()));
            if let Some(first) = &result.first {
                let ratio = result.fresh_ratio.map_or_else(String::new, |r| {
                    let sense = match result.score.direction {
                        Direction::Maximise => "",
                        Direction::Minimise => ", less is better",
                    };
                    format!(": the winner has {} times that{sense}", score(r))
                });
                lines.push(format!("  first generation   {} on the same seeds{ratio}", with_unit(first.fresh_mean)));
            }
            if winner.without_reuse.is_some() {
                lines.push(format!("  without reuse      {}", with_unit(winner.without_reuse)));
            }
        }
    }
    let counts = &result.counts;
    lines.push(format!(
        "  took               {}: {} evaluations{}, {} rollouts, {} of simulated time",
        console::seconds(result.wall_seconds),
        count(counts.evaluations),
        if counts.failed_evaluations > 0 {
            format!(" ({} failed)", count(counts.failed_evaluations))
        } else {
            String::new()
        },
        count(counts.rollouts),
        console::seconds(counts.simulated_seconds),
    ));
    lines.push(format!("  result digest      {}", result.result_digest));
    let folder = folder.display();
    if result.winner.is_some() {
        lines.push(format!(
            "  files              {folder}: result.json, history.csv, gaits.json, trajectories/, tree.json,"
        ));
        lines.push(
            "                     report.json; pictures map, gaits, convergence, primitives (.svg, .png)".to_owned(),
        );
        lines.push(format!("  next               look at {folder}/map.png"));
        lines.push(format!("                     evogait replay {folder} --gait 1"));
        lines.push(format!("                     evogait verify {folder}"));
    } else {
        lines.push(format!("  files              {folder}: result.json, history.csv, job.toml"));
        lines.push(
            "  next               look at `evogait robot` and at the gaits' bounds: the robot can't stand".to_owned(),
        );
    }
    lines.join("\n")
}
