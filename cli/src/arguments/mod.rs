//! Command line: `raw` defines its syntax. `resolve` turns it into the types of this module, and is the only place that
//! reads defaults, environment variables and properties of the machine.

mod bench;
mod raw;
mod resolve;
mod robot;

pub use bench::Bench;
pub use raw::{
    BenchDispatch, BenchEvaluate, BenchFidelity, BenchFitness, BenchFleet, BenchPlan, BenchReuse, BenchRollout,
    BenchSoundness, Load, State, Subject,
};
pub use resolve::{cores, parse};
pub use robot::{PictureFormat, Robot, RobotOutput};

use crate::certs::Host;
use crate::client::Url;
pub use crate::load::JobFile;
use clap::CommandFactory as _;
use clap_complete::Shell;
use sim_core::genotype::Genotype;
use sim_core::problem::{VarySpec, Way};
use sim_core::procedure::evolve::finish::Question;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Returns the definition of the command line.
pub fn definition() -> clap::Command {
    raw::Cli::command()
}

/// A command with all its options resolved.
#[derive(Debug)]
pub struct Resolved {
    /// Print only errors and JSON.
    pub quiet: bool,
    /// Command to execute.
    pub command: Command,
}

#[derive(Debug)]
pub enum Command {
    Run(Run),
    Plan(Plan),
    Simulate(Simulate),
    Submit(Submit),
    Watch(OneJob),
    List(List),
    Show(Show),
    Cancel(OneJob),
    Pause(OneJob),
    Resume(OneJob),
    Restart(Restart),
    Evaluate(Evaluate),
    Fetch(Fetch),
    Workers { on: Url, json: bool },
    Demand { on: Url, json: bool },
    Health(Health),
    Compare(Compare),
    Replay(Replay),
    Verify(Verify),
    Validate(Validate),
    Bench(Bench),
    Robot(Robot),
    Certs(Certs),
    Sequence(Sequence),
    Scenarios { show: Option<String>, json: bool },
    Completions(Shell),
    Man { out: Option<PathBuf> },
}

/// A motion sequence, and what is done with it.
#[derive(Debug)]
pub struct Sequence {
    pub file: PathBuf,
    pub robot: String,
    pub action: SequenceAction,
}

#[derive(Debug)]
pub enum SequenceAction {
    Check { json: bool },
    Targets { duration: f64, out: Option<PathBuf> },
    Run { duration: f64, fine: bool, to: RunTo },
}

#[derive(Debug)]
pub struct Run {
    pub file: JobFile,
    pub to: RunTo,
}

#[derive(Debug)]
pub struct Plan {
    pub of: RunOf,
    /// `None` takes the run's own environment; the same holds for the options below.
    pub environment: Option<String>,
    pub seeds: Option<u32>,
    pub iterations: Option<u32>,
    pub algorithm: Option<String>,
    pub reuse_tolerance: Option<f64>,
    /// Grow trees to their last iteration even after they have reached the goal.
    pub whole_trees: bool,
    pub seed: Option<u64>,
    pub to: RunTo,
}

#[derive(Debug)]
pub struct Simulate {
    pub of: GivenBy,
    pub what: SimulateWhat,
    pub environment: Option<String>,
    /// Use the reference setting of the scale.
    pub fine: bool,
    /// Plan again where the deviation exceeds this limit, mu; `Some(None)` takes the default limit.
    pub replan: Option<Option<f64>>,
    pub way: Option<Way>,
    pub repeats: Option<u32>,
    pub vary: VarySpec,
    pub seed: Option<u64>,
    pub to: RunTo,
}

/// Source of the robot, and of the gaits if the motion has any.
#[derive(Debug)]
pub enum GivenBy {
    Run(RunOf),
    /// Name of a robot that ships, or path of a robot file.
    Robot(String),
}

