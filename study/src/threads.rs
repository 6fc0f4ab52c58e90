//! Work on several threads, with an order of results that does not depend on the number of threads.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Computes `of(0)` to `of(n - 1)` on up to `threads` threads (at least 1) and returns them in this order.
pub fn in_order<T: Send>(n: usize, threads: usize, of: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let found = Mutex::new(Vec::with_capacity(n));
    std::thread::scope(|scope| {
        for _ in 0..threads.min(n) {
            scope.spawn(|| {
                loop {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    if i >= n {
                        return;
                    }
                    let value = of(i);
                    found.lock().unwrap_or_else(PoisonError::into_inner).push((i, value));
                }
            });
        }
    });
    let mut found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
    found.sort_unstable_by_key(|(i, _)| *i);
    found.into_iter().map(|(_, value)| value).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_in_order_for_any_number_of_threads() {
        for threads in [1, 3, 20] {
            assert_eq!(in_order(10, threads, |i| i * i), [0, 1, 4, 9, 16, 25, 36, 49, 64, 81]);
        }
        assert!(in_order(0, 2, |i| i).is_empty());
    }
}
