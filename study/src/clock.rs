//! Clocks: time on the wall, and CPU time of the calling thread, which other programs lengthen far less.

#![expect(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "this module is the crate's only access to clocks: times are measured here, and no score depends on them"
)]

use serde::Serialize;
use std::time::{Duration, Instant};

/// Time that a piece of work took, s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spent {
    /// Wall time.
    pub wall: f64,
    /// CPU time of the thread that did the work.
    pub cpu: f64,
}

impl Spent {
    /// An equal share of this time, for one of `n` pieces of work.
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

/// Measures wall time from its start.
#[derive(Clone, Copy, Debug)]
pub struct Stopwatch(Instant);

impl Stopwatch {
    /// Starts now.
    pub fn start() -> Self {
        Self(Instant::now())
    }

    /// Wall time since the start.
    pub fn elapsed(self) -> Duration {
        self.0.elapsed()
    }
}

/// Does the work and measures its time. Only the calling thread's work counts as CPU time.
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

/// CPU time of this thread so far; `None` if the system has no such clock.
#[cfg(unix)]
fn thread_time() -> Option<Duration> {
    rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime).try_into().ok()
}

/// `None`: this system has no such clock, and [`timed`] takes the wall time instead.
#[cfg(not(unix))]
fn thread_time() -> Option<Duration> {
    None
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn sleeping_takes_time_on_the_wall_and_none_of_the_cpu() {
        let ((), spent) = timed(|| std::thread::sleep(Duration::from_millis(50)));
        assert!(spent.wall >= 0.05 && spent.cpu < 0.02, "{spent:?}");
    }

    #[test]
    fn computing_takes_both() {
        let (_, spent) = timed(|| {
            let before = thread_time().unwrap();
            while thread_time().unwrap() - before < Duration::from_millis(20) {
                std::hint::black_box((0..1000).sum::<u64>());
            }
        });
        assert!(spent.cpu >= 0.02 && spent.wall >= 0.9 * spent.cpu, "{spent:?}");
    }
}
