//! What the command line means. It is typed as in `raw`; `resolve` is the one place where defaults, the environment and the
//! machine are consulted.

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

/// A command with all that it needs to know.
#[derive(Debug)]
pub struct Resolved {
    /// Only errors and JSON.
    pub quiet: bool,
    /// What to do.
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
    Scenarios { show: Option<String>, json: bool },
    Completions(Shell),
    Man { out: Option<PathBuf> },
}

#[derive(Debug)]
pub struct Run {
    pub file: JobFile,
    pub to: RunTo,
}

#[derive(Debug)]
pub struct Plan {
    pub of: RunOf,
    /// That of the run if it is not given; so for the others.
    pub environment: Option<String>,
    pub seeds: Option<u32>,
    pub iterations: Option<u32>,
    pub algorithm: Option<String>,
    pub reuse_tolerance: Option<f64>,
    /// Trees grow on when they have reached the goal.
    pub whole_trees: bool,
    pub seed: Option<u64>,
    pub to: RunTo,
}

#[derive(Debug)]
pub struct Simulate {
    pub of: GivenBy,
    pub what: SimulateWhat,
    pub environment: Option<String>,
    /// On the reference setting of the scale.
    pub fine: bool,
    /// Plan anew beyond this deviation, mu; `Some(None)`: the default one.
    pub replan: Option<Option<f64>>,
    pub way: Option<Way>,
    pub repeats: Option<u32>,
    pub vary: VarySpec,
    pub seed: Option<u64>,
    pub to: RunTo,
}

/// Where the robot comes from, and the gaits of a motion that has any.
#[derive(Debug)]
pub enum GivenBy {
    Run(RunOf),
    /// A robot that ships, or a file.
    Robot(String),
}

/// The motion.
#[derive(Debug)]
pub enum SimulateWhat {
    /// Counted from 1.
    Gait(u32),
    /// The run's best plan.
    Plan,
    /// A CSV file.
    Targets(PathBuf),
    /// s.
    Stand(f64),
}

/// Whose gaits are used.
#[derive(Debug)]
pub enum RunOf {
    /// A run's folder.
    Folder(PathBuf),
    /// A coordinator's job.
    Stored { id: String, on: Url },
}

/// Where a job runs, and where its result goes.
#[derive(Debug)]
pub struct RunTo {
    pub out: Option<PathBuf>,
    pub place: Place,
    pub json: bool,
}

/// Where a run's evaluations happen.
#[derive(Debug)]
pub enum Place {
    /// In this process, so many at once.
    Here { slots: u32 },
    /// On the workers of a coordinator.
    There {
        url: Url,
        /// The environment names it, not the command line.
        from_environment: bool,
    },
}

#[derive(Debug)]
pub struct Submit {
    pub file: JobFile,
    /// 0: the coordinator's default.
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

/// Whose health is asked for.
#[derive(Debug)]
pub enum HealthOf {
    /// A coordinator's; of one that stands by is enough, or not.
    Coordinator { on: Url, alive: bool },
    /// Of the process that serves its metrics here.
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
    /// Where it was tainted if it is not given.
    pub from_generation: Option<u32>,
    pub again: bool,
}

#[derive(Debug)]
pub struct Evaluate {
    pub what: EvaluateWhat,
    pub generation: u32,
    pub candidate: u32,
    pub question: Option<Question>,
    /// The one that ended the job if it is not given.
    pub genotype: Option<Genotype>,
    pub json: bool,
}

/// Whose candidate is evaluated.
#[derive(Debug)]
pub enum EvaluateWhat {
    File(JobFile),
    /// A coordinator's.
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
    /// At least two.
    pub folders: Vec<PathBuf>,
    /// Where the picture goes, if one is wanted.
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
    /// Counted from 0.
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
    /// Under which the coordinator is dialed.
    pub hosts: Vec<Host>,
    /// That certificates are valid.
    pub days: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CertsAction {
    Init,
    Renew,
}
