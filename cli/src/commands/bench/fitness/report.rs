//! Report of a comparison for people: tables for the terminal, a page and a picture.

use super::view::View;
use crate::console::table;
use crate::draw::{self, Picture, ScatterSet};
use study::fitness::comparison::{Finalist, FitnessRow, ratio};
use study::statistics::Estimate;

const HEAD: [&str; 8] = [
    "setting",
    "Spearman with the reference",
    "mean score",
    "of the reference's",
    "median difference",
    "95th percentile",
    "CPU s a genome",
    "rollouts",
];

/// Table with a title.
struct Section {
    title: String,
    head: Vec<String>,
    rows: Vec<Vec<String>>,
}

/// Returns the tables for the terminal.
pub fn text(view: &View) -> String {
    let tables = sections(view).into_iter().map(|s| {
        let head: Vec<&str> = s.head.iter().map(String::as_str).collect();
        format!("{}\n{}", s.title, table(&head, &s.rows))
    });
    format!("{}\n\n{}", heading(view), tables.collect::<Vec<_>>().join("\n\n"))
}

/// Returns the report as a page of Markdown.
pub fn markdown(view: &View) -> String {
    let mut page = format!("# Fitness: {} in {}\n\n{}\n", view.robot, view.environment, heading(view));
    for s in sections(view) {
        page += &format!("\n## {}\n\n| {} |\n|{}\n", s.title, s.head.join(" | "), "---|".repeat(s.head.len()));
        for row in &s.rows {
            page += &format!("| {} |\n", row.join(" | "));
        }
    }
    if view.found.genotypes.is_empty() { page } else { page + "\n![Scores against the reference's](scatter.svg)\n" }
}

/// Returns the picture of the scores with each setting against those of the reference.
pub fn scatter(view: &View) -> Picture {
    let mean = |scores: &[f64]| scores.iter().sum::<f64>() / scores.len() as f64;
    let reference = view.found.settings.len() - 1;
    let set = |i: usize| ScatterSet {
        name: view.found.settings[i].setting.to_string(),
        points: view.found.genotypes.iter().map(|g| [mean(&g.scores[reference]), mean(&g.scores[i])]).collect(),
    };
    let sets: Vec<ScatterSet> = (0..reference).map(set).collect();
    let title = format!("{} in {}: {}, setting by setting", view.robot, view.environment, view.score);
    let subtitle = format!("mean of {} trees, the same for all settings; a point a genome", view.trees);
    let axis = |of: &str| format!("{} {of}, {}", view.score, view.unit);
    draw::scatter(&sets, &title, &subtitle, &axis(&format!("on {}", view.found.reference)), &axis("on the setting"))
}

fn heading(view: &View) -> String {
    format!(
        "{} ({}) in {}, {} gaits of {} s, K = {}, seed {}. Genomes are from {}. A score is the mean over {} trees, on the \
         same random streams with every setting. Differences in {}, over genomes. Intervals are 95 % bootstrap intervals over the \
         genomes.",
        view.robot,
        view.job,
        view.environment,
        view.gaits,
        view.gait_seconds,
        view.iterations,
        view.seed,
        view.from,
        view.trees,
        view.unit
    )
}

fn sections(view: &View) -> Vec<Section> {
    let owned = |head: &[&str]| head.iter().map(|h| (*h).to_owned()).collect::<Vec<String>>();
    let mut sections = Vec::new();
    if !view.found.genotypes.is_empty() {
        let ceiling = row(format!("{} (disturbed: the ceiling)", view.found.reference), &view.found.ceiling);
        let settings =
            view.found.settings[..view.found.settings.len() - 1].iter().map(|r| row(r.setting.to_string(), r));
        let reference = &view.found.settings[view.found.settings.len() - 1];
        let reference = row(format!("{} (the reference)", reference.setting), reference);
        sections.push(Section {
            title: format!("{} genomes of all ages against {}", view.found.genotypes.len(), view.found.reference),
            head: owned(&HEAD),
            rows: settings.chain([reference, ceiling]).collect(),
        });
        sections.push(pairs(view));
    }
    if !view.found.finalists.is_empty() {
        sections.push(finalists(view));
    }
    sections
}

