//! Counters of the coordinator, read from its Prometheus metrics.

use std::io;
use std::net::SocketAddr;
use std::time::Duration;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;

/// Time limit of a request: longer than the coordinator waits for its own gauges, and enough for a busy machine.
const TIMEOUT: Duration = Duration::from_secs(20);

/// Some counters of the coordinator. None of them ever decreases.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Numbers {
    /// Number of committed evaluations.
    pub evaluations: f64,
    /// Number of sealed generations.
    pub generations: f64,
    /// Number of transactions.
    pub commits: f64,
    /// Time of all transactions, s.
    pub commit_seconds: f64,
    /// Changes in the transactions: results of a range, a sealed generation, a job's state.
    pub changes: f64,
    /// Number of lost workers.
    pub workers_lost: f64,
    /// Number of leases that ended because their worker was lost.
    pub leases_lost: f64,
}

impl Numbers {
    fn of(text: &str) -> Self {
        let value = |name: &str| {
            let of_line = |line: &str| line.strip_prefix(name)?.strip_prefix(' ')?.parse::<f64>().ok();
            text.lines().find_map(of_line).unwrap_or(0.0)
        };
        Self {
            evaluations: value("evogait_tasks_total{phase=\"searching\"}"),
            generations: value("evogait_rounds_sealed_total"),
            commits: value("evogait_commit_seconds_count"),
            commit_seconds: value("evogait_commit_seconds_sum"),
            changes: value("evogait_commit_writes_sum"),
            workers_lost: value("evogait_workers_lost_total"),
            leases_lost: value("evogait_leases_ended_total{why=\"lost\"}"),
        }
    }

    /// Returns the increase of all counters since `before`.
    pub fn since(self, before: Self) -> Self {
        Self {
            evaluations: self.evaluations - before.evaluations,
            generations: self.generations - before.generations,
            commits: self.commits - before.commits,
            commit_seconds: self.commit_seconds - before.commit_seconds,
            changes: self.changes - before.changes,
            workers_lost: self.workers_lost - before.workers_lost,
            leases_lost: self.leases_lost - before.leases_lost,
        }
    }
}

/// Requests the metrics from the coordinator.
pub async fn scrape(address: SocketAddr) -> io::Result<Numbers> {
    let asked = async {
        let mut stream = TcpStream::connect(address).await?;
        let request = format!("GET /metrics HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
        stream.write_all(request.as_bytes()).await?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer).await?;
        Ok(Numbers::of(&answer))
    };
    tokio::time::timeout(TIMEOUT, asked).await.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metrics_are_matched_by_full_name() {
        let text = "# TYPE evogait_commit_seconds histogram\n\
                    evogait_commit_seconds_sum 1.5\n\
                    evogait_commit_seconds_count 30\n\
                    evogait_commit_seconds_bucket{le=\"0.1\"} 30\n\
                    evogait_commit_writes_sum 90.0\n\
                    evogait_tasks_total{phase=\"preparing\"} 2\n\
                    evogait_tasks_total{phase=\"searching\"} 400\n\
                    evogait_leases_ended_total{why=\"drained\"} 7\n\
                    evogait_leases_ended_total{why=\"lost\"} 3\n# EOF";
        let numbers = Numbers::of(text);
        assert_eq!((numbers.commits, numbers.commit_seconds, numbers.changes), (30.0, 1.5, 90.0));
        assert_eq!((numbers.evaluations, numbers.leases_lost, numbers.generations), (400.0, 3.0, 0.0));
        let later = Numbers { commits: 32.0, ..numbers };
        assert_eq!(later.since(numbers), Numbers { commits: 2.0, ..Numbers::default() });
    }
}
