//! Points at which a coordinator can be made to die, as if by `kill -9`: the laws of `tests/tests/crashes.rs` need it.
//!
//! `EVOGAIT_FAIL_POINT=before-commit:3` dies before the third commit; `in-commit` once everything is written but nothing is
//! committed; `after-commit` before anybody is told. Builds without debug assertions have none of it.

/// Dies if this is the point, and the time, to do so.
#[cfg(debug_assertions)]
pub(crate) fn reached(point: &str) {
    use std::sync::LazyLock;
    use std::sync::atomic::{AtomicU64, Ordering};
    use std::time::Duration;

    const LAST_WORDS: Duration = Duration::from_millis(50);
    static WANTED: LazyLock<Option<(String, u64)>> = LazyLock::new(|| {
        let wanted = std::env::var("EVOGAIT_FAIL_POINT").ok()?;
        let (point, count) = wanted.split_once(':').expect("EVOGAIT_FAIL_POINT is POINT:COUNT");
        Some((point.to_owned(), count.parse().expect("EVOGAIT_FAIL_POINT is POINT:COUNT")))
    });
    static REACHED: AtomicU64 = AtomicU64::new(0);
    if let Some((wanted, count)) = &*WANTED
        && wanted == point
        && REACHED.fetch_add(1, Ordering::SeqCst) + 1 == *count
    {
        // What somebody was told too early is on its way by now.
        std::thread::sleep(LAST_WORDS);
        std::process::abort();
    }
}

#[cfg(not(debug_assertions))]
pub(crate) fn reached(_point: &str) {}
