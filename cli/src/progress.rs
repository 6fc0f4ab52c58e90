//! Progress of a run on standard error: a bar on a terminal, plain lines elsewhere, nothing with `--quiet`.

use crate::values::{self, Generation};
use crate::{console, watch};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use proto::v1::job_event::Event;
use proto::v1::{self, JobEvent};
use sim_core::problem::Checked;
use std::io::IsTerminal as _;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Least time between two plain lines.
const LINE_EVERY: Duration = Duration::from_secs(2);
/// Steps of the bar in a generation.
const STEPS: u64 = 1000;

/// Name and unit of a score.
#[derive(Clone, Debug)]
pub struct Label {
    /// Name, such as "coverage".
    pub name: String,
    /// Unit, such as "%"; empty for a pure number.
    pub unit: String,
}

impl Label {
    /// Returns the label of a job's score; "score" if another version wrote the job and this one can't read it.
    pub fn of_toml(job_toml: &str) -> Self {
        match Checked::from_toml(job_toml) {
            Ok(job) => Self::of_job(&job),
            Err(_) => Self { name: "score".to_owned(), unit: String::new() },
        }
    }

    /// Returns the label of a job's score.
    pub fn of_job(job: &Checked) -> Self {
        let (name, unit) = job.score_label();
        Self { name: name.to_owned(), unit: unit.to_owned() }
    }
}

/// Display of a job's progress from its events.
pub struct Progress {
    display: Display,
    unit: String,
    started: Instant,
    /// Generations done, with the fraction of the current one.
    done: f64,
    /// Generations done before this process began to watch; they do not count for the speed.
    done_before: f64,
    /// Total generations of the search.
    generations: u32,
    /// Evaluations of a generation; 0 until known.
    population: f64,
    best: Option<f64>,
    mean: f64,
}

enum Display {
    Hidden,
    Bar(ProgressBar),
    Lines { last: Option<Instant> },
}

impl Display {
    fn new(total: u64, quiet: bool) -> Self {
        if quiet {
            Self::Hidden
        } else if std::io::stderr().is_terminal() {
            let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr_with_hz(5));
            let style = ProgressStyle::with_template("{bar:10} {wide_msg}");
            bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            Self::Bar(bar)
        } else {
            Self::Lines { last: None }
        }
    }

    /// Shows the amount done. Plain lines are rate-limited, except for the last one.
    fn show(&mut self, done: u64, text: String, last_line: bool) {
        match self {
            Self::Hidden => {}
            Self::Bar(bar) => {
                bar.set_position(done);
                bar.set_message(text);
            }
            Self::Lines { last } => {
                if last_line || last.is_none_or(|then| then.elapsed() >= LINE_EVERY) {
                    *last = Some(Instant::now());
                    console::note(&text);
                }
            }
        }
    }

    fn finish(&self) {
        if let Self::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}

/// Display of progress of work in equal pieces. Any thread may count a piece as done.
pub struct Pieces {
    what: &'static str,
    total: u64,
    started: Instant,
    state: Mutex<(u64, Display)>,
}

impl Pieces {
    /// Starts the display; `what` names the pieces, such as "gaits".
    pub fn new(what: &'static str, total: u64, quiet: bool) -> Self {
        Self { what, total, started: Instant::now(), state: Mutex::new((0, Display::new(total, quiet))) }
    }

    /// Counts one more piece as done.
    pub fn one_done(&self) {
        let (done, display) = &mut *self.state.lock().unwrap_or_else(PoisonError::into_inner);
        *done += 1;
        let left = self.started.elapsed().as_secs_f64() / *done as f64 * self.total.saturating_sub(*done) as f64;
        let text = format!("{done}/{} {}  ETA {}", self.total, self.what, console::seconds(left));
        display.show(*done, text, *done == self.total);
    }
}

impl Drop for Pieces {
    fn drop(&mut self) {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).1.finish();
    }
}

impl Progress {
    /// Starts the display at the job's current progress.
    pub fn new(job: &v1::Job, label: &Label, quiet: bool) -> Self {
        let v1::Progress { phase, done, total, values, .. } = values::progress(job);
        let display = Display::new(u64::from(total) * STEPS, quiet);
        if let Display::Bar(bar) = &display {
            bar.set_message(phase);
        }
        Self {
            display,
            unit: label.unit.clone(),
            started: Instant::now(),
            done: done.into(),
            done_before: done.into(),
            generations: total,
            population: 0.0,
            best: values::number(&values, "best"),
            mean: f64::NAN,
        }
    }

