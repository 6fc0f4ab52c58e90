//! Options of the commands that run jobs, read results, and show robots and scenarios.

use super::number::{length, range, seed, whole};
use super::{OnCoordinator, Shown};
use clap::{Args, Subcommand};
use sim_core::base::limits::{MAX_ITERATIONS, MAX_PLAN_SEEDS, MAX_SIMULATIONS};
use sim_core::physics::Scale;
use std::path::PathBuf;

#[derive(Clone, Debug, Args)]
pub struct JobFile {
    /// Job file, or the name of a job that ships (see `evogait scenarios`)
    #[arg(value_name = "JOB.toml")]
    pub job: String,

    /// Seed of all random numbers instead of the job's, 0 to 2⁶³ − 1
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = seed())]
    pub seed: Option<u64>,
}

#[derive(Debug, Args)]
pub struct Run {
    #[command(flatten)]
    pub file: JobFile,

    #[command(flatten)]
    pub to: RunTo,
}

/// Place where a job runs, and output folder of its result.
#[derive(Debug, Args)]
pub struct RunTo {
    /// Output folder [default: runs/NAME-DIGEST, with the first 12 digits of the job digest]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// Run on this machine with N evaluations at once [default: number of cores]; the result does not depend on N
    #[arg(long, value_name = "N", conflicts_with = "coordinator", value_parser = whole(1..=1024))]
    pub workers: Option<u32>,

    /// Run on the workers of this coordinator instead of this machine
    /// [default: $EVOGAIT_COORDINATOR, else this machine]
    #[arg(long, value_name = "URL")]
    pub coordinator: Option<String>,

    #[command(flatten)]
    pub shown: Shown,

    /// Print the result as JSON at the end
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct Plan {
    /// Output folder of a run that evolved or planned, its result.json, or the id of such a job on a coordinator
    #[arg(value_name = "RUN")]
    pub run: String,

    /// Environment to plan in: a file, or the name of one that ships [default: the run's own]
    #[arg(long, value_name = "NAME|FILE")]
    pub environment: Option<String>,

    /// Number of trees, each with random numbers of its own [default: 20]
    #[arg(long, value_name = "N", value_parser = whole(1..=MAX_PLAN_SEEDS))]
    pub seeds: Option<u32>,

    /// Maximum number of iterations of a tree, K_max [default: as in the run]
    #[arg(long, value_name = "K", value_parser = whole(1..=MAX_ITERATIONS))]
    pub iterations: Option<u32>,

    /// Planner: flood-fill (Algorithm 1), original or nearest-valid [default: as in the run]
    #[arg(long, value_name = "NAME")]
    pub algorithm: Option<String>,

    /// Reuse a transition if the local states differ by at most this much, rad (mu for height); 0 simulates every
    /// expansion [default: as in the run]
    #[arg(long, value_name = "RAD", allow_negative_numbers = true)]
    pub reuse_tolerance: Option<f64>,

    /// Grow trees to their last iteration even after they have reached the goal
    #[arg(long)]
    pub whole_trees: bool,

    /// Seed of all random numbers, 0 to 2⁶³ − 1 [default: the run's]
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = seed())]
    pub seed: Option<u64>,

    #[command(flatten)]
    pub to: RunTo,
}

#[derive(Debug, Args)]
pub struct Simulate {
    /// Output folder of a run that evolved or planned, its result.json, or the id of such a job on a coordinator
    #[arg(value_name = "RUN", required_unless_present = "robot")]
    pub run: Option<String>,

    /// Simulate this robot instead of a run's: a file, or the name of one that ships
    #[arg(long, value_name = "NAME|FILE", conflicts_with = "run")]
    pub robot: Option<String>,

    #[command(flatten)]
    pub what: SimulateWhat,

    /// Environment to simulate in: a file, or the name of one that ships [default: the run's own, or "empty"]
    #[arg(long, value_name = "NAME|FILE")]
    pub environment: Option<String>,

    /// Simulate on the reference setting of the scale: rapier with smaller steps [default: the run's physics]
    #[arg(long)]
    pub fine: bool,

    /// Plan again, on the run's physics, where the robot deviates too far from the plan. The motion is simulated on the
    /// reference setting, gait by gait
    #[arg(long)]
    pub replan: bool,

    /// Allowed deviation from the plan, mu [default: 1]
    #[arg(long, value_name = "MU", requires = "replan", allow_negative_numbers = true)]
    pub deviation: Option<f64>,

    /// Execution of a plan: each gait from rest, or without stops between gaits [default: both ways]
    #[arg(long, value_name = "WAY", conflicts_with = "replan")]
    pub way: Option<Way>,

    /// Number of repeats, each with draws of its own [default: 50 if something varies]
    #[arg(long, value_name = "N", value_parser = whole(0..=MAX_SIMULATIONS))]
    pub repeats: Option<u32>,

