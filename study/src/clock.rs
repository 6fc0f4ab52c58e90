//! Clocks: wall time, and CPU time of the calling thread. Other programs affect CPU time far less than wall time.

#![expect(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "this module is the crate's only access to clocks: times are measured here, and no score depends on them"
)]

use serde::Serialize;
use std::time::{Duration, Instant};

/// Time spent on a piece of work, s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spent {
    /// Wall time.
    pub wall: f64,
    /// CPU time of the thread that did the work.
    pub cpu: f64,
}

impl Spent {
    /// Returns the share of one of `n` equal pieces of work.
    pub fn share(self, n: usize) -> Self {
        let n = n as f64;
        Self { wall: self.wall / n, cpu: self.cpu / n }
    }
}

impl std::ops::AddAssign for Spent {
    fn add_assign(&mut self, other: Self) {
        self.wall += other.wall;
        self.cpu += other.cpu;
    }
}

/// Stopwatch for wall time.
#[derive(Clone, Copy, Debug)]
pub struct Stopwatch(Instant);

impl Stopwatch {
    /// Starts a stopwatch.
    pub fn start() -> Self {
        Self(Instant::now())
    }

    /// Returns the wall time since the start.
    pub fn elapsed(self) -> Duration {
        self.0.elapsed()
    }
}

/// Runs `work` and measures its time. CPU time is that of the calling thread only, or the wall time if the system has
/// no clock for it.
pub fn timed<T>(work: impl FnOnce() -> T) -> (T, Spent) {
    let (wall, cpu) = (Stopwatch::start(), thread_time());
    let done = work();
    let wall = wall.elapsed();
    let cpu = match (cpu, thread_time()) {
        (Some(before), Some(after)) => after.saturating_sub(before),
        _ => wall,
    };
    (done, Spent { wall: wall.as_secs_f64(), cpu: cpu.as_secs_f64() })
}

/// Returns the CPU time of the calling thread; `None` if the system has no such clock.
#[cfg(unix)]
fn thread_time() -> Option<Duration> {
    rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime).try_into().ok()
}

/// Returns `None`, because this system has no such clock. [`timed`] uses the wall time instead.
#[cfg(not(unix))]
fn thread_time() -> Option<Duration> {
    None
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn sleeping_takes_wall_time_but_no_cpu_time() {
        let ((), spent) = timed(|| std::thread::sleep(Duration::from_millis(50)));
        assert!(spent.wall >= 0.05 && spent.cpu < 0.02, "{spent:?}");
    }

    #[test]
    fn computing_takes_wall_and_cpu_time() {
        let (_, spent) = timed(|| {
            let before = thread_time().unwrap();
            while thread_time().unwrap() - before < Duration::from_millis(20) {
                std::hint::black_box((0..1000).sum::<u64>());
            }
        });
        assert!(spent.cpu >= 0.02 && spent.wall >= 0.9 * spent.cpu, "{spent:?}");
    }
}
