//! Checks the scores of a first generation: a search can't improve if all of them are equal.

use crate::console;
use crate::progress::Label;
use crate::values::{self, Generation};
use proto::v1::JobEvent;
use sim_core::base::registry::Component;
use sim_core::base::score::Counts;
use sim_core::objective::{self, Coverage};
use sim_core::problem::Checked;

/// Scores of the evaluated candidates of a first generation.
#[derive(Clone, Copy, Debug)]
pub struct Scores {
    /// Number of candidates evaluated.
    pub candidates: u32,
    /// Number of failed evaluations among them.
    pub failed: u32,
    /// Least score of the other candidates; NaN if there are none.
    pub min: f64,
    /// Greatest score of the other candidates; NaN if there are none.
    pub max: f64,
    /// Counts of edges, rejections and rollouts, if known.
    pub counts: Option<Counts>,
}

/// Reason why a first generation gives a search no direction.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Useless {
    AllFailed,
    /// All candidates have this score.
    Same(f64),
}

impl Scores {
    /// Returns the scores if the event seals the first generation.
    pub fn of_event(event: &JobEvent) -> Option<Self> {
        let Generation { generation: 0, min, max, failed, counts, .. } = Generation::sealed(event)? else {
            return None;
        };
        let progress = values::progress(event.job.as_ref()?);
        let candidates = values::count(&progress.values, "evaluations") as u32;
        Some(Self { candidates, failed, min, max, counts: Some(counts) })
    }

    /// Summarises scores that were measured by this process.
    pub fn of_measured(scores: &[f64], counts: Counts) -> Self {
        let fold = |of: fn(f64, f64) -> f64| scores.iter().copied().fold(f64::NAN, of);
        let counts = Some(counts);
        Self { candidates: scores.len() as u32, failed: 0, min: fold(f64::min), max: fold(f64::max), counts }
    }

    /// Returns `None` if the scores differ, or if there is only one.
    fn judge(&self) -> Option<Useless> {
        match self.candidates.saturating_sub(self.failed) {
            0 if self.candidates > 0 => Some(Useless::AllFailed),
            0 | 1 => None,
            _ => (self.min == self.max).then_some(Useless::Same(self.min)),
        }
    }
}

/// Returns the warning about useless scores, with likely causes and remedies; `None` if the scores are useful. `job` is
/// `None` if another version wrote the job and this one can't read it; the causes are then general.
pub fn warning(job: Option<&Checked>, scores: &Scores) -> Option<String> {
    let what = match scores.judge()? {
        Useless::AllFailed => {
            return Some(
                "all evaluations of the first generation failed, so the search can't improve: each needs more rollouts \
                 than planner.max_rollouts allows; stop the run, and examine one with `evogait evaluate`"
                    .to_owned(),
            );
        }
        Useless::Same(score) => score,
    };
    let unit = job.map(|job| Label::of_job(job).unit).unwrap_or_default();
    let causes = job.map_or_else(Vec::new, |job| causes(job, scores.counts));
    let causes = match causes.is_empty() {
        false => causes.join("; "),
        true => "the robot is far smaller or larger than the map and its cells, gaits are too short, or obstacles enclose the start: \
                 compare the sizes (`evogait robot`, fitness.cell, environment.size), or lengthen gaits.duration"
            .to_owned(),
    };
    Some(format!(
        "all {} candidates of the first generation score the same, {}, so the search can't improve: {causes}",
        scores.candidates - scores.failed,
        console::score_with(Some(what), &unit),
    ))
}

/// Returns likely causes in a job, each with a remedy.
fn causes(job: &Checked, counts: Option<Counts>) -> Vec<String> {
    let mut causes = Vec::new();
    if counts.is_some_and(|counts| counts.edges > 0 && counts.rejected == counts.edges) {
        causes.push(
            "every motion was rejected: it hits an obstacle, leaves the map or is unstable; move environment.start, or \
             look at the robot with `evogait robot`"
                .to_owned(),
        );
    }
    let length = length(job);
    let environment = job.environment();
    let [width, depth] = environment.size;
    let number = console::score;
    let fitness = job.fitness_spec();
    if fitness.kind.0.name() == Coverage.name() {
        let cell = fitness.settings.real(&objective::CELL);
        if length < cell {
            causes.push(format!(
                "the robot is about {} mu long and a cell {} mu wide: give the robot's lengths in mu (`evogait robot FILE --unit \
                 LENGTH`), set a smaller fitness.cell, or lengthen gaits.duration",
                number(length),
                number(cell)
            ));
        }
        let border = |at: f64, side: f64| {
            let cells = (at + side / 2.0) / cell;
            (cells - cells.round()).abs() < 1e-6 && cells > 1e-6 && at < side / 2.0
        };
        if border(environment.start.x, width) || border(environment.start.y, depth) {
            causes.push(format!(
                "the start ({}, {}) lies on the border of a cell, so robots that barely move cover the next cell: move \
                 environment.start by half a cell ({} mu)",
                environment.start.x,
                environment.start.y,
                number(cell / 2.0)
            ));
        }
    }
    if length > width.min(depth) / 2.0 {
        causes.push(format!(
            "the robot is about {} mu long on a map of {} × {} mu: give the robot's lengths in mu, or enlarge \
             environment.size",
            number(length),
            number(width),
            number(depth)
        ));
    } else if causes.is_empty() && length < width.max(depth) / 200.0 {
        causes.push(format!(
            "the robot is only about {} mu long on a map of {} × {} mu: give the robot's lengths in mu, or lengthen \
             gaits.duration",
            number(length),
            number(width),
            number(depth)
        ));
    }
    causes
}