    /// Range of the Coulomb friction coefficient, such as 0.6..1.0; one number fixes the value. The same holds for all
    /// ranges
    #[arg(long, value_name = "A..B", allow_hyphen_values = true, value_parser = range)]
    pub friction: Option<[f64; 2]>,

    /// Range of a factor on the motors' maximum torque
    #[arg(long, value_name = "A..B", allow_hyphen_values = true, value_parser = range)]
    pub motor_strength: Option<[f64; 2]>,

    /// Range of the offset of the start's x, mu
    #[arg(long, value_name = "A..B", allow_hyphen_values = true, value_parser = range)]
    pub x: Option<[f64; 2]>,

    /// Range of the offset of the start's y, mu
    #[arg(long, value_name = "A..B", allow_hyphen_values = true, value_parser = range)]
    pub y: Option<[f64; 2]>,

    /// Range of the offset of the start's heading, rad
    #[arg(long, value_name = "A..B", allow_hyphen_values = true, value_parser = range)]
    pub yaw: Option<[f64; 2]>,

    /// Number of locked joints; each repeat draws them anew
    #[arg(long, value_name = "N", value_parser = whole(0..=u32::MAX))]
    pub dead_joints: Option<u32>,

    /// Standard deviation of noise on the joint targets, rad
    #[arg(long, value_name = "RAD", allow_negative_numbers = true)]
    pub target_noise: Option<f64>,

    /// Seed of all random numbers, 0 to 2⁶³ − 1 [default: the run's, or 1]
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = seed())]
    pub seed: Option<u64>,

    #[command(flatten)]
    pub to: RunTo,
}

/// Motion to simulate.
#[derive(Debug, Args)]
#[group(id = "motion", required = true, multiple = false)]
pub struct SimulateWhat {
    /// Gait of the run, counted from 1
    #[arg(long, value_name = "N", value_parser = whole(1..=u32::MAX))]
    pub gait: Option<u32>,

    /// Best plan of the run
    #[arg(long)]
    pub plan: bool,

    /// CSV file with joint targets: a column "time" (s) and a column for each joint (rad), like trajectories/gait-1.csv
    /// of a run
    #[arg(long, value_name = "FILE.csv")]
    pub targets: Option<PathBuf>,

    /// Stand in the neutral pose for this time, s
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
    pub stand: Option<f64>,
}

/// Values of `--way`.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
#[allow(missing_docs)]
pub enum Way {
    Resimulated,
    Continuous,
}

impl From<Way> for sim_core::problem::Way {
    fn from(raw: Way) -> Self {
        match raw {
            Way::Resimulated => Self::Resimulated,
            Way::Continuous => Self::Continuous,
        }
    }
}

#[derive(Debug, Args)]
pub struct Evaluate {
    /// Job file, the name of a job that ships, or the id of a job on a coordinator
    #[arg(value_name = "JOB.toml|ID")]
    pub job: String,

    /// Generation of the candidate, on which its random numbers depend [default: 0]
    #[arg(long, value_name = "G", value_parser = whole(0..=u32::MAX))]
    pub generation: Option<u32>,

    /// Index of the candidate in its generation, on which its random numbers depend, too [default: 0]
    #[arg(long, value_name = "C", value_parser = whole(0..=u32::MAX))]
    pub candidate: Option<u32>,

    /// Parameters of the candidate: numbers with commas between them
    #[arg(long, value_name = "NUMBERS", allow_hyphen_values = true, conflicts_with = "genome_file")]
    pub genome: Option<String>,

    /// File with the parameters of the candidate
    #[arg(long, value_name = "FILE")]
    pub genome_file: Option<PathBuf>,

    /// Examine the candidate as after the search, instead of scoring it as in the search
    #[arg(long, value_name = "QUESTION")]
    pub question: Option<Question>,

    #[command(flatten)]
    pub on: OnCoordinator,
}

/// Values of `--question`.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
#[allow(missing_docs)]
pub enum Question {
    Fresh,
    Reference,
    LessFriction,
    MoreFriction,
    WithoutReuse,
    Traces,
}

impl From<Question> for sim_core::procedure::evolve::finish::Question {
    fn from(raw: Question) -> Self {
        match raw {
            Question::Fresh => Self::Fresh,
            Question::Reference => Self::Reference,
            Question::LessFriction => Self::LessFriction,
            Question::MoreFriction => Self::MoreFriction,
            Question::WithoutReuse => Self::WithoutReuse,
            Question::Traces => Self::Traces,
        }
    }
}

#[derive(Debug, Args)]
#[group(id = "what", required = true, multiple = false)]
pub struct ReplayWhat {
    /// Gait to simulate from the settled start, counted from 1
    #[arg(long, value_name = "N", value_parser = whole(1..=u32::MAX))]
    pub gait: Option<u32>,

