//! Summary of a result for people, in a few lines.

use crate::console::{self, count, score, score_with};
use crate::output::{
    Candidate, Finished, OfWay, PlanFile, ResultFile, RunNumbers, Share, SimulationFile, Spread, Statistics, Values,
};
use sim_core::base::score::Direction;
use sim_core::problem::{Checked, SimulateSpec};
use sim_core::search::OptimiserSpec;
use std::path::Path;

/// Returns the main numbers of a result, its files and the next commands.
pub fn text(finished: &Finished, folder: &Path) -> String {
    match finished {
        Finished::Evolved(result) => evolved(result, folder),
        Finished::Planned(result) => planned(result, folder),
        Finished::Simulated(result) => simulated(result, folder),
    }
}

/// Describes the candidates of a search's generations, such as "20 candidates", or "40, later 22 candidates" if the
/// generations after the first have fewer.
pub fn candidates(optimiser: &OptimiserSpec) -> String {
    match (optimiser.population(), optimiser.candidates(1)) {
        (first, later) if later == first || optimiser.generations() == 1 => format!("{first} candidates"),
        (first, later) => format!("{first}, later {later} candidates"),
    }
}

/// Describes the motion of a job, such as "a plan of 7 gaits, once with nothing varied and in 50 repeats, in 2 ways".
pub fn motion(job: &Checked, simulate: &SimulateSpec) -> String {
    let what = match (&simulate.steps, &simulate.targets) {
        (Some(steps), _) if steps.len() == 1 => format!("gait {}", steps[0]),
        (Some(steps), _) => format!("a plan of {} gaits", steps.len()),
        (None, Some(_)) => format!("a table of targets, {}", console::seconds(job.gaits().duration)),
        (None, None) if simulate.replan.is_some() => "plans to the goal".to_owned(),
        (None, None) => format!("standing, {}", console::seconds(job.gaits().duration)),
    };
    let repeats = match simulate.repeats.unwrap_or(0) {
        0 => String::new(),
        1 => ", once with nothing varied and in 1 repeat".to_owned(),
        many => format!(", once with nothing varied and in {} repeats", count(many.into())),
    };
    let ways = simulate.ways.as_ref().map_or(1, Vec::len);
    let anew =
        if simulate.replan.is_some() && simulate.steps.is_some() { ", with a new plan where it deviates" } else { "" };
    format!("{what}{repeats}{anew}{}", if ways > 1 { ", in 2 ways" } else { "" })
}

fn simulated(result: &SimulationFile, folder: &Path) -> String {
    let mut lines = Vec::new();
    for OfWay { way, unvaried, repeats } in &result.ways {
        let head = if result.ways.len() > 1 { format!(", {}", way.name()) } else { String::new() };
        lines.push(match repeats {
            Some(Statistics { success: Share { count, of, interval: [low, high] }, .. }) => format!(
                "{}{head}: {count} of {of} repeats succeed, {} % (95 % interval {} to {} %)",
                result.name,
                score(100.0 * f64::from(*count) / f64::from(*of)),
                score(100.0 * low),
                score(100.0 * high)
            ),
            None => format!("{}{head}: {}", result.name, if unvaried.success { "success" } else { "no success" }),
        });
        lines.extend(of_way(unvaried, repeats.as_ref()));
    }
    let planning = result.planning.as_ref().map_or_else(String::new, |planning| format!("; new plans on {planning}"));
    lines.push(format!("  engine             {}{planning}", result.engine));
    let counts = &result.counts;
    lines.push(format!(
        "  took               {}: {} rollouts, {} of simulated time",
        console::seconds(result.wall_seconds),
        count(counts.rollouts),
        console::seconds(counts.simulated_seconds)
    ));
    lines.push(format!("  result digest      {}", result.result_digest));
    let ways: Vec<&str> = result.ways.iter().map(|of| of.way.name()).collect();
    lines
        .push(format!("  files              {}: result.json, runs.csv, paths.csv, simulation.json,", folder.display()));
    lines.push(format!(
        "                     motion-{}.csv; pictures paths-{} (.svg, .png)",
        ways.join(".csv, motion-"),
        ways.join(", paths-")
    ));
    let picture = folder.join(format!("paths-{}.png", ways.first().copied().unwrap_or_default()));
    lines.push(format!("  next               look at {}", console::quoted(picture.display())));
    lines.push(format!("                     evogait verify {}", console::quoted(folder.display())));
    lines.join("\n")
}

