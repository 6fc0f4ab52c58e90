//! Limits of a coordinator, in addition to those of the protocol (`proto::limits`).

use std::time::Duration;

/// Limit on active jobs: jobs that have not ended.
pub const MAX_ACTIVE_JOBS: usize = 1000;
/// Shortest allowed lease.
pub const MIN_LEASE: Duration = Duration::from_millis(100);
/// Longest allowed lease.
pub const MAX_LEASE: Duration = Duration::from_secs(3600);
/// Default lease.
pub const DEFAULT_LEASE: Duration = Duration::from_secs(15);
/// Default takeover time: another coordinator may take over from one that has not reached a shared store for this long.
pub const DEFAULT_TAKEOVER: Duration = Duration::from_secs(5);
/// Shortest allowed takeover time.
pub const MIN_TAKEOVER: Duration = Duration::from_millis(500);
/// Longest allowed takeover time.
pub const MAX_TAKEOVER: Duration = Duration::from_secs(600);
/// Limit on the time between the start of a session and its Hello.
pub const HELLO_WITHIN: Duration = Duration::from_secs(10);
/// Limit on commands handled together, and so on results committed together.
pub const GROUP: usize = 256;
/// Limit on events read from the store in one query.
pub const EVENTS_AT_ONCE: u32 = 256;
/// Limit on events that a watcher may lag behind; beyond it, the watcher reads from the store.
pub const LIVE_EVENTS: usize = 128;
/// Limit on the time that open calls have to end when the coordinator stops.
pub const STOP_WITHIN: Duration = Duration::from_secs(3);
/// Limit on the time between a change of the demand and the message to KEDA.
pub const DEMAND_EVERY: Duration = Duration::from_secs(2);
/// Limit on concurrent streams and calls of KEDA.
pub const MAX_SCALERS: usize = 16;
/// Limit on concurrent connections to the server for KEDA.
pub const MAX_SCALER_CONNECTIONS: usize = 64;
/// Interval of keep-alive checks on idle connections, and limit on the time for an answer. A connection with a lost
/// peer is closed within twice this time.
pub const KEEPALIVE: Duration = Duration::from_secs(10);
/// Limit on the actor's response time for metrics and health; beyond it the coordinator is unhealthy.
pub const CENSUS_WITHIN: Duration = Duration::from_secs(3);
/// Limit on leased ranges in a job's details.
pub const MAX_HELD_TOLD: usize = 100;
/// Number of rounds from which a job's median time per round is computed.
pub const PACE_OVER: u32 = 20;
/// Limit on concurrent connections: two per worker, and some for clients.
pub const MAX_CONNECTIONS: usize = 2 * MAX_SESSIONS + 12_768;
/// Limit on connections from one address (for IPv6, from one /64 network, which a single machine may own). A cluster
/// behind NAT has one address.
pub const MAX_CONNECTIONS_OF_ADDRESS: usize = 2 * MAX_SESSIONS + 4576;
/// Limit on unauthenticated connections if calls require tokens: connections without a permitted call.
pub const MAX_UNAUTHENTICATED: usize = 1024;
/// Limit on unauthenticated connections from one address.
pub const MAX_UNAUTHENTICATED_OF_ADDRESS: usize = 256;
/// Limit on the time that a connection may stay unauthenticated.
pub const AUTHENTICATE_WITHIN: Duration = Duration::from_secs(30);
/// Limit on the time of a TLS handshake.
pub const HANDSHAKE_WITHIN: Duration = Duration::from_secs(10);
/// Limit on concurrent calls on one connection; more calls wait.
pub const MAX_CALLS_OF_CONNECTION: u32 = 256;
/// Limit on the headers of a request, bytes.
pub const MAX_HEADERS: u32 = 16 * 1024;
/// Limit on a client's request, bytes: a job and its envelope.
pub const MAX_CLIENT_REQUEST: usize = proto::limits::MAX_JOB_TOML + 64 * 1024;
/// Limit on concurrent event streams.
pub const MAX_WATCHERS: usize = 4096;
/// Limit on concurrent worker sessions before Hello.
pub const MAX_HELLOS: usize = 1024;
/// Limit on concurrent worker sessions.
pub const MAX_SESSIONS: usize = 10_000;
/// Limit on jobs that are parsed and validated concurrently; more jobs wait.
pub const MAX_READINGS: usize = 4;
/// Limit on stored quarantined workers; beyond it the oldest entry is removed.
pub const MAX_QUARANTINED: usize = 10_000;
/// Limit on sealed rounds read from the store in one query.
pub const ROUNDS_AT_ONCE: u32 = 64;
/// Limit on states in the filter of a job list.
pub const MAX_STATES: usize = 64;
/// Limit on running assignments that a worker may report. A worker has at most two per slot.
pub const MAX_RUNNING: usize = 4 * proto::limits::MAX_SLOTS as usize;