fn row(name: String, row: &FitnessRow) -> Vec<String> {
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "–".to_owned());
    let agreement = row.agreement.as_ref();
    vec![
        name,
        or_dash(agreement.and_then(|a| a.spearman).map(with_interval)),
        or_dash(row.mean.map(|mean| format!("{mean:.2}"))),
        or_dash(agreement.and_then(|a| a.ratio).map(with_interval)),
        or_dash(agreement.map(|a| format!("{:.2}", a.median_difference))),
        or_dash(agreement.map(|a| format!("{:.2}", a.p95_difference))),
        format!("{:.3}", row.cpu_seconds),
        format!("{:.1}", row.rollouts),
    ]
}

fn pairs(view: &View) -> Section {
    let names = || view.found.settings.iter().map(|r| r.setting.to_string());
    let cell = |i: usize, j: usize| match view.found.pairs[i][j] {
        _ if j >= i => String::new(),
        Some(estimate) => with_interval(estimate),
        None => "–".to_owned(),
    };
    let last = view.found.settings.len() - 1;
    let row =
        |(i, name): (usize, String)| std::iter::once(name).chain((0..last).map(|j| cell(i, j))).collect::<Vec<_>>();
    Section {
        title: "Spearman of every pair".to_owned(),
        head: std::iter::once("setting".to_owned()).chain(names().take(last)).collect(),
        rows: names().enumerate().skip(1).map(row).collect(),
    }
}

fn finalists(view: &View) -> Section {
    let row = |f: &Finalist| {
        let what = vec![format!("{}, {}", f.run, f.role), f.generation.to_string(), format!("{:.2}", f.search)];
        let means = f.means.iter().map(|mean| format!("{mean:.2}"));
        what.into_iter().chain(means).chain([percent(f.kept)]).collect::<Vec<String>>()
    };
    let mut rows: Vec<Vec<String>> = view.found.finalists.iter().map(row).collect();
    for role in ["winner", "search's best"] {
        let of: Vec<&Finalist> = view.found.finalists.iter().filter(|f| f.role == role).collect();
        let mean = |value: &dyn Fn(&Finalist) -> f64| of.iter().map(|f| value(f)).sum::<f64>() / of.len() as f64;
        let means: Vec<f64> = (0..view.found.settings.len()).map(|i| mean(&|f| f.means[i])).collect();
        let what = vec![format!("mean of {}", plural(role)), String::new(), format!("{:.2}", mean(&|f| f.search))];
        let cells = means.iter().map(|mean| format!("{mean:.2}"));
        rows.push(what.into_iter().chain(cells).chain([percent(ratio(means[means.len() - 1], means[0]))]).collect());
    }
    let first = ["run", "generation", "search"].map(str::to_owned);
    let kept = format!("kept on {}", view.found.reference);
    Section {
        title: format!(
            "Winners and best candidates of the runs (kept: score on {} divided by score on {})",
            view.found.reference, view.found.settings[0].setting
        ),
        head: first
            .into_iter()
            .chain(view.found.settings.iter().map(|r| r.setting.to_string()))
            .chain([kept])
            .collect(),
        rows,
    }
}

fn plural(role: &str) -> &'static str {
    if role == "winner" { "winners" } else { "searches' bests" }
}

fn percent(share: Option<f64>) -> String {
    share.map_or("–".to_owned(), |share| format!("{:.1} %", 100.0 * share))
}

/// Formats a value with its interval, such as "0.944 (0.912 to 0.968)".
fn with_interval(e: Estimate) -> String {
    format!("{:.3} ({:.3} to {:.3})", e.value, e.low, e.high)
}
