//! Report of a comparison for people: tables for the terminal, a page and pictures.

use super::View;
use crate::console::table;
use crate::draw::{self, Picture, ScatterSet};
use study::reuse::{Column, Found, ReuseRow};
use study::statistics::Estimate;

const HEAD: [&str; 9] = [
    "scored with",
    "Spearman with plain",
    "median |Δ|",
    "95th percentile",
    "Spearman, other seeds",
    "median |Δ| of seeds",
    "rollouts",
    "× fewer than plain",
    "than literal",
];

/// Returns the tables for the terminal.
pub fn text(view: &View) -> String {
    let tables = view.environments.iter().map(|found| {
        let rows: Vec<Vec<String>> = found.rows.iter().map(|r| row(view, r)).collect();
        format!("{}\n{}", title(found), table(&HEAD, &rows))
    });
    format!("{}\n\n{}", heading(view), tables.collect::<Vec<_>>().join("\n\n"))
}

/// Returns the report as a page of Markdown.
pub fn markdown(view: &View) -> String {
    let mut page = format!("# Transition reuse: {}\n\n{}\n", view.robot, heading(view));
    for found in &view.environments {
        page += &format!("\n## {}\n\n| {} |\n|{}\n", title(found), HEAD.join(" | "), "---|".repeat(HEAD.len()));
        for r in &found.rows {
            page += &format!("| {} |\n", row(view, r).join(" | "));
        }
        page += &format!("\n![Scores with reuse against plain ones](scatter-{}.svg)\n", found.environment);
    }
    page
}

/// Returns the picture of the scores with the job's own reuse against plain scores.
pub fn scatter(view: &View, found: &Found) -> Picture {
    let is_own =
        |c: &Column| (c.reuse.tolerance, c.reuse.variants, c.repeats, c.draw) == (view.own.0, view.own.1, 1, 0);
    // The scores of a job without reuse are in the plain column.
    let own = found.columns.iter().position(is_own).unwrap_or(0);
    let set = |name: &str, evolved: bool| ScatterSet {
        name: name.to_owned(),
        points: found
            .genotypes
            .iter()
            .filter(|g| (g.generation > 0) == evolved)
            .map(|g| [g.measured[0].score, g.measured[own].score])
            .collect(),
    };
    let title = format!("{} in {}: {} with reuse against plain", view.robot, found.environment, view.score);
    let axis = |what: &str| format!("{what} {}, {}", view.score, view.unit);
    let correlation =
        found.rows.iter().find(|r| r.tolerance == view.own.0 && r.repeats == 1 && r.variants == view.own.1);
    let correlation = correlation.and_then(|r| r.spearman).map_or("–".to_owned(), with_interval);
    let subtitle = format!("tolerance {}, same random streams; Spearman {correlation}", view.own.0);
    let sets = [set("random genomes", false), set("evolved genomes", true)];
    draw::scatter(&sets, &title, &subtitle, &axis("plain"), &format!("{} with reuse, {}", view.score, view.unit))
}

fn heading(view: &View) -> String {
    format!(
        "{} ({}), {} gaits of {} s, K = {}, seed {}. Evolved genomes are from {}. Plain: every expanded node is simulated. \
         |Δ| in {}, over genomes. Intervals are 95 % bootstrap intervals over the genomes.",
        view.robot, view.job, view.gaits, view.gait_seconds, view.iterations, view.seed, view.evolved, view.unit
    )
}

fn title(found: &Found) -> String {
    let evolved = found.genotypes.iter().filter(|g| g.generation > 0).count();
    let random = found.genotypes.len() - evolved;
    format!("{}: {random} random and {evolved} evolved genomes", found.environment)
}

fn row(view: &View, row: &ReuseRow) -> Vec<String> {
    let or_dash = |text: Option<String>| text.unwrap_or_else(|| "–".to_owned());
    let number = |v: f64| format!("{v:.3}");
    vec![
        name(view, row),
        or_dash(row.spearman.map(with_interval)),
        number(row.median_difference),
        number(row.p95_difference),
        or_dash(row.spearman_other_seeds.map(with_interval)),
        or_dash(row.median_difference_seeds.map(number)),
        format!("{:.1}", row.rollouts),
        format!("{:.1}", row.fewer_than_plain),
        format!("{:.1}", row.fewer_than_literal),
    ]
}

fn name(view: &View, row: &ReuseRow) -> String {
    if row.tolerance == 0.0 && row.repeats == 1 {
        return "plain".to_owned();
    }
    let mut name = format!("tolerance {}", row.tolerance);
    if row.variants > 1 {
        name += &format!(", {} variants", row.variants);
    }
    if row.repeats > 1 {
        name += &format!(", {} trees", row.repeats);
    }
    if (row.tolerance, row.variants, row.repeats) == (view.own.0, view.own.1, 1) {
        name += " (the job's)";
    }
    name
}

/// Formats a value with its interval, such as "0.944 (0.912 to 0.968)".
fn with_interval(e: Estimate) -> String {
    format!("{:.3} ({:.3} to {:.3})", e.value, e.low, e.high)
}
