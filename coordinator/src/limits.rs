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
/// A coordinator out of touch with a store that several can reach is taken for dead after this long, unless another time is
/// asked for.
pub const DEFAULT_TAKEOVER: Duration = Duration::from_secs(5);
/// Shortest time to a takeover that can be asked for.
pub const MIN_TAKEOVER: Duration = Duration::from_millis(500);
/// Longest time to a takeover that can be asked for.
pub const MAX_TAKEOVER: Duration = Duration::from_secs(600);
/// A connection has this long to say Hello.
pub const HELLO_WITHIN: Duration = Duration::from_secs(10);
/// Commands handled in one go, and so results committed together.
pub const GROUP: usize = 256;
/// Events read from the store at once.
pub const EVENTS_AT_ONCE: u32 = 256;
/// Events of its job a watcher may lag behind before it has to read them from the store.
pub const LIVE_EVENTS: usize = 128;
/// Open calls have this long to end when the coordinator stops.
pub const STOP_WITHIN: Duration = Duration::from_secs(3);
/// KEDA is told of a change in demand within this time.
pub const DEMAND_EVERY: Duration = Duration::from_secs(2);
/// Streams and calls of KEDA at once.
pub const MAX_SCALERS: usize = 16;
/// Most connections at once to where KEDA is answered.
pub const MAX_SCALER_CONNECTIONS: usize = 64;
/// How often an idle connection is checked, and how long the other side has to answer: one whose other end is gone without a
/// word is closed within twice this.
pub const KEEPALIVE: Duration = Duration::from_secs(10);
/// The actor has this long to answer whoever looks at the metrics; beyond it the coordinator is not well.
pub const CENSUS_WITHIN: Duration = Duration::from_secs(3);
/// Assignments that are told one by one of a job.
pub const MAX_HELD_TOLD: usize = 100;
/// Rounds from which a job's pace is taken.
pub const PACE_OVER: u32 = 20;
/// Most connections at once: a worker has two, and clients have some.
pub const MAX_CONNECTIONS: usize = 2 * MAX_SESSIONS + 12_768;
/// Most connections from one address (of IPv6 from one network of 64 bits, which a single machine may have to itself): a
/// cluster behind NAT has one.
pub const MAX_CONNECTIONS_OF_ADDRESS: usize = 2 * MAX_SESSIONS + 4576;
/// Most connections on which no call was admitted yet, where calls need tokens.
pub const MAX_STRANGERS: usize = 1024;
/// Most of these from one address.
pub const MAX_STRANGERS_OF_ADDRESS: usize = 256;
/// A connection on which no call is admitted for this long is closed.
pub const STRANGER_WITHIN: Duration = Duration::from_secs(30);
/// A TLS handshake takes at most this long.
pub const HANDSHAKE_WITHIN: Duration = Duration::from_secs(10);
/// Most calls at once on one connection; more wait.
pub const MAX_CALLS_OF_CONNECTION: u32 = 256;
/// Largest headers of a request, in bytes.
pub const MAX_HEADERS: u32 = 16 * 1024;
/// Largest request of a client, in bytes: a job and what is around it.
pub const MAX_CLIENT_REQUEST: usize = proto::limits::MAX_JOB_TOML + 64 * 1024;
/// Most streams of events at once.
pub const MAX_WATCHERS: usize = 4096;
/// Most sessions at once that have not said Hello.
pub const MAX_HELLOS: usize = 1024;
/// Most sessions of workers at once.
pub const MAX_SESSIONS: usize = 10_000;
/// Most jobs that are being read at once; more wait.
pub const MAX_READINGS: usize = 4;
/// Most workers in quarantine that are remembered; beyond it the oldest entry goes.
pub const MAX_QUARANTINED: usize = 10_000;
/// Sealed rounds that are read from the store at once.
pub const ROUNDS_AT_ONCE: u32 = 64;
/// Most states that a list is asked for.
pub const MAX_STATES: usize = 64;
/// Most assignments that a worker may say it works on. It has at most two a slot.
pub const MAX_RUNNING: usize = 4 * proto::limits::MAX_SLOTS as usize;
