//! Limits of a worker, beside those of the protocol (`proto::limits`).

use std::time::Duration;

/// Time to deliver finished results after the grace time.
pub const DELIVER_WITHIN: Duration = Duration::from_secs(3);
/// Time to send the last messages before the connection closes.
pub const LAST_WORDS: Duration = Duration::from_secs(1);
/// Time kept free before the end of a worker with limited time: it starts to drain when its grace time plus this margin
/// is left.
pub const MARGIN: Duration = Duration::from_secs(5);
/// Number of stuck slots at which a worker drains and ends, because each may occupy a core. One faulty task causes at
/// most 4 stuck slots over its attempts, alone and within a range.
pub const MAX_STUCK: usize = 5;