/// Motion to simulate.
#[derive(Debug)]
pub enum SimulateWhat {
    /// Number of a gait, from 1.
    Gait(u32),
    /// Best plan of the run.
    Plan,
    /// CSV file with joint targets.
    Targets(PathBuf),
    /// Duration of standing, s.
    Stand(f64),
}

/// Run that supplies the gaits.
#[derive(Debug)]
pub enum RunOf {
    /// Output folder of a run.
    Folder(PathBuf),
    /// Job on a coordinator.
    Stored { id: String, on: Url },
}

/// Place where a job runs, and output folder of its result.
#[derive(Debug)]
pub struct RunTo {
    pub out: Option<PathBuf>,
    pub place: Place,
    pub json: bool,
}

/// Place where the tasks of a job run.
#[derive(Debug)]
pub enum Place {
    /// In this process, with this number of slots.
    Here { slots: u32 },
    /// On the workers of a coordinator.
    There {
        url: Url,
        /// True if the environment variable gives the URL, false if the command line does.
        from_environment: bool,
    },
}

#[derive(Debug)]
pub struct Submit {
    pub file: JobFile,
    /// Priority of the job; 0 takes the coordinator's default.
    pub priority: u32,
    pub again: bool,
    pub on: Url,
    pub json: bool,
}

#[derive(Debug)]
pub struct Health {
    pub of: HealthOf,
    pub json: bool,
}

/// Subject of a health check.
#[derive(Debug)]
pub enum HealthOf {
    /// Coordinator at this URL; `alive` also accepts a standby.
    Coordinator { on: Url, alive: bool },
    /// Process with its metrics at this address.
    Process(SocketAddr),
}

#[derive(Debug)]
pub struct OneJob {
    pub id: String,
    pub on: Url,
    pub json: bool,
}

#[derive(Debug)]
pub struct Restart {
    pub job: OneJob,
    /// `None` starts at the generation where the job was tainted.
    pub from_generation: Option<u32>,
    pub again: bool,
}

#[derive(Debug)]
pub struct Evaluate {
    pub what: EvaluateWhat,
    pub generation: u32,
    pub candidate: u32,
    pub question: Option<Question>,
    /// `None` takes the candidate that failed the job.
    pub genotype: Option<Genotype>,
    pub json: bool,
}

/// Source of the job of the evaluated candidate.
#[derive(Debug)]
pub enum EvaluateWhat {
    File(JobFile),
    /// Job on a coordinator.
    Stored {
        id: String,
        on: Url,
    },
}

#[derive(Debug)]
pub struct List {
    pub states: Vec<State>,
    pub limit: usize,
    pub on: Url,
    pub json: bool,
}

#[derive(Debug)]
pub struct Show {
    pub job: OneJob,
    pub toml: bool,
}

#[derive(Debug)]
pub struct Fetch {
    pub id: String,
    pub out: Option<PathBuf>,
    pub on: Url,
    pub json: bool,
}

#[derive(Debug)]
pub struct Compare {
    /// Output folders of runs, at least two.
    pub folders: Vec<PathBuf>,
    /// File for the picture of the curves.
    pub out: Option<PathBuf>,
    pub json: bool,
}

#[derive(Debug)]
pub struct Replay {
    pub folder: PathBuf,
    pub what: ReplayWhat,
    pub out: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug)]
pub enum ReplayWhat {
    /// Index of a gait, from 0.
    Gait(usize),
    Plan,
}

#[derive(Debug)]
pub struct Verify {
    pub folder: PathBuf,
    pub full: bool,
    pub json: bool,
}

#[derive(Debug)]
pub struct Validate {
    pub file: JobFile,
    pub estimate: bool,
    pub json: bool,
}

#[derive(Debug)]
pub struct Certs {
    pub action: CertsAction,
    pub folder: PathBuf,
    /// Host names and addresses of the coordinator, for its certificate.
    pub hosts: Vec<Host>,
    /// Days that the certificates are valid.
    pub days: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CertsAction {
    Init,
    Renew,
}
