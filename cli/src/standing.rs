//! Where a job stands at this moment, as words and as JSON: who works on it, what waits, what went wrong, how long it
//! will take.

use crate::{console, values};
use proto::v1;
use serde::Serialize;
use std::time::Duration;

/// Assignments that are told one by one.
const TOLD: usize = 5;

/// As JSON: the names that scripts rely on.
#[derive(Serialize)]
pub struct StandingView {
    /// Assignments that workers have, the oldest first, up to 100 of them.
    held: Vec<HeldView>,
    held_total: u32,
    /// Tasks of the round at hand that nobody has.
    pending: u32,
    /// Tasks of the round at hand that crashed or failed alone.
    attempts: Vec<AttemptsView>,
    max_attempts: u32,
    /// Workers that could get work of it, and their slots.
    workers: u32,
    slots: u32,
    /// A task of the phase on a slot; `null` while it is not known.
    task_seconds: Option<f64>,
    /// Median over the newest rounds; `null` while it is not known.
    round_seconds: Option<f64>,
}

#[derive(Serialize)]
struct HeldView {
    worker_id: String,
    worker_name: String,
    first: u32,
    count: u32,
    seconds: f64,
}

#[derive(Serialize)]
struct AttemptsView {
    index: u32,
    attempts: u32,
}

impl StandingView {
    /// As the coordinator tells it.
    pub fn new(standing: &v1::Standing) -> Self {
        let seconds = |ms: f64| (ms > 0.0).then_some(ms / 1e3);
        let held = |h: &v1::Held| HeldView {
            worker_id: h.worker_id.clone(),
            worker_name: h.worker_name.clone(),
            first: h.first,
            count: h.count,
            seconds: h.for_ms as f64 / 1e3,
        };
        let attempts = |a: &v1::Attempts| AttemptsView { index: a.index, attempts: a.attempts };
        Self {
            held: standing.held.iter().map(held).collect(),
            held_total: standing.held_total,
            pending: standing.pending,
            attempts: standing.attempts.iter().map(attempts).collect(),
            max_attempts: standing.max_attempts,
            workers: standing.workers,
            slots: standing.slots,
            task_seconds: seconds(standing.task_ms),
            round_seconds: seconds(standing.round_ms),
        }
    }
}

/// Lines for `evogait show`.
pub fn lines(job: &v1::Job, standing: &v1::Standing) -> Vec<String> {
    let v1::Standing { held, held_total, pending, attempts, max_attempts, workers, slots, .. } = standing;
    let mut lines = vec![format!("  could work     {} with {}", many(*workers, "worker"), many(*slots, "slot"))];
    let mut out =
        format!("  out            {}, {pending} of {} tasks wait", many(*held_total, "range"), job.tasks_total);
    for held in held.iter().take(TOLD) {
        let range = match held.count {
            1 => held.first.to_string(),
            count => format!("{} to {}", held.first, held.first + count - 1),
        };
        out += &format!("\n                 {range} at {} for {}", held.worker_name, ms(held.for_ms as f64));
    }
    if *held_total as usize > TOLD {
        out += &format!("\n                 and {} more", *held_total as usize - TOLD);
    }
    lines.push(out);
    if !attempts.is_empty() {
        let each = attempts.iter().take(TOLD).map(|a| format!("task {}: {} of {max_attempts}", a.index, a.attempts));
        let more = if attempts.len() > TOLD { format!(", and {} more", attempts.len() - TOLD) } else { String::new() };
        lines.push(format!("  attempts       {}{more}", each.collect::<Vec<_>>().join(", ")));
    }
    if let Some(pace) = pace(job, standing) {
        lines.push(pace);
    }
    lines
}

/// How long a task, a round and the rest of the search take; nothing while that is not known.
fn pace(job: &v1::Job, standing: &v1::Standing) -> Option<String> {
    let mut parts = Vec::new();
    if standing.task_ms > 0.0 {
        parts.push(format!("{} a task", ms(standing.task_ms)));
    }
    let progress = values::progress(job);
    let left = progress.total.saturating_sub(progress.done);
    if standing.round_ms > 0.0 && left > 0 {
        parts.push(format!("{} a round", ms(standing.round_ms)));
        parts.push(format!("about {} to the end of the search", ms(standing.round_ms * f64::from(left))));
    }
    (!parts.is_empty()).then(|| format!("  pace           {}", parts.join(", ")))
}

fn many(n: u32, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{} {what}s", console::count(n.into())) }
}

fn ms(ms: f64) -> String {
    console::duration(Duration::from_secs_f64((ms / 1e3).clamp(0.0, 1e9)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_standing_says_who_works_on_what_and_how_long_it_will_take() {
        let held = |first, count, for_ms| v1::Held {
            worker_id: "w".to_owned(),
            worker_name: "node7:4711".to_owned(),
            first,
            count,
            for_ms,
        };
        let standing = v1::Standing {
            held: vec![held(0, 10, 12_000), held(17, 1, 420)],
            held_total: 2,
            pending: 6,
            attempts: vec![v1::Attempts { index: 17, attempts: 2 }],
            max_attempts: 3,
            workers: 1,
            slots: 2,
            task_ms: 1200.0,
            round_ms: 2500.0,
        };
        let job = v1::Job {
            progress: Some(v1::Progress { done: 4, total: 10, ..v1::Progress::default() }),
            tasks_done: 3,
            tasks_total: 20,
            ..v1::Job::default()
        };
        let text = lines(&job, &standing).join("\n");
        for part in [
            "1 worker with 2 slots",
            "2 ranges, 6 of 20 tasks wait",
            "0 to 9 at node7:4711 for 12 s",
            "17 at node7:4711 for 0.42 s",
            "task 17: 2 of 3",
            "1.20 s a task, 2.50 s a round, about 15 s to the end of the search",
        ] {
            assert!(text.contains(part), "{part} is not in\n{text}");
        }
        let unknown = lines(&job, &v1::Standing::default()).join("\n");
        assert!(!unknown.contains("pace") && !unknown.contains("attempts"), "{unknown}");
    }
}
