//! Points at which a coordinator can be made to abort, as if by `kill -9`. The tests in `tests/tests/crashes.rs` use
//! them.
//!
//! `EVOGAIT_FAIL_POINT=before-commit:3` aborts before the third commit. `in-commit` is the point where everything is
//! written but not committed; `after-commit` is before any reply is sent. Builds without debug assertions ignore the
//! variable.

/// Aborts the process if the variable names this point and the count is reached.
#[cfg(debug_assertions)]
pub(crate) fn reached(point: &str) {
    use std::sync::LazyLock;
    use std::sync::atomic::{AtomicU64, Ordering};
    use std::time::Duration;

    const LAST_WORDS: Duration = Duration::from_millis(50);
    static WANTED: LazyLock<Option<(String, u64)>> = LazyLock::new(|| {
        let wanted = std::env::var("EVOGAIT_FAIL_POINT").ok()?;
        let (point, count) = wanted.split_once(':').expect("EVOGAIT_FAIL_POINT must be POINT:COUNT");
        Some((point.to_owned(), count.parse().expect("EVOGAIT_FAIL_POINT must be POINT:COUNT")))
    });
    static REACHED: AtomicU64 = AtomicU64::new(0);
    if let Some((wanted, count)) = &*WANTED
        && wanted == point
        && REACHED.fetch_add(1, Ordering::SeqCst) + 1 == *count
    {
        // Leaves time for replies that were sent too early to reach the client.
        std::thread::sleep(LAST_WORDS);
        std::process::abort();
    }
}

#[cfg(not(debug_assertions))]
pub(crate) fn reached(_point: &str) {}
