//! Limits of the protocol. The error of a value beyond a limit names the limit.

/// Largest message in either direction, in bytes.
pub const MAX_MESSAGE: usize = 64 * 1024 * 1024;
/// Largest answer to a client, in bytes: a result contains the report of a whole job.
pub const MAX_ANSWER: usize = 1 << 30;
/// Longest job as TOML, in bytes.
pub const MAX_JOB_TOML: usize = sim_core::base::limits::MAX_TOML_LENGTH;
/// Longest request id, in bytes.
pub const MAX_REQUEST_ID: usize = 64;
/// Longest id of a job or worker, in bytes.
pub const MAX_ID: usize = 64;
/// Longest name of a worker, and longest version, in bytes.
pub const MAX_WORKER_NAME: usize = 256;
/// Longest reason of a failure, in bytes; longer ones are cut.
pub const MAX_REASON: usize = 4096;
/// Largest number of slots of a worker.
pub const MAX_SLOTS: u32 = 4096;
/// Longest time that a worker may report: until its machine goes away, or until a slot is stuck.
pub const MAX_TIME: std::time::Duration = std::time::Duration::from_secs(366 * 24 * 3600);
/// Largest number of engine digests of a worker.
pub const MAX_ENGINES: usize = 64;
/// Largest number of jobs in a page of a list.
pub const MAX_PAGE: u32 = 1000;
/// Number of jobs in a page if the client gives none.
pub const DEFAULT_PAGE: u32 = 100;
/// Greatest priority of a job; the least is 1.
pub const MAX_PRIORITY: u32 = 100;
/// Priority of a job if the client gives none.
pub const DEFAULT_PRIORITY: u32 = 10;
