//! Limits of a coordinator, beside those of the protocol (`proto::limits`).

use std::time::Duration;

/// Most jobs that have not ended.
pub const MAX_ACTIVE_JOBS: usize = 1000;
/// Shortest lease that can be asked for.
pub const MIN_LEASE: Duration = Duration::from_millis(100);
/// Longest lease that can be asked for.
pub const MAX_LEASE: Duration = Duration::from_secs(3600);
/// Lease unless another is asked for.
pub const DEFAULT_LEASE: Duration = Duration::from_secs(15);
/// A connection has this long to say Hello.
pub const HELLO_WITHIN: Duration = Duration::from_secs(10);
/// Commands handled in one go, and so results committed together.
pub const GROUP: usize = 256;
/// Events read from the store at once.
pub const EVENTS_AT_ONCE: u32 = 256;
/// Events a watcher may lag behind before it has to read them from the store.
pub const LIVE_EVENTS: usize = 1024;
/// Open calls have this long to end when the coordinator stops.
pub const STOP_WITHIN: Duration = Duration::from_secs(3);
/// The actor has this long to answer whoever looks at the metrics; beyond it the coordinator is not well.
pub const CENSUS_WITHIN: Duration = Duration::from_secs(3);
/// Assignments that are told one by one of a job.
pub const MAX_HELD_TOLD: usize = 100;
/// Generations from which a job's pace is taken.
pub const PACE_OVER: u32 = 20;