    /// Updates the display from an event.
    pub fn observe(&mut self, event: &JobEvent) {
        let job = event.job.clone().unwrap_or_default();
        let v1::Progress { phase, done, total, values, .. } = values::progress(&job);
        match &event.event {
            Some(Event::RoundSealed(sealed)) => {
                if let Some(generation) = Generation::sealed(event) {
                    self.done = f64::from(generation.generation + 1);
                    self.population = values::count(&values, "evaluations") as f64 / self.done;
                    (self.best, self.mean) = (generation.best_so_far, generation.mean);
                    // A generation that was done before this process began to watch is not drawn.
                    if self.done > self.done_before {
                        self.draw(done == total);
                    }
                }
                if sealed.phase == "preparing" {
                    self.started = Instant::now();
                }
                match phase.as_str() {
                    same if same == sealed.phase => {}
                    "finishing" => self.say(
                        "search done: scoring the archive on the reference setting, auditing new bests without reuse",
                    ),
                    "reporting" => self.say("winner chosen: scoring it on fresh seeds, tracing its gaits"),
                    "tracing" => self.say("planning done: tracing the best tree and its plan"),
                    _ => {}
                }
            }
            Some(Event::TasksDone(tasks)) if phase == "searching" => {
                self.population = tasks.total.into();
                self.done = self.done.max(f64::from(done) + f64::from(tasks.done) / f64::from(tasks.total.max(1)));
                if matches!(self.display, Display::Bar(_)) {
                    self.draw(false);
                }
            }
            Some(Event::TasksDone(tasks)) if phase != "preparing" => {
                self.examined(&watch::phase(&phase, tasks.done, tasks.total), (tasks.done, tasks.total));
            }
            Some(Event::Waits(reason)) => self.say(reason),
            _ => {}
        }
    }

    /// Prints a warning, above the bar if there is one; nothing with `--quiet`.
    pub fn warn(&self, text: &str) {
        match &self.display {
            Display::Hidden => {}
            Display::Bar(bar) => bar.suspend(|| console::warn(text)),
            Display::Lines { .. } => console::warn(text),
        }
    }

    /// Ends the display.
    pub fn finish(&self) {
        self.display.finish();
    }

    /// Shows tasks of a round after the search: (done, total).
    fn examined(&mut self, text: &str, (done, total): (u32, u32)) {
        match &mut self.display {
            Display::Hidden => {}
            Display::Bar(bar) => {
                bar.set_length(total.into());
                bar.set_position(done.into());
                bar.set_message(text.to_owned());
            }
            Display::Lines { last } => {
                if last.is_none_or(|then| then.elapsed() >= LINE_EVERY) {
                    *last = Some(Instant::now());
                    console::note(text);
                }
            }
        }
    }

    fn say(&self, text: &str) {
        match &self.display {
            Display::Hidden => {}
            Display::Bar(bar) => bar.set_message(text.to_owned()),
            Display::Lines { .. } => console::note(text),
        }
    }

    fn draw(&mut self, last_line: bool) {
        let text = self.line();
        self.display.show((self.done * STEPS as f64) as u64, text, last_line);
    }

    /// Formats a line such as "gen 12/150  best 34.29 %  mean 12.13 %  41.3 eval/s  ETA 2 min 3 s". With the bar it
    /// fits into 80 columns.
    fn line(&self) -> String {
        let sealed = self.done as u32;
        let mean = Some(self.mean).filter(|m| m.is_finite());
        let mut text = format!(
            "gen {sealed}/{}  best {}  mean {}",
            self.generations,
            console::score_with(self.best, &self.unit),
            console::score_with(mean, &self.unit),
        );
        let elapsed = self.started.elapsed().as_secs_f64();
        let fresh = self.done - self.done_before;
        if fresh > 0.0 && elapsed > 0.0 {
            let rate = fresh / elapsed;
            let left = (f64::from(self.generations) - self.done).max(0.0) / rate;
            text += &format!("  {} eval/s  ETA {}", console::score(rate * self.population), console::seconds(left));
        }
        text
    }
}
