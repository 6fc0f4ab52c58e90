//! Prometheus metrics of the worker.

use crate::assignments::Assignments;
use crate::work::Finished;
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::registry::{Registry, Unit};
use proto::v1::complete_request::Outcome;
use proto::v1::complete_response::Verdict;
use std::sync::Arc;
use std::time::Duration;
use telemetry::Vitals;
use telemetry::endpoint::Answer;

type Label = [(&'static str, &'static str); 1];

/// All metrics of the worker.
pub(crate) struct Metrics {
    registry: Registry,
    /// Number of slots.
    slots: Gauge,
    busy: Gauge,
    /// 1 while a session is open, else 0.
    pub connected: Gauge,
    /// Number of sessions opened.
    pub sessions: Counter,
    /// Number of tasks computed.
    tasks: Counter,
    assignment_seconds: Histogram,
    /// Number of repeated deliveries.
    pub retries: Counter,
    results: Family<Label, Counter>,
}

impl Metrics {
    pub fn new(slots: usize) -> Self {
        let mut registry = Registry::with_prefix("evogait_worker");
        let metrics = Self {
            slots: Gauge::default(),
            busy: Gauge::default(),
            connected: Gauge::default(),
            sessions: Counter::default(),
            tasks: Counter::default(),
            assignment_seconds: Histogram::new(exponential_buckets(0.001, 4.0, 12)),
            retries: Counter::default(),
            results: Family::default(),
            registry: Registry::default(),
        };
        metrics.slots.set(slots as i64);
        let r = &mut registry;
        r.register("slots", "Number of slots", metrics.slots.clone());
        r.register("slots_busy", "Number of slots with an assignment", metrics.busy.clone());
        r.register("connected", "1 while the coordinator is connected", metrics.connected.clone());
        r.register("sessions", "Sessions opened", metrics.sessions.clone());
        r.register("tasks", "Tasks computed", metrics.tasks.clone());
        let seconds = metrics.assignment_seconds.clone();
        r.register_with_unit("assignment", "Time that an assignment occupied its slot", Unit::Seconds, seconds);
        r.register("delivery_retries", "Repeated deliveries of results", metrics.retries.clone());
        r.register("results", "Results delivered, by the coordinator's answer", metrics.results.clone());
        let build = Family::<Label, Gauge>::default();
        build.get_or_create(&[("version", env!("CARGO_PKG_VERSION"))]).set(1);
        r.register("build_info", "Version of this build", build);
        for verdict in [
            Verdict::Accepted,
            Verdict::Duplicate,
            Verdict::Conflict,
            Verdict::Obsolete,
            Verdict::Unknown,
            Verdict::Quarantined,
            Verdict::NeedsTasks,
        ] {
            metrics.results.get_or_create_owned(&[("verdict", word(verdict))]);
        }
        Self { registry, ..metrics }
    }

    /// Counts a finished assignment.
    pub fn worked(&self, finished: &Finished) {
        self.assignment_seconds.observe(Duration::from_micros(finished.compute_us).as_secs_f64());
        if let Outcome::Results(done) = &finished.outcome {
            self.tasks.inc_by(done.results.len() as u64);
        }
    }

    /// Counts an answer of the coordinator.
    pub fn result(&self, verdict: Verdict) {
        self.results.get_or_create(&[("verdict", word(verdict))]).inc();
    }
}

/// Returns the label of an answer.
fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Unspecified => "unspecified",
        Verdict::Accepted => "accepted",
        Verdict::Duplicate => "duplicate",
        Verdict::Conflict => "conflict",
        Verdict::Obsolete => "obsolete",
        Verdict::Unknown => "unknown",
        Verdict::Quarantined => "quarantined",
        Verdict::NeedsTasks => "needs_tasks",
    }
}

/// State of the worker for `/metrics` and `/healthz`.
pub(crate) struct WorkerVitals {
    pub metrics: Arc<Metrics>,
    pub assignments: Arc<Assignments>,
}

impl Vitals for WorkerVitals {
    fn metrics(&self) -> Answer<'_, String> {
        let metrics = &self.metrics;
        let held = self.assignments.ids().len() as i64;
        metrics.busy.set(held.min(metrics.slots.get()));
        let mut text = String::new();
        // Writing to a string can't fail.
        let _ = encode(&mut text, &metrics.registry);
        Box::pin(std::future::ready(text))
    }

    /// Reports every running worker as healthy, also while it waits for its coordinator.
    fn health(&self) -> Answer<'_, Result<String, String>> {
        let connected = self.metrics.connected.get() == 1;
        let text = if connected { "connected" } else { "waiting for the coordinator" };
        Box::pin(std::future::ready(Ok(text.to_owned())))
    }
}
