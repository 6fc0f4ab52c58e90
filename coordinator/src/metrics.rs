//! Prometheus metrics of the coordinator. Counters change when events occur; gauges are set when the metrics are read.

use crate::record::{JobState, Ruling};
use crate::scheduler::{Census, LeaseEnd, Verdict};
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::registry::{Registry, Unit};
use sim_core::base::digest::Digest;

type Label = [(&'static str, &'static str); 1];
type Labels = [(&'static str, String); 2];

/// All metrics of the coordinator.
pub(crate) struct Metrics {
    registry: Registry,
    jobs: Family<Label, Gauge>,
    jobs_ended: Family<Label, Counter>,
    /// Rounds sealed.
    pub rounds: Counter,
    tasks: Family<Label, Counter>,
    round_tasks: Family<Label, Gauge>,
    slots: Gauge,
    busy: Gauge,
    workers: Family<Label, Gauge>,
    /// Workers that crashed or fell silent.
    pub workers_lost: Counter,
    leases_ended: Family<Label, Counter>,
    disputes: Family<Label, Counter>,
    /// Refused deliveries that were counted against a worker.
    pub marks: Counter,
    /// Quarantined workers.
    pub quarantines: Counter,
    results: Family<Label, Counter>,
    /// Tasks charged with a crash or a failure.
    pub attempts: Counter,
    /// Time of a commit, s.
    pub commit_seconds: Histogram,
    /// Number of changes in a commit.
    pub commit_writes: Histogram,
    /// Time from a round's start to its seal, s.
    pub round_seconds: Histogram,
    queue: Gauge,
    /// Connections to the port for clients and workers.
    pub connections: Gauge,
    /// Commits that failed.
    pub store_errors: Counter,
    /// Number of this start on the store; 0 while standing by.
    pub epoch: Gauge,
    active: Gauge,
    engines: Family<Labels, Gauge>,
}

impl Metrics {
    pub fn new() -> Self {
        let mut metrics = Self {
            registry: Registry::with_prefix("evogait"),
            jobs: Family::default(),
            jobs_ended: Family::default(),
            rounds: Counter::default(),
            tasks: Family::default(),
            round_tasks: Family::default(),
            slots: Gauge::default(),
            busy: Gauge::default(),
            workers: Family::default(),
            workers_lost: Counter::default(),
            leases_ended: Family::default(),
            disputes: Family::default(),
            marks: Counter::default(),
            quarantines: Counter::default(),
            results: Family::default(),
            attempts: Counter::default(),
            commit_seconds: Histogram::new(exponential_buckets(0.0001, 2.0, 16)),
            commit_writes: Histogram::new(exponential_buckets(1.0, 2.0, 10)),
            round_seconds: Histogram::new(exponential_buckets(0.001, 4.0, 12)),
            queue: Gauge::default(),
            connections: Gauge::default(),
            store_errors: Counter::default(),
            epoch: Gauge::default(),
            active: Gauge::default(),
            engines: Family::default(),
        };
        metrics.register();
        metrics.start_from_zero();
        metrics
    }

    fn register(&mut self) {
        let r = &mut self.registry;
        r.register("jobs", "Jobs that have not ended", self.jobs.clone());
        r.register("jobs_ended", "Jobs that ended since the start of this coordinator", self.jobs_ended.clone());
        r.register("rounds_sealed", "Rounds sealed", self.rounds.clone());
        r.register("tasks", "Tasks with committed results, by phase of their round", self.tasks.clone());
        r.register("round_tasks", "Tasks of the current rounds that are not done, by state", self.round_tasks.clone());
        r.register("slots", "Slots of the workers that accept tasks", self.slots.clone());
        r.register("slots_busy", "Slots with a running task", self.busy.clone());
        r.register("workers", "Workers, by state", self.workers.clone());
        r.register("workers_lost", "Workers that crashed or fell silent", self.workers_lost.clone());
        r.register("leases_ended", "Leases that ended without a result, by reason", self.leases_ended.clone());
        r.register(
            "disputes",
            "Tasks with different results from different workers, by verdict",
            self.disputes.clone(),
        );
        r.register("marks", "Refused deliveries that were counted against a worker", self.marks.clone());
        r.register("quarantines", "Workers that were quarantined", self.quarantines.clone());
        r.register("results", "Delivered results, by verdict", self.results.clone());
        r.register("attempts", "Tasks charged with a crash or a failure", self.attempts.clone());
        r.register_with_unit("commit", "Time of a commit", Unit::Seconds, self.commit_seconds.clone());
        r.register("commit_writes", "Changes committed together", self.commit_writes.clone());
        let round = self.round_seconds.clone();
        r.register_with_unit("round", "Time from a round's start to its seal", Unit::Seconds, round);
        r.register("queue_length", "Commands waiting for the actor", self.queue.clone());
        r.register("connections", "Connections of clients and workers", self.connections.clone());
        r.register("store_errors", "Commits that failed", self.store_errors.clone());
        r.register("epoch", "Number of this start on the store; 0 while standing by", self.epoch.clone());
        r.register("active", "1 for the active coordinator, 0 while standing by", self.active.clone());
        r.register("engine_info", "Engines of this build, with their digests", self.engines.clone());
        let build = Family::<Label, Gauge>::default();
        build.get_or_create(&[("version", env!("CARGO_PKG_VERSION"))]).set(1);
        r.register("build_info", "Version of this build", build);
    }

    /// Creates all series with value 0: Prometheus does not see the first increment of a series that did not exist
    /// before.
    fn start_from_zero(&self) {
        for state in JobState::ALL {
            if state.is_end() {
                self.jobs_ended.get_or_create_owned(&[("state", state.word())]);
            } else {
                self.jobs.get_or_create_owned(&[("state", state.word())]);
            }
        }
        for phase in PHASES {
            self.tasks.get_or_create_owned(&[("phase", phase)]);
        }
        for verdict in ["open", "upheld", "corrected", "tainted"] {
            self.disputes.get_or_create_owned(&[("verdict", verdict)]);
        }
        for why in LeaseEnd::ALL {
            self.leases_ended.get_or_create_owned(&[("why", why.word())]);
        }
        for verdict in Verdict::ALL.map(Verdict::word).into_iter().chain(["refused"]) {
            self.results.get_or_create_owned(&[("verdict", verdict)]);
        }
        self.tell(&Census::default());
    }

    /// Number of commits.
    #[cfg(test)]
    pub fn commits(&self) -> u64 {
        let text = self.text();
        let count = text.lines().find_map(|line| line.strip_prefix("evogait_commit_seconds_count "));
        count.expect("the histogram is registered").parse().expect("the count is an integer")
    }

    /// Counts a job that ended in this state.
    pub fn job_ended(&self, state: JobState) {
        self.jobs_ended.get_or_create(&[("state", state.word())]).inc();
    }

    /// Counts a lease that ended without a result.
    pub fn lease_ended(&self, why: LeaseEnd) {
        self.leases_ended.get_or_create(&[("why", why.word())]).inc();
    }

    /// Counts an opened or decided dispute.
    pub fn dispute(&self, ruling: Option<Ruling>) {
        self.disputes.get_or_create(&[("verdict", ruling.map_or("open", Ruling::word))]).inc();
    }

    /// Counts a result by its verdict.
    pub fn result(&self, verdict: &'static str) {
        self.results.get_or_create(&[("verdict", verdict)]).inc();
    }

    /// Counts tasks with committed results.
    pub fn tasks(&self, phase: &'static str, count: u32) {
        self.tasks.get_or_create(&[("phase", phase)]).inc_by(count.into());
    }

    /// Sets the engines of this build.
    pub fn engines(&self, engines: &[(&'static str, Digest)]) {
        for (name, digest) in engines {
            let labels = [("engine", (*name).to_owned()), ("digest", digest.to_string())];
            self.engines.get_or_create(&labels).set(1);
        }
    }

    /// Marks this coordinator as active.
    pub fn activate(&self) {
        self.active.set(1);
    }

    /// Sets the number of commands waiting for the actor.
    pub fn queued(&self, commands: usize) {
        self.queue.set(commands as i64);
    }

    /// Returns the metrics in Prometheus' text format.
    pub fn text(&self) -> String {
        let mut text = String::new();
        // Writing to a string can't fail.
        let _ = encode(&mut text, &self.registry);
        text
    }

    /// Sets the gauges from the scheduler's current state.
    pub fn tell(&self, census: &Census) {
        for state in JobState::ALL.into_iter().filter(|state| !state.is_end()) {
            let jobs = census.jobs.get(&state).copied().unwrap_or(0);
            self.jobs.get_or_create(&[("state", state.word())]).set(jobs.into());
        }
        for (state, count) in [("pending", census.pending), ("leased", census.leased)] {
            self.round_tasks.get_or_create(&[("state", state)]).set(count as i64);
        }
        let workers = [
            ("ready", census.ready),
            ("draining", census.draining),
            ("quarantined", census.quarantined),
            ("stuck", census.stuck),
            ("disconnected", census.disconnected),
        ];
        for (state, count) in workers {
            self.workers.get_or_create(&[("state", state)]).set(count as i64);
        }
        self.slots.set(census.slots as i64);
        self.busy.set(census.busy as i64);
    }
}

/// Phases of the built-in procedures.
const PHASES: [&str; 4] = ["preparing", "searching", "finishing", "reporting"];
