//! Configuration of a worker.

use crate::error::{BadTime, Error};
use crate::limits::MARGIN;
use proto::credentials::Credentials;
use proto::dial::Dial;
use proto::limits::{MAX_SLOTS, MAX_TIME, MAX_WORKER_NAME};
use std::time::Duration;

/// Time to finish what runs, unless another is given.
pub const DEFAULT_GRACE: Duration = Duration::from_secs(10);
/// A slot without progress for this long is stuck, unless another time is given.
pub const DEFAULT_STUCK_AFTER: Duration = Duration::from_secs(600);
/// Shortest time after which a slot can be called stuck: a batch of rollouts takes a while.
pub const MIN_STUCK_AFTER: Duration = Duration::from_secs(1);
/// Default time between checks of an idle connection, and for the answer.
pub const DEFAULT_KEEPALIVE: Duration = Duration::from_secs(10);
/// Shortest time between two checks of a connection.
pub const MIN_KEEPALIVE: Duration = Duration::from_millis(100);

/// Configuration of a worker.
#[derive(Clone, Debug)]
pub struct Config {
    /// The coordinator's URL, such as `http://127.0.0.1:7077`; those of several that stand in for each other are separated
    /// by commas.
    pub coordinator: String,
    /// Credentials for the coordinator.
    pub credentials: Credentials,
    /// Evaluations at once, 1 to 4096. One thread each.
    pub slots: usize,
    /// For people, up to 256 bytes; see [`default_name`].
    pub name: String,
    /// When told to stop, what runs has this long to be finished; then it is given back. 0 to 366 days.
    pub grace: Duration,
    /// Wall time that is left to the process, as a batch system gives it: the worker drains and ends before it. More than
    /// the grace time and [`MARGIN`](crate::limits::MARGIN).
    pub time_left: Option<Duration>,
    /// A slot that ends no batch of rollouts for this long is stuck: 1 s to 366 days.
    pub stuck_after: Duration,
    /// Address of the metrics pages, if they are wanted.
    pub metrics: Option<telemetry::Bind>,
    /// Time between checks of an idle connection, and for the answer: 0.1 s to 366 days.
    pub keepalive: Duration,
}

impl Config {
    /// A worker with everything else as it is by default.
    pub fn new(coordinator: String, slots: usize) -> Self {
        Self {
            coordinator,
            credentials: Credentials::default(),
            slots,
            name: default_name(),
            grace: DEFAULT_GRACE,
            time_left: None,
            stuck_after: DEFAULT_STUCK_AFTER,
            metrics: None,
            keepalive: DEFAULT_KEEPALIVE,
        }
    }

    pub(crate) fn check(&self) -> Result<(), Error> {
        if self.slots == 0 || self.slots > MAX_SLOTS as usize {
            return Err(Error::Slots { slots: self.slots });
        }
        if self.name.len() > MAX_WORKER_NAME {
            return Err(Error::Name { length: self.name.len() });
        }
        let in_range = |option, given: Duration, least| match (least..=MAX_TIME).contains(&given) {
            true => Ok(()),
            false => Err(BadTime::Range { option, given, least, most: MAX_TIME }),
        };
        in_range("--grace", self.grace, Duration::ZERO)?;
        in_range("--stuck-after", self.stuck_after, MIN_STUCK_AFTER)?;
        in_range("--keepalive", self.keepalive, MIN_KEEPALIVE)?;
        if let Some(left) = self.time_left {
            in_range("--time-left", left, Duration::ZERO)?;
            if left <= self.grace + MARGIN {
                return Err(BadTime::Left { left, grace: self.grace }.into());
            }
        }
        Ok(())
    }

    pub(crate) fn dial(&self) -> Result<Dial, Error> {
        Ok(Dial::new(self.coordinator.parse()?, &self.credentials)?.keepalive(self.keepalive))
    }
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
