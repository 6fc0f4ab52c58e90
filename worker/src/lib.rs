//! The worker: pulls evaluations from a coordinator, runs them on its cores, reports.
//!
//! `session` keeps the connection, `assignments` knows what is being worked on, `slots` are the threads that compute,
//! `delivery` brings results home. Computing goes on while the coordinator can't be reached.

mod assignments;
mod backoff;
mod delivery;
mod engines;
mod jobs;
mod metrics;
mod session;
mod slots;
mod work;

use assignments::Assignments;
use delivery::Courier;
use engines::Engines;
use jobs::Jobs;
use metrics::{Metrics, Pulse};
use proto::limits::{MAX_SLOTS, MAX_WORKER_NAME};
use session::Session;
use slots::Slots;
use std::hash::{BuildHasher as _, RandomState};
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc;
use tonic::transport::Endpoint;

/// When told to stop, a worker has this long to say so and to deliver what is done.
const STOP_WITHIN: Duration = Duration::from_secs(5);

/// How a worker runs.
#[derive(Clone, Debug)]
pub struct Config {
    /// The coordinator's URL, such as `http://127.0.0.1:7077`.
    pub coordinator: String,
    /// Evaluations at once, 1 to 4096. One thread each.
    pub slots: usize,
    /// For people, up to 256 bytes; see [`default_name`].
    pub name: String,
    /// Where metrics are served, if at all.
    pub metrics: Option<telemetry::Bind>,
}

/// Why a worker does not start, or stopped.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Not a URL that can be connected to.
    #[error("'{url}' is no address of a coordinator: write http://HOST:PORT, such as http://127.0.0.1:7077")]
    BadAddress {
        /// What was given.
        url: String,
    },
    /// Slots out of range.
    #[error("{slots} slots are out of range: 1 to {MAX_SLOTS} are allowed")]
    Slots {
        /// What was given.
        slots: usize,
    },
    /// A name beyond the limit.
    #[error("the worker's name has {length} bytes: at most {MAX_WORKER_NAME} are allowed")]
    Name {
        /// Bytes it has.
        length: usize,
    },
    /// The coordinator refuses this worker. Not retryable with the same build.
    #[error("the coordinator at {url} refuses this worker: {reason}")]
    Refused {
        /// Which.
        url: String,
        /// What it says.
        reason: String,
    },
    /// Metrics can't be served as asked.
    #[error(transparent)]
    Metrics(#[from] telemetry::BindError),
    /// The system gives no thread, or another thing that the worker can't be without.
    #[error("the worker can't start: {0}")]
    System(String),
}

/// Host and process: `node7:4711`.
pub fn default_name() -> String {
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let host = match host.trim() {
        "" => "worker",
        host => host,
    };
    format!("{host}:{}", std::process::id())
}

/// As many slots as the system has cores for this process.
pub fn default_slots() -> usize {
    std::thread::available_parallelism().map_or(1, |n| n.get())
}

/// Works until `shutdown` resolves: then what runs is given back, what is done is delivered, and it ends. Waits for a
/// coordinator that is not there, and for one that went away.
pub async fn run(config: Config, shutdown: impl Future<Output = ()>) -> Result<(), Error> {
    let Config { coordinator: url, slots, name, metrics: bind } = config;
    if slots == 0 || slots > MAX_SLOTS as usize {
        return Err(Error::Slots { slots });
    }
    if name.len() > MAX_WORKER_NAME {
        return Err(Error::Name { length: name.len() });
    }
    let endpoint = endpoint(&url)?;
    let assignments = Arc::new(Assignments::default());
    let metrics = Arc::new(Metrics::new(slots));
    let pulse = Arc::new(Pulse { metrics: metrics.clone(), assignments: assignments.clone() });
    // Served until the worker ends.
    let _served = match bind {
        Some(bind) => Some(telemetry::Endpoint::start(bind, pulse).await?),
        None => None,
    };
    let engines = tokio::task::spawn_blocking(Engines::measure).await.map_err(|e| Error::System(e.to_string()))?;
    let id = unique_id();
    let (done, finished) = mpsc::unbounded_channel();
    let queue = Slots::start(slots, done).map_err(|e| Error::System(e.to_string()))?;
    let courier = Courier::new(endpoint.connect_lazy(), id.clone(), assignments.clone(), metrics.clone());
    let delivering = tokio::spawn(courier.clone().run(finished));

    let mut session = Session {
        url,
        endpoint,
        id,
        name,
        slots: slots as u32,
        engines: Arc::new(engines),
        assignments: assignments.clone(),
        jobs: Jobs::default(),
        queue,
        courier,
        metrics,
        said: None,
    };
    let outcome = tokio::select! {
        error = session.keep() => Err(error),
        () = shutdown => Ok(()),
    };
    // What runs is given back at once: the threads see the flag within a moment.
    assignments.stop_all();
    if outcome.is_ok() {
        session.say_drain().await;
    }
    drop(session);
    let delivered = tokio::time::timeout(STOP_WITHIN, delivering).await;
    if delivered.is_err() {
        tracing::warn!("some results could not be delivered: their evaluations will be done again elsewhere");
    }
    outcome
}

fn endpoint(url: &str) -> Result<Endpoint, Error> {
    let wrong = || Error::BadAddress { url: url.to_owned() };
    let endpoint = Endpoint::from_shared(url.to_owned()).map_err(|_| wrong())?;
    if endpoint.uri().scheme_str() != Some("http") || endpoint.uri().host().is_none() {
        return Err(wrong());
    }
    Ok(endpoint
        .connect_timeout(Duration::from_secs(5))
        .tcp_nodelay(true)
        .http2_keep_alive_interval(Duration::from_secs(10))
        .keep_alive_timeout(Duration::from_secs(10))
        .keep_alive_while_idle(true))
}

/// Tells this worker from all others, over reconnects. Has nothing to do with any result.
fn unique_id() -> String {
    let random = || RandomState::new().hash_one(std::process::id());
    format!("{:016x}{:016x}", random(), random())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn what_can_not_work_is_said_before_anything_starts() {
        let run = |coordinator: &str, slots| {
            run(
                Config { coordinator: coordinator.to_owned(), slots, name: "n".to_owned(), metrics: None },
                std::future::pending(),
            )
        };
        for url in ["", "127.0.0.1:7077", "https://127.0.0.1:7077", "http://", "sqlite:x"] {
            assert!(matches!(run(url, 1).await, Err(Error::BadAddress { .. })), "{url}");
        }
        for slots in [0, MAX_SLOTS as usize + 1] {
            assert!(matches!(run("http://127.0.0.1:1", slots).await, Err(Error::Slots { .. })));
        }
    }

    #[test]
    fn ids_differ() {
        assert_ne!(unique_id(), unique_id());
    }
}