/// Limit below which numbers of a run are printed as 0.
const STILL: f64 = 1e-6;

/// Returns the lines for the runs of a way: the motion with nothing varied in the first column, the repeats in the
/// second.
fn of_way(unvaried: &RunNumbers, repeats: Option<&Statistics>) -> Vec<String> {
    let mut lines = Vec::new();
    if repeats.is_some() {
        lines.push(format!("  {:18} {:18} {}", "", "nothing varied", "repeats"));
    }
    if unvaried.ended != "completed" {
        lines.push(format!("  {:18} {}", "ended", unvaried.ended));
    }
    type Of = fn(&Statistics) -> Option<Values>;
    let rows: [(&str, Option<f64>, &str, Of); 11] = [
        ("ahead", Some(unvaried.ahead), "mu", |of| of.ahead),
        ("to the left", Some(unvaried.left), "mu", |of| of.left),
        ("turned", Some(unvaried.turned), "rad", |of| of.turned),
        ("travelled", Some(unvaried.travelled), "mu", |of| of.travelled),
        ("distance to goal", unvaried.distance, "mu", |of| of.distance),
        ("deviation", unvaried.deviation, "mu", |of| of.deviation),
        ("took", Some(unvaried.seconds), "s", |of| of.seconds),
        ("work of motors", Some(unvaried.work), "kg mu²/s²", |of| of.work),
        ("absolute work", Some(unvaried.turnover), "kg mu²/s²", |of| of.turnover),
        ("bodies in contact", Some(100.0 * unvaried.contact), "%", |of| of.contact.map(percent)),
        ("new plans", Some(f64::from(unvaried.replans)), "", |of| of.replans),
    ];
    for (what, value, unit, of) in rows {
        let told = repeats.and_then(of);
        // Jobs without replanning have no such row.
        if value.is_none() && told.is_none() || what == "new plans" && unvaried.replans == 0 && told.is_none() {
            continue;
        }
        // Rounding errors alone move a standing robot.
        let value = value.map(|value| if value.abs() < STILL { 0.0 } else { value });
        let of_repeats = told.map_or_else(String::new, |Values { mean, deviation, .. }| match deviation {
            Some(deviation) => format!("{} ± {}", score(mean), score_with(Some(deviation), unit)),
            None => score_with(Some(mean), unit),
        });
        lines.push(format!("  {what:18} {:18} {of_repeats}", score_with(value, unit)).trim_end().to_owned());
    }
    let failed = |count: u32, what: &str| (count > 0).then(|| format!("{count} {what}"));
    if let Some(of) = repeats {
        let faults = [
            failed(of.broken, "did not complete"),
            failed(of.without_start, "could not start"),
            failed(of.touched, "touched an obstacle"),
            failed(of.left_map, "left the map"),
        ];
        let faults: Vec<String> = faults.into_iter().flatten().collect();
        if !faults.is_empty() {
            lines.push(format!("  {:18} {:18} {}", "faults", "", faults.join(", ")));
        }
    }
    lines
}

fn percent(share: Values) -> Values {
    let Values { mean, deviation, least, median, greatest } = share;
    Values {
        mean: 100.0 * mean,
        deviation: deviation.map(|d| 100.0 * d),
        least: 100.0 * least,
        median: 100.0 * median,
        greatest: 100.0 * greatest,
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
        None => lines.push(format!("{}: there is no winner, because every evaluation failed", result.name)),
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

/// Returns the lines with the winner's scores beside those of the first generation's best, and the results of the
/// finish.
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
    // A row with both candidates in columns; an unknown cell stays empty.
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
            _ => "; it is also the best of the search".to_owned(),
        };
        lines.push(format!("  chosen             best of {} on the reference{chosen}", result.archive.len()));
    }
    if let Some(audits) = &result.audits {
        lines.push(format!(
            "  audit              {} new bests, score with reuse minus without: median {}, worst {}",
            audits.bests.len(),
            with_unit(audits.median_gap),
            with_unit(audits.worst_gap)
        ));
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn later_generations_of_another_size_are_mentioned() {
        let said = |table: &str| candidates(&toml::from_str(table).unwrap());
        assert_eq!(said("kind = 'ga'"), "20 candidates");
        assert_eq!(said("kind = 'sequence-ga'"), "40, later 22 candidates");
        assert_eq!(said("kind = 'sequence-ga'\ngenerations = 1"), "40 candidates");
    }
}
