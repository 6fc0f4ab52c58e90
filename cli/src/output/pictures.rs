//! Pictures of a result, each as SVG and PNG.

use crate::draw::{self, DrawnPath, HistoryRow, Picture};
use crate::error::Error;
use crate::progress::Label;
use crate::values::Generation;
use sim_core::base::score::mean;
use sim_core::problem::Checked;
use sim_core::procedure::evolve::report::{Audit, Report};
use sim_core::procedure::plan::PlanReport;
use sim_core::procedure::simulate::{Recorded, Run, SimulationReport};

/// Returns (file name, content) of the pictures of a job that evolved. Without a report, only its history is drawn.
pub fn all(job: &Checked, history: &[Generation], report: Option<&Report>) -> Result<Vec<(String, Vec<u8>)>, Error> {
    let name = &job.spec().name;
    let Label { name: score, unit } = Label::of_job(job);
    let label = if unit.is_empty() { score } else { format!("{score}, {unit}") };
    let audited: Vec<[f64; 2]> = report.map(audited).unwrap_or_default();
    let mut pictures = vec![("convergence", draw::convergence(&rows(history), &audited, name, &label))];
    if let Some(report) = report {
        let fitness = format!("{label}: {}", crate::console::score(report.winner.score));
        pictures.push(("map", draw::map(job.environment(), &report.tree, name, &fitness)));
        pictures.push(("gaits", draw::gait_traces(&report.gaits, name)));
        pictures.push(("primitives", draw::gait_boxes(&report.tree, report.gaits.len(), name)));
    }
    files(&pictures)
}

/// Returns the pictures of a job that planned: the best tree on its map, and the gaits.
pub fn of_plans(job: &Checked, report: &PlanReport) -> Result<Vec<(String, Vec<u8>)>, Error> {
    let name = &job.spec().name;
    let score = report.plans.get(report.best as usize).and_then(|grown| Some(grown.as_ref()?.score));
    let Label { name: label, unit } = Label::of_job(job);
    let said = format!("tree {}, {label}: {}", report.best, crate::console::score_with(score, &unit));
    files(&[
        ("map", draw::map(job.environment(), &report.tree, name, &said)),
        ("gaits", draw::gait_traces(&report.gaits, name)),
    ])
}

/// Returns the pictures of a job that simulated: the paths of all runs on the map, with a picture per way.
pub fn of_simulation(job: &Checked, report: &SimulationReport) -> Result<Vec<(String, Vec<u8>)>, Error> {
    let mut pictures = Vec::new();
    for (i, Recorded { run: unvaried, .. }) in report.unvaried.iter().enumerate() {
        let drawn = |run: &Run| DrawnPath { points: run.path.clone(), good: run.succeeded(job) };
        let repeats: Vec<DrawnPath> = report.repeats.iter().filter_map(|runs| runs.get(i)).map(drawn).collect();
        let good = repeats.iter().filter(|path| path.good).count();
        let said = match repeats.len() {
            0 => unvaried.way.name().to_owned(),
            many => format!("{}: {good} of {many} repeats succeed", unvaried.way.name()),
        };
        let planned: Vec<[f64; 2]> =
            job.spec().simulate.iter().flat_map(|s| s.places.iter().flatten()).map(|p| [p[0], p[1]]).collect();
        let picture = draw::paths(job.environment(), &planned, &drawn(unvaried), &repeats, &job.spec().name, &said);
        pictures.push((format!("paths-{}", unvaried.way.name()), picture));
    }
    let pictures: Vec<(&str, Picture)> =
        pictures.iter().map(|(name, picture)| (name.as_str(), picture.clone())).collect();
    files(&pictures)
}

fn files(pictures: &[(&str, Picture)]) -> Result<Vec<(String, Vec<u8>)>, Error> {
    let mut files = Vec::new();
    for (name, picture) in pictures {
        files.push((format!("{name}.svg"), picture.svg().into_bytes()));
        files.push((format!("{name}.png"), png(name, picture)?));
    }
    Ok(files)
}

/// Returns a picture as PNG; `what` is its name in an error.
pub fn png(what: &str, picture: &Picture) -> Result<Vec<u8>, Error> {
    picture.png().map_err(|e| Error::Draw { what: what.to_owned(), reason: e.to_string() })
}

/// Returns (generation, score without reuse) of each new best of the search.
fn audited(report: &Report) -> Vec<[f64; 2]> {
    let mark = |audit: &Audit| Some([f64::from(audit.candidate.generation), mean(&audit.without_reuse)?]);
    report.audits.iter().filter_map(mark).collect()
}

fn rows(history: &[Generation]) -> Vec<HistoryRow> {
    let row = |g: &Generation| HistoryRow {
        generation: g.generation,
        min: g.min,
        lower_quartile: g.lower_quartile,
        median: g.median,
        upper_quartile: g.upper_quartile,
        max: g.max,
        best_so_far: g.best_so_far,
    };
    history.iter().map(row).collect()
}
