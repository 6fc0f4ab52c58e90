//! Errors of a worker.

use crate::limits::MARGIN;
use proto::credentials::CredentialError;
use proto::dial::{BadAddress, DialError};
use proto::limits::{MAX_SLOTS, MAX_WORKER_NAME};
use std::time::Duration;

/// Reason why a worker does not start, or ended.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Invalid address of a coordinator.
    #[error(transparent)]
    Address(#[from] BadAddress),
    /// Invalid or unreadable credentials.
    #[error(transparent)]
    Credentials(#[from] CredentialError),
    /// Credentials that do not fit the address.
    #[error(transparent)]
    Dial(#[from] DialError),
    /// Number of slots out of range.
    #[error("--slots {slots} is out of range: 1 to {MAX_SLOTS} are allowed")]
    Slots {
        /// Given number of slots.
        slots: usize,
    },
    /// Name longer than the limit.
    #[error("the worker's name has {length} bytes: at most {MAX_WORKER_NAME} are allowed; give a shorter --name")]
    Name {
        /// Length of the name in bytes.
        length: usize,
    },
    /// Refusal by the coordinator. Not retryable with the same build and credentials.
    #[error("the coordinator at {url} refuses this worker: {reason}")]
    Refused {
        /// URL of the coordinator.
        url: String,
        /// Message of the coordinator.
        reason: String,
    },
    /// Invalid time option.
    #[error(transparent)]
    Time(#[from] BadTime),
    /// Too many stuck slots. Start the worker again, if the machine is sound.
    #[error(
        "{stuck} slots made no progress for {} s each: the machine or the jobs are faulty; the worker returned its \
         leases and ends",
        .after.as_secs_f64()
    )]
    Stuck {
        /// Number of stuck slots.
        stuck: usize,
        /// Time without progress after which a slot is stuck.
        after: Duration,
    },
    /// Address of the metrics pages that can't be used.
    #[error(transparent)]
    Metrics(#[from] telemetry::BindError),
    /// Failure of the operating system, such as a thread that can't be started.
    #[error("the worker can't start: {0}")]
    System(String),
}

/// Error of a time option.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BadTime {
    /// Time out of range.
    #[error("{option} {} is out of range: {} s to {} s are allowed", .given.as_secs_f64(), .least.as_secs_f64(), .most.as_secs_f64())]
    Range {
        /// Name of the option.
        option: &'static str,
        /// Given time.
        given: Duration,
        /// Least allowed time.
        least: Duration,
        /// Greatest allowed time.
        most: Duration,
    },
    /// Remaining time too short: the worker would have to drain before it starts.
    #[error(
        "--time-left {} is too short: it must be more than the grace time ({} s) plus {} s to end; give more time, or a \
         shorter --grace", .left.as_secs_f64(), .grace.as_secs_f64(), MARGIN.as_secs_f64()
    )]
    Left {
        /// Given time.
        left: Duration,
        /// Grace time.
        grace: Duration,
    },
}