    /// Simulate the best path of the tree
    #[arg(long)]
    pub plan: bool,
}

#[derive(Debug, Args)]
pub struct Compare {
    /// Output folders of runs, or their result.json
    #[arg(value_name = "DIR", num_args = 2.., required = true)]
    pub folders: Vec<PathBuf>,

    /// Draw the curves of the runs to this file, .svg or .png
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,

    /// Print JSON instead of text
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct Replay {
    /// Output folder of a run, or its result.json
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,

    #[command(flatten)]
    pub what: ReplayWhat,

    /// Write the samples to this CSV file
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct Verify {
    /// Output folder of a run, or its result.json
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,

    /// Compute the whole report again: archive, audits without reuse, fresh seeds, gaits, paths
    #[arg(long)]
    pub full: bool,

    /// Print JSON instead of text
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct Validate {
    #[command(flatten)]
    pub file: JobFile,

    /// Skip the cost estimate, which times evaluations on this machine for some seconds
    #[arg(long)]
    pub no_estimate: bool,

    /// Print JSON instead of text
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct Robot {
    /// Name of a robot that ships, or a robot file: TOML, MJCF or URDF
    #[arg(value_name = "NAME|FILE")]
    pub robot: String,

    /// Show the robot with the failed modules of this variant
    #[arg(long, value_name = "VARIANT")]
    pub variant: Option<String>,

    /// Length of 1 mu in the unit of the file, by which all lengths are divided; 0.065 for modules of 65 mm in a file
    /// in metres
    #[arg(long, value_name = "LENGTH", value_parser = length)]
    pub unit: Option<f64>,

    /// Write the robot to this file: a picture (.svg, .png), MJCF (.xml, .mjcf), .urdf or .toml
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,

    /// Export in this format, to standard output without --out [default: the ending of --out selects it]
    #[arg(long, value_name = "FORMAT")]
    pub format: Option<RobotFormat>,

    /// Gravity and motors of the export: paper for modules of 1 m, real for modules of 0.105 m [default: paper]
    #[arg(long, value_name = "SCALE")]
    pub scale: Option<RobotScale>,

    /// Print JSON instead of text
    #[arg(long, display_order = 99)]
    pub json: bool,
}

/// Values of `--format`.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
#[allow(missing_docs)]
pub enum RobotFormat {
    Mjcf,
    Urdf,
    Toml,
}

/// Values of `--scale`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
#[allow(missing_docs)]
pub enum RobotScale {
    Paper,
    Real,
}

impl From<RobotScale> for Scale {
    fn from(raw: RobotScale) -> Self {
        match raw {
            RobotScale::Paper => Self::Paper,
            RobotScale::Real => Self::Real,
        }
    }
}

#[derive(Debug, Args)]
pub struct Sequence {
    #[command(subcommand)]
    pub action: SequenceAction,
}

#[derive(Debug, Subcommand)]
pub enum SequenceAction {
    /// Check that every segment is feasible, and print its effect
    Check {
        #[command(flatten)]
        of: SequenceOf,

        /// Print JSON instead of text
        #[arg(long, display_order = 99)]
        json: bool,
    },
    /// Write the joint targets over time as CSV, for hardware or `evogait simulate --targets`
    Targets {
        #[command(flatten)]
        of: SequenceOf,

        /// Duration, s
        #[arg(long, value_name = "S", default_value = "100", value_parser = length)]
        duration: f64,

        /// Output file [default: standard output]
        #[arg(long, value_name = "FILE")]
        out: Option<PathBuf>,
    },
    /// Simulate the sequence and write its motion, contacts and pictures
    Run {
        #[command(flatten)]
        of: SequenceOf,

        /// Duration, s
        #[arg(long, value_name = "S", default_value = "100", value_parser = length)]
        duration: f64,

        /// Simulate on the reference setting of the scale: rapier with smaller steps
        #[arg(long)]
        fine: bool,

        #[command(flatten)]
        to: RunTo,
    },
}

#[derive(Debug, Args)]
pub struct SequenceOf {
    /// File of the sequence
    #[arg(value_name = "FILE")]
    pub file: PathBuf,

    /// Robot of M-TRAN modules: a file, the name of one that ships, or random:mtran:MODULES:SEED
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: String,
}

#[derive(Debug, Args)]
pub struct Scenarios {
    #[command(subcommand)]
    pub action: Option<ScenariosAction>,

    /// Print JSON instead of text
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Subcommand)]
pub enum ScenariosAction {
    /// Print the TOML file of a scenario
    Show {
        /// Name of the scenario; `robots/NAME`, `environments/NAME` or `jobs/NAME` if several have the same name
        name: String,
    },
}
