//! Current state of a job as text and as JSON: leases, pending tasks, failed attempts, and the estimated time.

use crate::{console, values};
use proto::v1;
use serde::Serialize;
use std::time::Duration;

/// Most leases and attempts that the text lists one by one.
const TOLD: usize = 5;

/// State of a job as JSON. Scripts rely on the field names.
#[derive(Serialize)]
pub struct StandingView {
    /// Leases of workers, oldest first, at most 100.
    held: Vec<HeldView>,
    held_total: u32,
    /// Tasks of the current round that are not leased.
    pending: u32,
    /// Tasks of the current round that crashed or failed while they ran alone.
    attempts: Vec<AttemptsView>,
    max_attempts: u32,
    /// Workers that can lease tasks of the job, and their slots.
    workers: u32,
    slots: u32,
    /// Time of a task of the current phase on a slot, s; `null` while unknown.
    task_seconds: Option<f64>,
    /// Median time of the newest rounds, s; `null` while unknown.
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
    /// Converts the coordinator's message.
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

/// Returns the lines for `evogait show`.
pub fn lines(job: &v1::Job, standing: &v1::Standing) -> Vec<String> {
    let v1::Standing { held, held_total, pending, attempts, max_attempts, workers, slots, .. } = standing;
    let mut lines = vec![format!("  available      {} with {}", many(*workers, "worker"), many(*slots, "slot"))];
    let mut out =
        format!("  leases         {}, {pending} of {} tasks pending", many(*held_total, "lease"), job.tasks_total);
    for held in held.iter().take(TOLD) {
        let range = match held.count {
            1 => held.first.to_string(),
            count => format!("{} to {}", held.first, held.first + count - 1),
        };
        out += &format!("\n                 tasks {range} on {} for {}", held.worker_name, ms(held.for_ms as f64));
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

/// Returns the line with the time of a task, of a round and of the rest of the search; `None` while unknown.
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
    fn lines_show_leases_attempts_and_pace() {
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
            "2 leases, 6 of 20 tasks pending",
            "tasks 0 to 9 on node7:4711 for 12 s",
            "tasks 17 on node7:4711 for 0.42 s",
            "task 17: 2 of 3",
            "1.20 s a task, 2.50 s a round, about 15 s to the end of the search",
        ] {
            assert!(text.contains(part), "missing {part:?} in\n{text}");
        }
        let unknown = lines(&job, &v1::Standing::default()).join("\n");
        assert!(!unknown.contains("pace") && !unknown.contains("attempts"), "{unknown}");
    }
}
