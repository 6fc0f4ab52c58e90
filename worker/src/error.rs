//! Errors of a worker.

use crate::limits::MARGIN;
use proto::credentials::CredentialError;
use proto::dial::{BadAddress, DialError};
use proto::limits::{MAX_SLOTS, MAX_WORKER_NAME};
use std::time::Duration;

/// Why a worker does not start, or stopped.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Not an address that can be connected to.
    #[error(transparent)]
    Address(#[from] BadAddress),
    /// Credentials that can't be read.
    #[error(transparent)]
    Credentials(#[from] CredentialError),
    /// Address and credentials do not go together.
    #[error(transparent)]
    Dial(#[from] DialError),
    /// Slots out of range.
    #[error("{slots} slots are out of range: 1 to {MAX_SLOTS} are allowed")]
    Slots {
        /// The given number.
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
        /// The address.
        url: String,
        /// Its message.
        reason: String,
    },
    /// A time that can't be kept to.
    #[error(transparent)]
    Time(#[from] BadTime),
    /// Slots got stuck, again and again. Start the worker again, if the machine is sound.
    #[error(
        "{stuck} slots made no progress for {} s each: the machine is sick, or its jobs are; the worker gave back what ran \
         and ends",
        .after.as_secs_f64()
    )]
    Stuck {
        /// Number of stuck slots.
        stuck: usize,
        /// For how long.
        after: Duration,
    },
    /// Metrics can't be served as asked.
    #[error(transparent)]
    Metrics(#[from] telemetry::BindError),
    /// The system gives no thread, or another thing that the worker can't be without.
    #[error("the worker can't start: {0}")]
    System(String),
}

/// A time that can't be kept to.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BadTime {
    /// Outside of what is allowed.
    #[error("{option} {} is out of range: {} s to {} s are allowed", .given.as_secs_f64(), .least.as_secs_f64(), .most.as_secs_f64())]
    Range {
        /// The option.
        option: &'static str,
        /// The given time.
        given: Duration,
        /// Least allowed.
        least: Duration,
        /// Most allowed.
        most: Duration,
    },
    /// It would have to leave before it came.
    #[error(
        "--time-left {} is too short: {} s of grace and {} s to leave are kept free before the end; give more time, or a \
         shorter --grace", .left.as_secs_f64(), .grace.as_secs_f64(), MARGIN.as_secs_f64()
    )]
    Left {
        /// The given time.
        left: Duration,
        /// The grace time.
        grace: Duration,
    },
}
