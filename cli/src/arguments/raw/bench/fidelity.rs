//! Options of `evogait bench fidelity`.

use super::{PhysicsSetting, Subject, duration, seed, whole};
use clap::Args;
use std::path::PathBuf;

/// Text at the end of `evogait bench fidelity --help`.
pub const FIDELITY_HELP: &str = "\
Examples:
  evogait bench fidelity quadropod --settings 30x8,60x16,240x4 --out bench/quadropod
  evogait bench fidelity --gaits runs/quadropod-empty-3f2a9c01d4e5 --random 0
  evogait bench fidelity lizard --random 10 --evolved 10 --duration 2
  evogait bench fidelity quadropod --settings 30x8,200x2-lockstep
  evogait bench fidelity lizard --environment stairs --settings 200x2-lockstep
  evogait bench fidelity quadropod --table scenarios/fidelity.toml

Simulates the same gaits from the same settled start with every setting and with
the reference. Errors are errors of the pivot's pose after the gait. The rank
correlation is Spearman's, of the travelled distances. Two more lines give the
scale of errors:
  ceiling        the reference against itself, with the joint angles of the
                 start changed by a millionth rad
  halved steps   the reference against itself with twice its substeps, and with
                 twice its steps
docs/performance.md explains how to read them.

Settings of both engines may be compared with a reference of either engine.
--table measures settings of the lockstep engine against its converged reference
(default: the default setting of the scale, and settings with a half, a quarter
and an eighth of its step). It stores them as rows of the table by which
engine = \"auto\" chooses an engine. tests/fidelity-table.sh does this for every robot
that ships.

Evolved gaits are the gaits of a stored run's winner (--gaits). Without --gaits
they are evolved now on the engine of the reference, by genetic algorithms for
coverage with 8 generations of 17 candidates of two gaits of 4 s. Each search
gives 34 gaits and takes some seconds; there are as many searches as needed.
With the defaults the reference takes nearly all the time: some minutes.

Files in the output folder:
  fidelity.md, fidelity.json    the tables
  frontier.svg, frontier.png    speed against rank correlation and error";

#[derive(Debug, Args)]
pub struct BenchFidelity {
    #[command(flatten)]
    pub subject: Subject,

    /// Environment (name or file) that supplies terrain and start instead of flat ground
    #[arg(long, value_name = "NAME")]
    pub environment: Option<String>,

    /// Engine settings to compare [default: the default setting of the scale, on the reference's engine]
    #[arg(long, value_name = "SETTING,…", value_delimiter = ',')]
    pub settings: Vec<PhysicsSetting>,

    /// Converged setting as the reference [default: 480x8 for the scale paper, 960x16 for real; if all settings are
    /// lockstep, 1600x4-lockstep and 4800x4-lockstep]
    #[arg(long, value_name = "SETTING")]
    pub reference: Option<PhysicsSetting>,

    /// Number of random gaits
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = whole(0..=10_000))]
    pub random: u32,

    /// Number of evolved gaits
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = whole(0..=10_000))]
    pub evolved: u32,

    /// Take robot, physics, gait duration and evolved gaits from the folder of this run
    #[arg(long, value_name = "DIR", conflicts_with_all = ["robot", "variant", "scale", "duration", "environment"])]
    pub gaits: Option<PathBuf>,

    /// Duration of each gait, s
    #[arg(long, value_name = "S", default_value = "10", value_parser = duration)]
    pub duration: f64,

    /// Seed of the gaits
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = seed())]
    pub seed: u64,

    /// Number of gaits simulated at once; speeds are most accurate with 1
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = whole(1..=1024))]
    pub threads: u32,

    /// Write the tables and the picture to this folder
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// Store the settings of the lockstep engine as rows of this fidelity table
    #[arg(long, value_name = "FILE", conflicts_with_all = ["gaits", "environment"])]
    pub table: Option<PathBuf>,

    /// Print JSON instead of text
    #[arg(long, display_order = 99)]
    pub json: bool,
}
