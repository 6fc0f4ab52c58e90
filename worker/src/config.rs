//! Configuration of a worker.

use crate::error::{BadTime, Error};
use crate::limits::MARGIN;
use proto::credentials::Credentials;
use proto::dial::Dial;
use proto::limits::{MAX_SLOTS, MAX_TIME, MAX_WORKER_NAME};
use std::time::Duration;

/// Default of [`Config::grace`].
pub const DEFAULT_GRACE: Duration = Duration::from_secs(10);
/// Default of [`Config::stuck_after`].
pub const DEFAULT_STUCK_AFTER: Duration = Duration::from_secs(600);
/// Least value of [`Config::stuck_after`], because a batch of rollouts takes some time.
pub const MIN_STUCK_AFTER: Duration = Duration::from_secs(1);
/// Default of [`Config::keepalive`].
pub const DEFAULT_KEEPALIVE: Duration = Duration::from_secs(10);
/// Least value of [`Config::keepalive`].
pub const MIN_KEEPALIVE: Duration = Duration::from_millis(100);

/// Configuration of a worker.
#[derive(Clone, Debug)]
pub struct Config {
    /// URL of the coordinator, such as `http://127.0.0.1:7077`; URLs of a coordinator and its standbys are separated by
    /// commas.
    pub coordinator: String,
    /// Credentials for the coordinator.
    pub credentials: Credentials,
    /// Number of assignments computed at the same time, 1 to 4096; one thread each.
    pub slots: usize,
    /// Name shown to people, up to 256 bytes; see [`default_name`].
    pub name: String,
    /// Time to finish running tasks after a request to stop; after it the leases are returned. 0 to 366 days.
    pub grace: Duration,
    /// Wall time left to the process, as a batch system gives it: the worker drains and ends before it is up. Must be
    /// more than the grace time plus [`MARGIN`](crate::limits::MARGIN).
    pub time_left: Option<Duration>,
    /// Time without a finished batch of rollouts after which a slot is stuck: 1 s to 366 days.
    pub stuck_after: Duration,
    /// Address of the metrics pages; `None` for no pages.
    pub metrics: Option<telemetry::Bind>,
    /// Time between checks of an idle connection, and time limit for the answer: 0.1 s to 366 days.
    pub keepalive: Duration,
}

impl Config {
    /// Creates a configuration with defaults for everything else.
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

/// Returns host and process id, such as `node7:4711`.
pub fn default_name() -> String {
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let host = match host.trim() {
        "" => "worker",
        host => host,
    };
    format!("{host}:{}", std::process::id())
}

/// Returns the number of cores that the system gives this process.
pub fn default_slots() -> usize {
    std::thread::available_parallelism().map_or(1, |n| n.get())
}