/// Returns the greatest extent of the robot's parts along an axis in the neutral configuration, mu. It is too large if
/// parts are rotated.
fn length(job: &Checked) -> f64 {
    let extent = |axis: usize| {
        let reach = |half: &[f64; 3], rotation: &[f64; 4]| match rotation {
            [0.0, 0.0, 0.0, _] => half[axis],
            _ => half.iter().copied().fold(0.0, f64::max),
        };
        let parts = || job.robot().parts.iter().map(|part| (part.center[axis], reach(&part.half, &part.rotation)));
        let high = parts().map(|(center, reach)| center + reach).fold(f64::NEG_INFINITY, f64::max);
        let low = parts().map(|(center, reach)| center - reach).fold(f64::INFINITY, f64::min);
        high - low
    };
    (0..3).map(extent).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::v1;
    use proto::v1::job_event::Event;

    fn scores(candidates: u32, failed: u32, min: f64, max: f64) -> Scores {
        Scores { candidates, failed, min, max, counts: None }
    }

    fn job(more: &str) -> Checked {
        let text =
            "name = \"a\"\nrobot = \"quadropod\"\n[gaits]\ncount = 2\nduration = 1.0\n[optimiser]\nkind = \"pso\"\n";
        Checked::from_toml(&format!("{text}{more}")).unwrap()
    }

    fn on_map(side: f64, x: f64, cell: f64) -> Checked {
        let at =
            format!("[environment]\nname = \"b\"\nsize = [{side:?}, {side:?}]\nstart = {{ x = {x:?}, y = 0.3 }}\n");
        job(&format!("{at}[fitness]\nkind = \"coverage\"\ncell = {cell:?}\n"))
    }

    #[test]
    fn different_or_single_scores_give_no_warning() {
        for fine in [
            scores(3, 0, 1.0, 1.5),
            scores(1, 0, 1.0, 1.0),
            scores(3, 2, 1.0, 1.0),
            scores(0, 0, f64::NAN, f64::NAN),
            scores(2, 0, f64::NAN, f64::NAN),
            Scores::of_measured(&[0.5, 0.5, 0.6], Counts::default()),
            Scores::of_measured(&[0.5], Counts::default()),
            Scores::of_measured(&[], Counts::default()),
        ] {
            assert_eq!(warning(None, &fine), None, "{fine:?}");
        }
    }

    #[test]
    fn equal_scores_and_failures_give_different_warnings() {
        let said = |scores: &Scores| warning(None, scores).unwrap();
        for failed in [scores(3, 3, f64::NAN, f64::NAN), scores(1, 1, f64::NAN, f64::NAN)] {
            assert!(said(&failed).starts_with("all evaluations of the first generation failed"));
        }
        assert!(
            said(&scores(20, 4, 0.0, 0.0)).starts_with("all 16 candidates of the first generation score the same, 0,")
        );
        let measured = Scores::of_measured(&[0.5; 3], Counts::default());
        assert!(said(&measured).starts_with("all 3 candidates") && said(&measured).contains("gaits are too short"));
    }

    #[test]
    fn later_generation_is_not_checked() {
        let value = |name: &str, value| v1::Value { name: name.to_owned(), unit: String::new(), value: Some(value) };
        let sealed = |index| {
            let values = vec![value("min", 1.0), value("max", 1.0)];
            let row = Some(v1::Row { series: "generations".to_owned(), index, values });
            let values = vec![value("evaluations", 5.0)];
            let progress = Some(v1::Progress { values, ..v1::Progress::default() });
            JobEvent {
                event: Some(Event::RoundSealed(v1::RoundSealed { row, ..v1::RoundSealed::default() })),
                job: Some(v1::Job { progress, ..v1::Job::default() }),
                ..JobEvent::default()
            }
        };
        assert!(Scores::of_event(&sealed(0)).is_some_and(|scores| scores.judge() == Some(Useless::Same(1.0))));
        assert!(Scores::of_event(&sealed(1)).is_none());
    }

    #[test]
    fn causes_depend_on_sizes_start_and_rejections() {
        let same = scores(5, 0, 0.0, 0.0);
        let said = |job: &Checked| warning(Some(job), &same).unwrap();
        let large_cells = said(&on_map(48.0, 0.3, 16.0));
        assert!(large_cells.contains("a cell 16.00 mu wide") && !large_cells.contains("border"), "{large_cells}");
        let border = said(&on_map(48.0, 0.0, 2.0));
        assert!(border.contains("the start (0, 0.3) lies on the border of a cell"), "{border}");
        assert!(border.contains("half a cell (1.000 mu)"), "{border}");
        let small_map = said(&on_map(8.0, 0.3, 2.0));
        assert!(small_map.contains("on a map of 8.000 × 8.000 mu"), "{small_map}");
        let neither = said(&on_map(48.0, 0.3, 2.0));
        assert!(neither.contains("gaits are too short"), "{neither}");
        let rejected = Counts { edges: 9, rejected: 9, ..Counts::default() };
        let said = warning(Some(&on_map(48.0, 0.3, 2.0)), &Scores { counts: Some(rejected), ..same }).unwrap();
        assert!(said.contains("every motion was rejected"), "{said}");
    }
}
