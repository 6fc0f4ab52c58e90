//! `evogait compare`: settings that differ between runs, and results side by side.

use crate::arguments::Compare;
use crate::console::{self, score_with, table};
use crate::draw::{HistoryRow, comparison};
use crate::error::Error;
use crate::output::{self, Finished, JOB, OfWay, Share, Spread, Values, atomic};
use crate::{inputs, load};
use serde::Serialize;
use sim_core::problem::{Checked, JobKind};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// Tables of a job file that are compared by name, not key by key.
const NAMED: [&str; 2] = ["robot", "environment"];

/// Finished run.
struct Read {
    folder: PathBuf,
    job: Checked,
    result: Finished,
    settings: BTreeMap<String, String>,
}

#[derive(Serialize)]
struct View {
    runs: Vec<String>,
    /// Settings that are not the same in all runs, with the value of each run; `null` if a run has none.
    settings: BTreeMap<String, Vec<Option<String>>>,
    /// Results by name, with the value of each run; `null` if a run has none.
    results: Vec<(&'static str, Vec<Option<String>>)>,
    /// True if all runs are of the same job. `same_result` is true if their results have the same bits.
    same_job: bool,
    same_result: bool,
}

/// Reads the runs, prints the comparison and draws the curves.
pub fn run(args: Compare) -> Result<(), Error> {
    let runs = args.folders.iter().map(|folder| read(folder)).collect::<Result<Vec<Read>, Error>>()?;
    let picture = match &args.out {
        None => None,
        Some(path) => {
            inputs::refuse(path)?;
            Some((path, curves(&runs)?))
        }
    };
    let view = view(&runs);
    if let Some((path, picture)) = &picture {
        let png = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png"));
        let content = if png { output::png("comparison", picture)? } else { picture.svg().into_bytes() };
        atomic::write_file(path, &content)?;
    }
    if args.json {
        return console::say_json(&view);
    }
    let drawn = picture.map_or_else(String::new, |(path, _)| format!("\n\ncurves in {}", path.display()));
    console::say(&(text(&view) + &drawn))
}

fn read(folder: &Path) -> Result<Read, Error> {
    let (job, _) = load::resolved(&folder.join(JOB), Checked::from_toml)?;
    inputs::record(&folder.join(JOB));
    let result = output::finished(folder, &job)?;
    let table = toml::Table::try_from(job.spec()).unwrap_or_default();
    let mut settings = BTreeMap::new();
    for (key, value) in &table {
        match key.as_str() {
            "name" | "description" => {}
            named if NAMED.contains(&named) => {
                let name = value.get("name").and_then(|name| name.as_str()).unwrap_or_default();
                settings.insert(key.clone(), name.to_owned());
            }
            _ => flatten(key, value, &mut settings),
        }
    }
    Ok(Read { folder: folder.to_owned(), job, result, settings })
}

/// Adds every value of a table under the path of its key.
fn flatten(path: &str, value: &toml::Value, into: &mut BTreeMap<String, String>) {
    match value {
        toml::Value::Table(table) => {
            for (key, value) in table {
                flatten(&format!("{path}.{key}"), value, into);
            }
        }
        // Long lists, such as gaits, are compared by digest.
        toml::Value::Array(list) if list.len() > 4 || list.iter().any(toml::Value::is_array) => {
            let digest = sim_core::base::digest::Digest::of("compared list", &value.to_string());
            into.insert(path.to_owned(), format!("{} values, {}", list.len(), digest.short()));
        }
        toml::Value::String(text) => {
            into.insert(path.to_owned(), text.clone());
        }
        other => {
            into.insert(path.to_owned(), other.to_string());
        }
    }
}

fn view(runs: &[Read]) -> View {
    let keys: BTreeSet<&String> = runs.iter().flat_map(|run| run.settings.keys()).collect();
    let of = |key: &String| runs.iter().map(|run| run.settings.get(key).cloned()).collect::<Vec<_>>();
    let settings = keys.into_iter().map(|key| (key.clone(), of(key)));
    let settings: BTreeMap<_, _> =
        settings.filter(|(_, values)| values.windows(2).any(|pair| pair[0] != pair[1])).collect();
    let mut results: Vec<(&'static str, Vec<Option<String>>)> = Vec::new();
    let rows: Vec<BTreeMap<usize, (&'static str, String)>> = runs.iter().map(numbers).collect();
    let indexes: BTreeSet<usize> = rows.iter().flat_map(|row| row.keys().copied()).collect();
    for index in indexes {
        let name = rows.iter().find_map(|row| row.get(&index)).map_or("", |(name, _)| name);
        results.push((name, rows.iter().map(|row| row.get(&index).map(|(_, value)| value.clone())).collect()));
    }
    let same = |of: &dyn Fn(&Read) -> String| runs.windows(2).all(|pair| of(&pair[0]) == of(&pair[1]));
    View {
        runs: runs.iter().map(|run| run.folder.display().to_string()).collect(),
        settings,
        results,
        same_job: same(&|run| digests(run).0),
        same_result: same(&|run| digests(run).1),
    }
}

/// Returns the digests of job and result.
fn digests(run: &Read) -> (String, String) {
    match &run.result {
        Finished::Evolved(result) => (result.job_digest.to_string(), result.result_digest.to_string()),
        Finished::Planned(result) => (result.job_digest.to_string(), result.result_digest.to_string()),
        Finished::Simulated(result) => (result.job_digest.to_string(), result.result_digest.to_string()),
    }
}

/// Returns the results of a run by their row in the table.
fn numbers(run: &Read) -> BTreeMap<usize, (&'static str, String)> {
    let mut told: Vec<(usize, &'static str, Option<String>)> = Vec::new();
    match &run.result {
        Finished::Evolved(result) => {
            let unit = &result.score.unit;
            let with_unit = |value: Option<f64>| value.map(|_| score_with(value, unit));
            let spread = |mean: Option<f64>, deviation: Option<f64>| {
                Some(match deviation {
                    Some(deviation) => format!("{} ± {}", console::score(mean?), score_with(Some(deviation), unit)),
                    None => score_with(Some(mean?), unit),
                })
            };
            let winner = result.winner.as_ref();
            told.push((0, "score", Some(result.score.name.clone())));
            told.push((1, "search's best", with_unit(result.best_fitness)));
            told.push((2, "winner, search", with_unit(winner.map(|w| w.fitness))));
            told.push((3, "winner, fresh seeds", winner.and_then(|w| spread(w.fresh_mean, w.fresh_deviation))));
            told.push((4, "winner, reference", winner.and_then(|w| spread(w.reference, w.reference_deviation))));
            told.push((5, "winner, without reuse", winner.and_then(|w| with_unit(w.without_reuse))));
            told.push((6, "winner found in", winner.map(|w| format!("generation {}", w.generation))));
            told.push((20, "evaluations", Some(console::count(result.counts.evaluations))));
            told.push((21, "rollouts", Some(console::count(result.counts.rollouts))));
            told.push((22, "took", Some(console::seconds(result.wall_seconds))));
            told.push((23, "engine", Some(result.engines.search.clone())));
        }
        Finished::Planned(result) => {
            let spread = |spread: &Option<Spread>, unit: &str| {
                let Spread { mean, deviation } = (*spread)?;
                Some(match deviation {
                    Some(deviation) => format!("{} ± {}", console::score(mean), score_with(Some(deviation), unit)),
                    None => score_with(Some(mean), unit),
                })
            };
            told.push((10, "trees", Some(result.trees.to_string())));
            told.push((11, "reached the goal", result.reached.map(|reached| reached.to_string())));
            told.push((12, "distance to goal", spread(&result.distance, "mu")));
            told.push((13, "coverage", spread(&result.coverage, "%")));
            told.push((14, "gaits of a plan", spread(&result.plan_gaits, "")));
            told.push((15, "length of a plan", spread(&result.plan_length, "mu")));
            told.push((21, "rollouts", Some(console::count(result.counts.rollouts))));
            told.push((22, "took", Some(console::seconds(result.wall_seconds))));
            told.push((23, "engine", Some(result.engine.clone())));
        }
        Finished::Simulated(result) => {
            let values = |values: Option<Values>, unit: &str| {
                let Values { mean, deviation, .. } = values?;
                Some(match deviation {
                    Some(deviation) => format!("{} ± {}", console::score(mean), score_with(Some(deviation), unit)),
                    None => score_with(Some(mean), unit),
                })
            };
            // The first way represents the run; all ways have the same number of repeats.
            if let Some(OfWay { unvaried, repeats, .. }) = result.ways.first() {
                let share = |Share { count, of, .. }: Share| format!("{count} of {of} repeats");
                told.push((16, "success", repeats.as_ref().map(|of| share(of.success))));
                told.push((12, "distance to goal", repeats.as_ref().and_then(|of| values(of.distance, "mu"))));
                told.push((17, "displacement", repeats.as_ref().and_then(|of| values(of.displacement, "mu"))));
                told.push((18, "displacement, nothing varied", Some(score_with(Some(unvaried.displacement), "mu"))));
            }
            told.push((21, "rollouts", Some(console::count(result.counts.rollouts))));
            told.push((22, "took", Some(console::seconds(result.wall_seconds))));
            told.push((23, "engine", Some(result.engine.clone())));
        }
    }
    let (job, result) = digests(run);
    told.push((24, "job digest", Some(job.chars().take(12).collect())));
    told.push((25, "result digest", Some(result.chars().take(12).collect())));
    told.into_iter().filter_map(|(index, name, value)| Some((index, (name, value?)))).collect()
}

fn text(view: &View) -> String {
    let head: Vec<&str> = std::iter::once("").chain(view.runs.iter().map(String::as_str)).collect();
    let row = |name: &str, values: &[Option<String>]| {
        let cells = values.iter().map(|value| value.clone().unwrap_or_else(|| "–".to_owned()));
        std::iter::once(name.to_owned()).chain(cells).collect::<Vec<_>>()
    };
    let results: Vec<Vec<String>> = view.results.iter().map(|(name, values)| row(name, values)).collect();
    let mut parts = vec![table(&head, &results)];
    if view.settings.is_empty() {
        parts.push("all settings are the same".to_owned());
    } else {
        let settings: Vec<Vec<String>> = view.settings.iter().map(|(name, values)| row(name, values)).collect();
        parts.push(format!("settings that differ\n{}", table(&head, &settings)));
    }
    parts.push(
        match (view.same_job, view.same_result) {
            (true, true) => "the same job with the same bits",
            (true, false) => "the same job with DIFFERENT bits: run `evogait verify` on each run",
            (false, _) => "different jobs",
        }
        .to_owned(),
    );
    parts.join("\n\n")
}

/// Returns the picture of the searches' curves. Fails if their scores differ in name or unit.
fn curves(runs: &[Read]) -> Result<crate::draw::Picture, Error> {
    let usage = |message: String| Error::Usage { message };
    let label = |run: &Read| {
        let (name, unit) = run.job.score_label();
        if unit.is_empty() { name.to_owned() } else { format!("{name}, {unit}") }
    };
    let first = label(&runs[0]);
    let mut lines = Vec::new();
    for run in runs {
        let called = run.folder.display();
        let what = match run.job.kind() {
            JobKind::Evolve => None,
            JobKind::Plan => Some("plans with gaits that are given"),
            JobKind::Simulate => Some("simulates a motion that is given"),
        };
        if let Some(what) = what {
            return Err(usage(format!("{called} {what}, so it has no curve: omit --out")));
        }
        if label(run) != first {
            let other = label(run);
            return Err(usage(format!(
                "the score of {called} is {other}, that of {} is {first}: curves need runs with the same score",
                runs[0].folder.display()
            )));
        }
        lines.push((called.to_string(), history(&run.folder.join("history.csv"))?));
    }
    Ok(comparison(&lines, "comparison", &first))
}

/// Reads generation, score quartiles and best score so far from a history.csv.
fn history(path: &Path) -> Result<Vec<HistoryRow>, Error> {
    let text = fs::read_to_string(path).map_err(|e| Error::read(path, e))?;
    inputs::record(path);
    let damaged = |line: usize| Error::Damaged {
        path: path.to_owned(),
        reason: format!("line {line} is not a row of generation and scores"),
    };
    let row = |(i, line): (usize, &str)| {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |column: usize| cells.get(column).and_then(|cell| cell.parse::<f64>().ok());
        let needed = |column: usize| number(column).ok_or_else(|| damaged(i + 1));
        Ok(HistoryRow {
            generation: needed(0)? as u32,
            min: needed(1)?,
            lower_quartile: needed(2)?,
            median: needed(3)?,
            upper_quartile: needed(4)?,
            max: needed(5)?,
            best_so_far: number(7),
        })
    };
    text.lines().enumerate().skip(1).map(row).collect()
}
