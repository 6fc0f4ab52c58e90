//! Worker: receives tasks from a coordinator, computes them on its cores and delivers their results.
//!
//! `session` keeps the connection, `intake` accepts assignments, `assignments` records them, `slots` are the computing
//! threads, `watchdog` finds stuck slots, `delivery` sends results. Computing continues while the coordinator can't be
//! reached.

mod assignments;
mod config;
mod delivery;
mod engines;
mod error;
#[cfg(any(debug_assertions, feature = "faults"))]
mod fault;
mod hangup;
mod intake;
mod jobs;
pub mod limits;
mod metrics;
mod session;
mod slots;
mod watchdog;
mod work;

pub use config::{Config, default_name, default_slots};
pub use error::{BadTime, Error};
pub use hangup::Hangup;

use assignments::Assignments;
use delivery::Courier;
use engines::Engines;
use intake::Intake;
use jobs::Jobs;
use limits::{DELIVER_WITHIN, LAST_WORDS, MARGIN, MAX_STUCK};
use metrics::{Metrics, WorkerVitals};
use session::{Session, Stage};
use slots::Slots;
use std::hash::{BuildHasher as _, RandomState};
use std::pin::Pin;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::{mpsc, watch};
use tokio::time::timeout;
use watchdog::Watchdog;

/// Runs a worker until `drain` resolves or its time is nearly up. Then it accepts no new tasks, finishes what it can
/// within the grace time, returns the remaining leases, and ends. It waits for a coordinator that can't be reached, at
/// the start and later.
pub async fn run(config: Config, drain: impl Future<Output = ()> + Send) -> Result<(), Error> {
    run_until(config, drain, std::future::pending()).await
}

/// Runs a worker like [`run`]; when `at_once` resolves, the grace time ends.
pub async fn run_until(
    config: Config,
    drain: impl Future<Output = ()> + Send,
    at_once: impl Future<Output = ()> + Send,
) -> Result<(), Error> {
    work_until(config, Box::pin(drain), Box::pin(at_once)).await
}

type Boxed<'a, T> = Pin<Box<dyn Future<Output = T> + Send + 'a>>;

// Boxed, so that it is compiled once in this crate and not in every crate that awaits it.
fn work_until<'a>(config: Config, drain: Boxed<'a, ()>, at_once: Boxed<'a, ()>) -> Boxed<'a, Result<(), Error>> {
    Box::pin(work(config, drain, at_once))
}

async fn work(config: Config, drain: Boxed<'_, ()>, at_once: Boxed<'_, ()>) -> Result<(), Error> {
    config.check()?;
    #[cfg(any(debug_assertions, feature = "faults"))]
    fault::check().map_err(Error::System)?;
    let end = config.time_left.map(|left| Instant::now() + left);
    let dial = config.dial()?;
    let assignments = Arc::new(Assignments::default());
    let metrics = Arc::new(Metrics::new(config.slots));
    let pulse = Arc::new(WorkerVitals { metrics: metrics.clone(), assignments: assignments.clone() });
    // The endpoint serves as long as this value lives: until the worker ends.
    let _served = match config.metrics {
        Some(bind) => Some(telemetry::Endpoint::start(bind, pulse).await?),
        None => None,
    };
    let engines = tokio::task::spawn_blocking(Engines::measure).await.map_err(|e| Error::System(e.to_string()))?;
    let id = unique_id();
    let (done, finished) = mpsc::unbounded_channel();
    let queue = Slots::start(config.slots, done).map_err(|e| Error::System(e.to_string()))?;
    let courier = Courier::new(dial.channel(), id.clone(), assignments.clone(), metrics.clone());
    let delivering = tokio::spawn(courier.run(finished));
    let (stage, stages) = watch::channel(Stage::Working);
    let mut session = Session {
        way: dial.channel(),
        id,
        name: config.name.clone(),
        slots: config.slots as u32,
        end,
        stuck_after: config.stuck_after,
        intake: Intake {
            engines: Arc::new(engines),
            assignments: assignments.clone(),
            queue: queue.clone(),
            jobs: Jobs::default(),
            waiting: Vec::new(),
        },
        metrics,
        stage: stages,
    };

    let outcome = {
        let watching = watch_slots(&assignments, &queue, config.stuck_after);
        let mut keeping = std::pin::pin!(session.keep());
        tokio::select! {
            refused = &mut keeping => {
                // The coordinator may still accept finished results.
                assignments.stop_computing();
                let _ = timeout(DELIVER_WITHIN, assignments.none_left()).await;
                refused
            }
            left = leave(&config, &assignments, &stage, (drain, at_once, watching), end) => {
                // The coordinator may be unreachable, so the last messages have a time limit.
                let _ = timeout(LAST_WORDS, &mut keeping).await;
                left
            }
        }
    };
    // The threads check the flag after every batch of rollouts.
    assignments.stop_all();
    delivering.abort();
    outcome
}

