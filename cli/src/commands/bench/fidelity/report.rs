//! Report of a comparison for people: a table for the terminal, a page and a picture.

use super::view::View;
use crate::console::table;
use crate::draw::{self, FrontierPoint, FrontierSet, Picture};
use study::fidelity::comparison::{Against, Set};
use study::statistics::Estimate;

const HEAD: [&str; 9] = [
    "setting",
    "simulated s / CPU s",
    "Spearman",
    "median |Δ(x,y)|, mu",
    "95th percentile",
    "median |Δyaw|, rad",
    "95th percentile",
    "relative",
    "unstable",
];

/// Returns the tables for the terminal.
pub fn text(view: &View) -> String {
    let tables = view.sets.iter().map(|set| {
        let rows: Vec<Vec<String>> = rows(view, set).collect();
        format!("{}\n{}\n{}", title(view, set), table(&HEAD, &rows), verdict(view, set))
    });
    format!("{}\n\n{}", heading(view), tables.collect::<Vec<_>>().join("\n\n"))
}

/// Returns the report as a page of Markdown.
pub fn markdown(view: &View) -> String {
    let mut page = format!("# Fidelity: {}\n\n{}\n", view.robot, heading(view));
    for set in &view.sets {
        page += &format!("\n## {}\n\n| {} |\n|{}\n", title(view, set), HEAD.join(" | "), "---|".repeat(HEAD.len()));
        for row in rows(view, set) {
            page += &format!("| {} |\n", row.join(" | "));
        }
        page += &format!("\n{}\n", verdict(view, set));
    }
    page + "\n![Speed against fidelity](frontier.svg)\n"
}

/// Returns the picture of speed against rank correlation and error.
pub fn frontier(view: &View) -> Picture {
    let set = |set: &Set| FrontierSet {
        name: format!("{} gaits", set.gaits),
        points: set
            .settings
            .iter()
            .map(|row| FrontierPoint {
                name: row.setting.to_string(),
                speed: row.against.speed.value,
                correlation: correlation(&row.against),
                error: error(&row.against),
            })
            .collect(),
        reference_speed: set.reference_speed.value,
        ceiling_correlation: correlation(&set.ceiling.against).map_or(f64::NAN, |[_, value, _]| value),
        ceiling_error: error(&set.ceiling.against).map_or(f64::NAN, |[_, value, _]| value),
    };
    let sets: Vec<FrontierSet> = view.sets.iter().map(set).collect();
    let title = format!("{}: speed and fidelity against {}", view.robot, view.reference);
    draw::frontier(&sets, &title, &format!("gaits of {} s; bars are 95 % intervals", view.duration))
}

fn correlation(against: &Against) -> Option<[f64; 3]> {
    against.fidelity.as_ref()?.spearman.map(ends)
}

fn error(against: &Against) -> Option<[f64; 3]> {
    Some(ends(against.fidelity.as_ref()?.position.median))
}

fn ends(estimate: Estimate) -> [f64; 3] {
    [estimate.low, estimate.value, estimate.high]
}

fn heading(view: &View) -> String {
    format!(
        "{} under {} mu/s² in environment {}, gaits of {} s from the settled start, seed {}; {} thread{} on {}. Intervals are 95 % bootstrap \
         intervals over the gaits.",
        view.robot,
        view.gravity,
        view.environment,
        view.duration,
        view.seed,
        view.threads,
        if view.threads == 1 { "" } else { "s" },
        view.machine.line()
    )
}

fn title(view: &View, set: &Set) -> String {
    let counted = set.ceiling.against.fidelity.as_ref().map_or(0, |f| f.gaits);
    let from = if set.gaits == "evolved" { format!(", from {}", view.evolved) } else { String::new() };
    format!("{counted} {} gaits against {}{from}", set.gaits, view.reference)
}

fn rows<'a>(view: &'a View, set: &'a Set) -> impl Iterator<Item = Vec<String>> + 'a {
    let settings = set.settings.iter().map(|r| row(r.setting.to_string(), &r.against));
    let halved = set.halved.iter().map(|h| row(format!("{} (half the reference's step)", h.setting), &h.against));
    let ceiling = row(format!("{} (disturbed: the ceiling)", view.reference), &set.ceiling.against);
    settings.chain(halved).chain([ceiling])
}

fn row(name: String, against: &Against) -> Vec<String> {
    let mut row = vec![name, format!("{:.0}", against.speed.value)];
    match &against.fidelity {
        None => row.extend(["–"; 7].map(str::to_owned)),
        Some(f) => {
            row.push(f.spearman.map_or("–".to_owned(), with_interval));
            row.extend([f.position.median, f.position.p95, f.yaw.median, f.yaw.p95].map(with_interval));
            row.push(f.relative.map_or("–".to_owned(), with_interval));
            row.push(f.unstable.to_string());
        }
    }
    row
}

/// Formats a value with its interval, such as "0.944 (0.91 to 0.97)". Tiny numbers have powers of ten.
fn with_interval(e: Estimate) -> String {
    format!("{} ({} to {})", short(e.value), short(e.low), short(e.high))
}

fn short(value: f64) -> String {
    match value.abs() {
        v if v > 0.0 && v < 0.001 => format!("{value:.1e}"),
        v if v >= 10.0 => format!("{value:.1}"),
        _ => format!("{value:.3}"),
    }
}

fn verdict(view: &View, set: &Set) -> String {
    let told = set.halved.iter().map(|h| {
        let how = if h.within_ceiling { "within the ceiling" } else { "beyond the ceiling" };
        format!("{} is {how}", h.setting)
    });
    let told: Vec<String> = told.collect();
    let so = if set.halved.iter().all(|h| h.within_ceiling) {
        "for these gaits the reference has converged"
    } else {
        "a setting's errors are significant only if they are well above those of the halved step"
    };
    format!("Halving the step of {}: {}; {so}.", view.reference, told.join(", "))
}
