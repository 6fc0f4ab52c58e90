//! `evogait bench fleet` as it is typed.

use super::{JobFile, whole};
use clap::Args;
use std::path::PathBuf;
use std::time::Duration;

/// What stands below its `--help`.
pub const FLEET_HELP: &str = "\
Examples:
  evogait bench fleet quadropod-empty
  evogait bench fleet quadropod-empty --workers 1000 --jobs 1,20,100,200
  evogait bench fleet quadropod-empty --workers 1000 --jobs 0 --seconds 60
  evogait bench fleet quadropod-empty --workers 100 --jobs 1 --population 10000 --median 0

Each line is a fresh coordinator in a process of its own, with SQLite on disk, and
so many light workers in this one, which speak the protocol of real ones and
simulate nothing. Every evaluation takes a time drawn for its job, generation and
candidate from a log-normal distribution; workers die and are replaced. The jobs
are JOB with other seeds, a swarm of --population particles and, so that each
candidate takes its own time, rapier for an engine. --jobs 0 watches idle workers.

Efficiency is the time in which slots were busy with what counted, over all slots
and seconds. Beside it stands what could be had: the same drawn times on the same
slots, handed out at no cost to workers that never die. A generation's overhead is
the time from seal to seal without what its slowest chain needed: the wait until
its last range found a free slot, and that range's evaluations.

How long ranges are follows from what the workers say that an evaluation took;
--claim makes them say something else. With --median 0 generations show what
handing out, taking in and keeping cost.";

#[derive(Clone, Debug, Args)]
pub struct BenchFleet {
    #[command(flatten)]
    pub file: JobFile,

    /// Numbers of light workers
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "10,100,1000,5000", value_parser = whole(1..=8000))]
    pub workers: Vec<u32>,

    /// Numbers of jobs side by side
    #[arg(long, value_name = "N,…", value_delimiter = ',', default_value = "1,20,100", value_parser = whole(0..=1000))]
    pub jobs: Vec<u32>,

    /// Slots of a worker
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = whole(1..=1024))]
    pub slots: u32,

    /// Candidates of a generation
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = whole(1..=10_000))]
    pub population: u32,

    /// Median time of an evaluation, s; 0: none takes any
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = number::<0, 3600>)]
    pub median: f64,

    /// Spread of the times: standard deviation of their logarithm
    #[arg(long, value_name = "SIGMA", default_value_t = 0.5, value_parser = number::<0, 3>)]
    pub sigma: f64,

    /// Let workers say that an evaluation took so long, s
    #[arg(long, value_name = "S", value_parser = number::<0, 3600>)]
    pub claim: Option<f64>,

    /// Mean time between two deaths of a worker, s; 0: none dies
    #[arg(long, value_name = "S", default_value_t = 3600.0, value_parser = number::<0, 10_000_000>)]
    pub lifetime: f64,

    /// Share of ranges that workers fail, 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = number::<0, 1>)]
    pub fail: f64,

    /// What is measured of a line, s
    #[arg(long, value_name = "S", default_value_t = 30, value_parser = whole(1..=3600))]
    pub seconds: u32,

    /// What goes before it, s: costs become known, jobs get out of step
    #[arg(long, value_name = "S", default_value_t = 10, value_parser = whole(0..=3600))]
    pub warm_up: u32,

    /// Be the coordinator that is measured, with its store in this folder
    #[arg(long, hide = true, value_name = "DIR")]
    pub host: Option<PathBuf>,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

impl BenchFleet {
    /// `--claim`.
    pub fn claim(&self) -> Option<Duration> {
        self.claim.map(Duration::from_secs_f64)
    }

    /// `--lifetime`; `None` where nobody dies.
    pub fn lifetime(&self) -> Option<Duration> {
        (self.lifetime > 0.0).then(|| Duration::from_secs_f64(self.lifetime))
    }
}

/// A number in a range, ends included.
fn number<const LEAST: u32, const MOST: u32>(text: &str) -> Result<f64, String> {
    let number: f64 = text.parse().map_err(|_| "it is not a number".to_owned())?;
    let allowed = f64::from(LEAST)..=f64::from(MOST);
    if allowed.contains(&number) { Ok(number) } else { Err(format!("allowed is {LEAST} to {MOST}")) }
}
