//! Limits of a worker, beside those of the protocol (`proto::limits`).

use std::time::Duration;

/// After the grace time, results that are done have this long to be delivered.
pub const DELIVER_WITHIN: Duration = Duration::from_secs(3);
/// Time to let the last words out.
pub const LAST_WORDS: Duration = Duration::from_secs(1);
/// Margin before the end of a worker with limited time: it starts to drain its grace time and this before its end.
pub const MARGIN: Duration = Duration::from_secs(5);
/// With so many stuck slots a worker drains and ends: each may hold a core. One poisoned task makes at most 4, alone
/// and as part of a range.
pub const MAX_STUCK: usize = 5;