/// Waits for a reason to stop, drains the worker, and returns when no assignment is left, or when the grace time and the
/// time to deliver are over.
async fn leave(
    config: &Config,
    assignments: &Assignments,
    stage: &watch::Sender<Stage>,
    (drain, at_once, watching): (impl Future<Output = ()>, impl Future<Output = ()>, impl Future<Output = usize>),
    end: Option<Instant>,
) -> Result<(), Error> {
    let nearly_up = async {
        match end {
            Some(end) => tokio::time::sleep_until((end - config.grace - MARGIN).into()).await,
            None => std::future::pending().await,
        }
    };
    let (reason, outcome) = tokio::select! {
        () = drain => ("it received a request to stop", Ok(())),
        () = nearly_up => ("its time is nearly up", Ok(())),
        stuck = watching => ("too many of its slots are stuck", Err(Error::Stuck { stuck, after: config.stuck_after })),
    };
    let grace = config.grace.as_secs_f64();
    tracing::info!(reason, running = assignments.computing().len(), grace_s = grace, "draining");
    stage.send_replace(Stage::Draining(reason));
    let mut at_once = std::pin::pin!(at_once);
    let hurried = tokio::select! {
        // Leases of unfinished tasks are returned after the grace time.
        _ = timeout(config.grace, assignments.none_left()) => false,
        () = &mut at_once => true,
    };
    assignments.stop_computing();
    stage.send_replace(Stage::Draining(reason));
    let delivered = tokio::select! {
        delivered = timeout(DELIVER_WITHIN, assignments.none_left()), if !hurried => delivered.is_ok(),
        () = &mut at_once, if !hurried => false,
        else => assignments.ids().is_empty(),
    };
    if !delivered {
        tracing::warn!("some results could not be delivered: other workers will compute their tasks again");
    }
    assignments.stop_all();
    stage.send_replace(Stage::Leaving);
    outcome
}

/// Replaces stuck slots. Returns their number once it reaches [`MAX_STUCK`].
async fn watch_slots(assignments: &Assignments, queue: &Slots, stuck_after: Duration) -> usize {
    let mut watchdog = Watchdog::default();
    let mut looks = tokio::time::interval(Watchdog::period(stuck_after));
    looks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    loop {
        looks.tick().await;
        let in_hand = assignments.in_hand();
        for id in watchdog.look(in_hand.iter().map(|a| (a.id, a.progress()))) {
            let Some(assignment) = in_hand.iter().find(|a| a.id == id) else { continue };
            let stuck = queue.replace(assignment, stuck_after);
            tracing::error!(
                assignment = id,
                job = assignment.job_id,
                stuck,
                "a slot is stuck: a new thread replaces it"
            );
            if stuck >= MAX_STUCK {
                return stuck;
            }
        }
    }
}

/// Returns a random id, unique to this worker and kept over reconnects. No result depends on it.
fn unique_id() -> String {
    let random = || RandomState::new().hash_one(std::process::id());
    format!("{:016x}{:016x}", random(), random())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::dial::DialError;
    use proto::limits::MAX_SLOTS;

    #[tokio::test]
    async fn invalid_configuration_is_refused_before_start() {
        let config = |coordinator: &str, slots| Config::new(coordinator.to_owned(), slots);
        let run = |config| run(config, std::future::pending());
        for url in ["", "127.0.0.1:7077", "http://", "sqlite:x"] {
            assert!(matches!(run(config(url, 1)).await, Err(Error::Address(_))), "{url}");
        }
        let unbelieved = run(config("https://127.0.0.1:7077", 1)).await;
        assert!(matches!(unbelieved, Err(Error::Dial(DialError::NoAuthority { .. }))));
        let url = "http://127.0.0.1:1";
        for slots in [0, MAX_SLOTS as usize + 1] {
            assert!(matches!(run(config(url, slots)).await, Err(Error::Slots { .. })));
        }
        let grace = Duration::from_secs(10);
        let time_left = Some(grace + MARGIN);
        for (config, word) in [
            (Config { grace, time_left, ..config(url, 1) }, "--time-left"),
            (Config { grace: Duration::MAX, ..config(url, 1) }, "--grace"),
            (Config { stuck_after: Duration::ZERO, ..config(url, 1) }, "--stuck-after"),
        ] {
            let error = run(config).await.unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
    }

    #[tokio::test]
    async fn drained_worker_without_coordinator_ends_without_error() {
        let config = Config::new("http://127.0.0.1:1".to_owned(), 1);
        let drain = tokio::time::sleep(Duration::from_millis(50));
        let ended = timeout(Duration::from_secs(5), run(config, drain)).await;
        assert!(matches!(ended, Ok(Ok(()))), "{ended:?}");
    }

    #[test]
    fn unique_ids_differ() {
        assert_ne!(unique_id(), unique_id());
    }
}
