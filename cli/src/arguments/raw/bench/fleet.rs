//! Options of `evogait bench fleet`.

use super::{JobFile, whole};
use clap::Args;
use std::path::PathBuf;
use std::time::Duration;

/// Text at the end of `evogait bench fleet --help`.
pub const FLEET_HELP: &str = "\
Examples:
  evogait bench fleet quadropod-empty
  evogait bench fleet quadropod-empty --workers 1000 --jobs 1,20,100,200
  evogait bench fleet quadropod-empty --workers 1000 --jobs 0 --seconds 60
  evogait bench fleet quadropod-empty --workers 100 --jobs 1 --population 10000 --median 0

Each line of the table is a fresh coordinator in a process of its own, with
SQLite on disk. The light workers are in this process: they use the protocol of
real workers but sleep instead of simulating. The time of an evaluation is drawn
for its job, generation and candidate from a log-normal distribution. Workers
crash at random and are replaced. The jobs are JOB with different seeds, with a
swarm of --population particles, and with rapier as the engine, so that each
candidate takes a time of its own. --jobs 0 measures idle workers.

Efficiency is the slot time spent on evaluations that counted, over all slots
and seconds. The column ideal is the efficiency of the same drawn times on the
same slots, if tasks were assigned at no cost to workers that never crash. The
overhead of a generation is its time from seal to seal, without the time of its
slowest chain: the wait until a slot was free for its last range of candidates,
and the evaluations of that range.

The coordinator chooses the length of a range by the evaluation times that
workers report. --claim makes workers report another time. With --median 0
evaluations take no time, so generations show the cost of assigning, receiving
and storing.";

#[derive(Clone, Debug, Args)]
pub struct BenchFleet {
    #[command(flatten)]
    pub file: JobFile,

    /// Numbers of light workers
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "10,100,1000,5000", value_parser = whole(1..=8000))]
    pub workers: Vec<u32>,

    /// Numbers of jobs that run side by side
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "1,20,100", value_parser = whole(0..=1000))]
    pub jobs: Vec<u32>,

    /// Slots of each worker
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = whole(1..=1024))]
    pub slots: u32,

    /// Candidates of each generation
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = whole(1..=10_000))]
    pub population: u32,

    /// Median time of an evaluation, s; with 0 evaluations take no time
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = number::<0, 3600>)]
    pub median: f64,

    /// Spread of the evaluation times: standard deviation of their logarithm
    #[arg(long, value_name = "SIGMA", default_value_t = 0.5, value_parser = number::<0, 3>)]
    pub sigma: f64,

    /// Evaluation time that workers report instead of the drawn one, s
    #[arg(long, value_name = "S", value_parser = number::<0, 3600>)]
    pub claim: Option<f64>,

    /// Mean time between two crashes of a worker, s; with 0 workers never crash
    #[arg(long, value_name = "S", default_value_t = 3600.0, value_parser = number::<0, 10_000_000>)]
    pub lifetime: f64,

    /// Share of ranges that workers report as failed, 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = number::<0, 1>)]
    pub fail: f64,

    /// Measuring time of each line, s
    #[arg(long, value_name = "S", default_value_t = 30, value_parser = whole(1..=3600))]
    pub seconds: u32,

    /// Warm-up before the measurement, s: the coordinator measures costs, and the jobs get out of step
    #[arg(long, value_name = "S", default_value_t = 10, value_parser = whole(0..=3600))]
    pub warm_up: u32,

    /// Run as the measured coordinator, with the store in this folder
    #[arg(long, hide = true, value_name = "DIR")]
    pub host: Option<PathBuf>,

    /// Print JSON instead of text
    #[arg(long, display_order = 99)]
    pub json: bool,
}

impl BenchFleet {
    /// Returns the value of `--claim`.
    pub fn claim(&self) -> Option<Duration> {
        self.claim.map(Duration::from_secs_f64)
    }

    /// Returns the value of `--lifetime`, or `None` if workers never crash.
    pub fn lifetime(&self) -> Option<Duration> {
        (self.lifetime > 0.0).then(|| Duration::from_secs_f64(self.lifetime))
    }
}

/// Parses a number from `LEAST` to `MOST`, both included.
fn number<const LEAST: u32, const MOST: u32>(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "it is not a number".to_owned())?;
    let allowed = f64::from(LEAST)..=f64::from(MOST);
    if allowed.contains(&number) { Ok(number) } else { Err(format!("allowed is {LEAST} to {MOST}")) }
}
