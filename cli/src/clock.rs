//! What work costs: time on the wall, and time of the own thread on a CPU, which other programs lengthen far less.

use serde::Serialize;
use std::time::{Duration, Instant};

/// Time that something took, s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Spent {
    /// On the wall.
    pub wall: f64,
    /// Of this thread on a CPU.
    pub cpu: f64,
}

impl std::ops::AddAssign for Spent {
    fn add_assign(&mut self, other: Self) {
        self.wall += other.wall;
        self.cpu += other.cpu;
    }
}

/// Does something and tells what it took. Only this thread's work counts as CPU time.
pub fn timed<T>(work: impl FnOnce() -> T) -> (T, Spent) {
    let (wall, cpu) = (Instant::now(), thread_time());
    let done = work();
    let wall = wall.elapsed();
    let cpu = match (cpu, thread_time()) {
        (Some(before), Some(after)) => after.saturating_sub(before),
        _ => wall,
    };
    (done, Spent { wall: wall.as_secs_f64(), cpu: cpu.as_secs_f64() })
}

/// CPU time of this thread so far, where the system tells.
#[cfg(unix)]
fn thread_time() -> Option<Duration> {
    rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime).try_into().ok()
}

/// This system does not tell: wall time stands in.
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
