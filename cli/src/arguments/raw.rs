//! The command line as it is typed: names, help and examples. What defaults mean is settled in the parent module.

mod bench;

pub use bench::{
    Bench, BenchCommand, BenchDispatch, BenchEvaluate, BenchFidelity, BenchFitness, BenchFleet, BenchPlan, BenchReuse,
    BenchRollout, BenchSoundness, Load, Subject,
};

use crate::certs::Host;
use clap::{Args, Parser, Subcommand};
use sim_core::job::Scale;
use sim_core::robot::exchange::Format;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Where a coordinator listens unless told otherwise.
pub const DEFAULT_COORDINATOR: &str = "http://127.0.0.1:7077";
/// Environment variable that names the coordinator.
pub const COORDINATOR_VARIABLE: &str = "EVOGAIT_COORDINATOR";

#[derive(Debug, Parser)]
#[command(
    name = "evogait",
    version,
    about = "Evolve sets of gaits for modular robots, scored by what a motion planner can do with them.",
    after_help = "\
Begin with:
  evogait scenarios                      what ships: robots, environments, jobs
  evogait run quadropod-empty            evolve a gait set on this machine
  evogait verify runs/quadropod-empty-*  recompute the result, compare its bits

Exit codes: 0 done, 1 failed, 2 wrong usage, 130 interrupted.",
    propagate_version = true,
    disable_help_subcommand = true,
    max_term_width = 120
)]
pub struct Cli {
    /// No progress, no summary: only errors, and what --json prints
    #[arg(short, long, global = true, display_order = 100)]
    pub quiet: bool,

    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Evolve a gait set: the whole job on this machine, or on a coordinator's workers
    #[command(after_help = "\
Examples:
  evogait run quadropod-empty
  evogait run my-job.toml --seed 7 --out runs/seven
  evogait run my-job.toml --coordinator http://cluster:7077

Without --coordinator, coordinator and workers run inside this process. Stop it
with Ctrl-C whenever you like: the same command goes on where it stopped, and
says so if the job is done.

Files in the output folder:
  result.json              best score, genome with names, digests, counts, seed
  job.toml                 the job with every setting; `evogait run` takes it
  history.csv              scores by generation: min, quartiles, max, mean, best
  archive.csv, audits.csv  the best genomes on the reference setting; every new
                           best scored again without reuse
  gaits.json               the winner's gaits: parameters, where each leads
  trajectories/gait-N.csv  time (s), joint targets and angles (rad), pivot pose
                           (mu): for hardware or pandas
  tree.json, report.json   the planner's tree; all that the report has
  map, gaits, convergence, primitives
                           pictures, each as .svg and .png
  store.sqlite             what a stopped run goes on from")]
    Run(Run),

    /// Hand a job to a coordinator and return at once
    #[command(after_help = "\
Example:
  evogait submit quadropod-empty --coordinator http://cluster:7077
Prints the job's id, for `evogait watch ID` and `evogait fetch ID`. Submitting
the same job twice gives the same id.")]
    Submit(Submit),

    /// Follow a job on a coordinator until it ends
    #[command(after_help = "\
Example:
  evogait watch ID
Stopping it with Ctrl-C does not stop the job. Exit code 0 if the job succeeded,
1 if it failed or was cancelled.")]
    Watch(OneJob),

    /// List the jobs of a coordinator, newest first
    #[command(after_help = "\
Examples:
  evogait list --limit 20
  evogait list --state running --json | jq -r '.[].id'")]
    List(List),

    /// Show a job of a coordinator
    #[command(after_help = "\
Examples:
  evogait show ID
  evogait show ID --toml > job.toml")]
    Show(Show),

    /// Pause a job of a coordinator: nothing more of it is handed out
    #[command(after_help = "\
Example:
  evogait pause ID
What its workers compute already may finish and counts. `evogait resume ID` goes
on where it stood, also after the coordinator was restarted.")]
    Pause(OneJob),

    /// Go on with a paused job
    #[command(after_help = "\
Example:
  evogait resume ID")]
    Resume(OneJob),

    /// Do an ended job of a coordinator again from one of its generations on
    #[command(after_help = "\
Examples:
  evogait restart ID
  evogait restart ID --from-generation 40
The new job takes over the generations before; its result has the bits of an
undisturbed run. Without --from-generation a tainted job is done again from where
a value turned out to be wrong. Prints the new job's id.")]
    Restart(Restart),

    /// Cancel a job of a coordinator, for good
    #[command(after_help = "\
Example:
  evogait cancel ID
`evogait submit JOB.toml --again` starts a cancelled job anew.")]
    Cancel(OneJob),

    /// Evaluate one candidate on this machine, with the bits a worker would give
    #[command(after_help = "\
Examples:
  evogait evaluate ID
  evogait evaluate my-job.toml --generation 2 --candidate 7 --genome-file genome.txt
  evogait evaluate ID --generation 2 --candidate 7 --genome=0.31,-1.5,2.25

The first does again what made a job of a coordinator fail: the candidate that
failed, or took its worker down, whenever it was worked on. `evogait show ID`
tells which it was.")]
    Evaluate(Evaluate),

    /// Write the result of a job on a coordinator to a folder
    #[command(after_help = "\
Example:
  evogait fetch ID --out runs/from-cluster
The folder gets the same files as that of `evogait run`.")]
    Fetch(Fetch),

    /// List the workers that are connected to a coordinator
    #[command(after_help = "Example:\n  evogait workers --json")]
    Workers(OnCoordinator),

    /// Tell how many slots the jobs of a coordinator could use, and how many there are
    #[command(after_help = "\
Examples:
  evogait demand
  evogait demand --json | jq .wanted
For scripts that start and stop workers. Nothing is wanted once all jobs have
ended; a job wants as many slots as its generation can fill.")]
    Demand(OnCoordinator),

    /// Tell whether a coordinator serves: exit code 0 if it does, 1 if not
    #[command(after_help = "\
Examples:
  evogait health
  evogait health --alive --coordinator http://standby:7077
  evogait health --process 127.0.0.1:9464
For probes of containers, and for scripts that wait for a coordinator.")]
    Health(Health),

    /// Simulate a stored gait, or the best path of the stored tree, again
    #[command(after_help = "\
Examples:
  evogait replay runs/quadropod-empty-3f2a9c01d4e5 --gait 1 --out gait-1.csv
  evogait replay runs/quadropod-empty-3f2a9c01d4e5 --plan

The CSV of a gait has time (s), joint targets and angles (rad), pivot position
(mu) and rotation (unit quaternion); that of a plan the way of the pivot (mu),
run in three ways: as the tree has it, simulated again, without stops.")]
    Replay(Replay),

    /// Recompute a stored result and compare it bit by bit
    #[command(after_help = "\
Examples:
  evogait verify runs/quadropod-empty-3f2a9c01d4e5
  evogait verify runs/quadropod-empty-3f2a9c01d4e5 --full

Recomputes the winner's score in the search and on the reference setting; --full
all the report has: archive, audits, fresh seeds, friction, gaits, tree, paths.
Exit code 0 if every compared number has the same bits, 1 if not.")]
    Verify(Verify),

    /// Check a job file, and estimate what it costs
    #[command(after_help = "\
Examples:
  evogait validate my-job.toml
  evogait validate my-job.toml --json | jq .estimate

Prints what is wrong, or the resolved job's facts. The estimate times a few
evaluations on this machine.")]
    Validate(Validate),

    /// Measure speed and fidelity on this machine
    #[command(after_help = "\
Examples:
  evogait bench rollout quadropod --settings 30x8,60x16
  evogait bench fidelity quadropod --settings 30x8,60x8 --out bench/quadropod
  evogait bench evaluate quadropod-empty
`evogait bench WHAT --help` says what is measured and how.")]
    Bench(Bench),

    /// Show a robot: facts and picture; export it to MJCF or URDF
    #[command(after_help = "\
Examples:
  evogait robot lizard
  evogait robot lizard --variant E1 --out lizard-e1.svg
  evogait robot my-robot.toml --json
  evogait robot lizard --format mjcf --scale real > lizard.xml
  evogait robot my-robot.urdf

MJCF (MuJoCo) holds bodies, hinges, motors, friction, gravity and the ground;
URDF has no place for gains, friction and gravity, so a comment tells them. One
unit of length of either is 1 mu. What is read of them are trees of hinges from
-90° to 90° with boxes and capsules; a job names such a file as its robot.")]
    Robot(Robot),

    /// Make certificates and tokens for a cluster
    #[command(after_help = "\
Examples:
  evogait certs init certs --host node1.example --host 10.0.0.1
  evogait certs renew certs --host node1.example --host 10.0.0.1
`init` prints the commands that use what it made.")]
    Certs(Certs),

    /// List the robots, environments and jobs that ship, or print one
    #[command(after_help = "\
Examples:
  evogait scenarios
  evogait scenarios show quadropod-empty > my-job.toml")]
    Scenarios(Scenarios),
}

#[derive(Clone, Debug, Args)]
pub struct JobFile {
    /// Job file, or the name of a job that ships
    #[arg(value_name = "JOB.toml")]
    pub job: String,

    /// Replace the job's seed, 0 to 2⁶³ − 1
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = clap::value_parser!(u64).range(0..=i64::MAX as u64))]
    pub seed: Option<u64>,
}

/// What is shown to a coordinator, and whom it may be.
#[derive(Debug, Args)]
pub struct Shown {
    /// Certificate of the CA that signed the coordinator's, PEM; for https:// [default: $EVOGAIT_CA]
    #[arg(long, value_name = "FILE", display_order = 90)]
    pub ca: Option<PathBuf>,

    /// Certificate to show to the coordinator, PEM [default: $EVOGAIT_CERT]
    #[arg(long, value_name = "FILE", display_order = 91)]
    pub cert: Option<PathBuf>,

    /// Its private key, PEM [default: $EVOGAIT_KEY]
    #[arg(long, value_name = "FILE", display_order = 92)]
    pub key: Option<PathBuf>,

    /// File with the token to send [default: $EVOGAIT_TOKEN_FILE; else the token itself is $EVOGAIT_TOKEN]
    #[arg(long, value_name = "FILE", display_order = 93)]
    pub token_file: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct OnCoordinator {
    /// Address of the coordinator; several that stand in for each other are separated by commas [default:
    /// $EVOGAIT_COORDINATOR, else http://127.0.0.1:7077]
    #[arg(long, value_name = "URL")]
    pub coordinator: Option<String>,

    #[command(flatten)]
    pub shown: Shown,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct Health {
    /// Be content with one that answers, whether it serves or stands by
    #[arg(long)]
    pub alive: bool,

    /// Ask a worker or a coordinator on this machine instead, at the address of its --metrics
    #[arg(long, value_name = "ADDRESS:PORT", conflicts_with_all = ["alive", "coordinator"])]
    pub process: Option<SocketAddr>,

    #[command(flatten)]
    pub on: OnCoordinator,
}

#[derive(Debug, Args)]
pub struct OneJob {
    /// The job's id, as `evogait submit` and `evogait list` print it
    pub id: String,

    #[command(flatten)]
    pub on: OnCoordinator,
}

#[derive(Debug, Args)]
pub struct Run {
    #[command(flatten)]
    pub file: JobFile,

    /// Output folder [default: runs/NAME-DIGEST, with the first 12 digits of the job digest]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// Evaluations at once [default: number of cores]; the result does not depend on it
    #[arg(long, value_name = "N", conflicts_with = "coordinator", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub workers: Option<u32>,

    /// Run on this coordinator's workers instead of this machine
    #[arg(long, value_name = "URL")]
    pub coordinator: Option<String>,

    #[command(flatten)]
    pub shown: Shown,

    /// Print the result as JSON at the end
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct Submit {
    #[command(flatten)]
    pub file: JobFile,

    /// Share of the workers relative to other jobs, 1 to 100 [default: 10]
    #[arg(long, value_name = "P", value_parser = clap::value_parser!(u32).range(1..=100))]
    pub priority: Option<u32>,

    /// Start anew even if the coordinator knows this job, as after a cancel
    #[arg(long)]
    pub again: bool,

    #[command(flatten)]
    pub on: OnCoordinator,
}

/// Where a job stands, as `--state` takes it.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
#[allow(missing_docs)]
pub enum State {
    Queued,
    Running,
    Finishing,
    Reporting,
    Succeeded,
    Failed,
    Cancelled,
    Tainted,
}

#[derive(Debug, Args)]
pub struct List {
    /// Only jobs in this state; may be given several times
    #[arg(long, value_name = "STATE")]
    pub state: Vec<State>,

    /// At most so many [default: all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub limit: Option<u32>,

    #[command(flatten)]
    pub on: OnCoordinator,
}

#[derive(Debug, Args)]
pub struct Show {
    /// Print the resolved job file instead
    #[arg(long, conflicts_with = "json")]
    pub toml: bool,

    #[command(flatten)]
    pub job: OneJob,
}

#[derive(Debug, Args)]
pub struct Restart {
    /// The first generation to be done again [default: where the job was tainted]
    #[arg(long, value_name = "G")]
    pub from_generation: Option<u32>,

    /// Start anew even if the job was restarted from there before
    #[arg(long)]
    pub again: bool,

    #[command(flatten)]
    pub job: OneJob,
}

#[derive(Debug, Args)]
pub struct Evaluate {
    /// Job file, the name of a job that ships, or the id of a job on a coordinator
    #[arg(value_name = "JOB.toml|ID")]
    pub job: String,

    /// The candidate's generation, which its random numbers depend on [default: 0]
    #[arg(long, value_name = "G")]
    pub generation: Option<u32>,

    /// Its index in the generation, likewise [default: 0]
    #[arg(long, value_name = "C")]
    pub candidate: Option<u32>,

    /// Its parameters: numbers with commas between them
    #[arg(long, value_name = "NUMBERS", allow_hyphen_values = true, conflicts_with = "genome_file")]
    pub genome: Option<String>,

    /// Its parameters, in a file
    #[arg(long, value_name = "FILE")]
    pub genome_file: Option<PathBuf>,

    /// Ask what is asked about the best candidates after the search, instead of scoring it
    #[arg(long, value_name = "QUESTION")]
    pub question: Option<Question>,

    #[command(flatten)]
    pub on: OnCoordinator,
}

/// A question about a candidate, as `--question` takes it.
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

impl From<Question> for sim_core::finish::Question {
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
pub struct Fetch {
    /// The job's id, as `evogait submit` and `evogait list` print it
    pub id: String,

    /// Output folder [default: runs/NAME-DIGEST, with the first 12 digits of the job digest]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    #[command(flatten)]
    pub on: OnCoordinator,
}

#[derive(Debug, Args)]
#[group(id = "what", required = true, multiple = false)]
pub struct ReplayWhat {
    /// This gait, counted from 1, from the settled start
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub gait: Option<u32>,

    /// The best path of the tree
    #[arg(long)]
    pub plan: bool,
}

#[derive(Debug, Args)]
pub struct Replay {
    /// Output folder of a run, or its result.json
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,

    #[command(flatten)]
    pub what: ReplayWhat,

    /// Write the samples as CSV to this file
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct Verify {
    /// Output folder of a run, or its result.json
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,

    /// Recompute the whole report: archive, audits without reuse, fresh seeds, gaits, paths
    #[arg(long)]
    pub full: bool,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct Validate {
    #[command(flatten)]
    pub file: JobFile,

    /// Skip the cost estimate, which takes the time of one evaluation
    #[arg(long)]
    pub no_estimate: bool,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct Robot {
    /// Name of a robot that ships, or a robot file: TOML, MJCF or URDF
    #[arg(value_name = "NAME|FILE")]
    pub robot: String,

    /// Show it with the failed modules of this variant
    #[arg(long, value_name = "VARIANT")]
    pub variant: Option<String>,

    /// Draw it to this file, .svg or .png; or export it, .xml or .mjcf (MJCF), .urdf
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,

    /// Export it in this format, to standard output without --out [default: as --out ends]
    #[arg(long, value_name = "FORMAT")]
    pub format: Option<RobotFormat>,

    /// Gravity and motors of the export: modules of 1 m, or of 0.105 m [default: paper]
    #[arg(long, value_name = "SCALE")]
    pub scale: Option<RobotScale>,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

/// A format of robots, as `--format` takes it.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
#[allow(missing_docs)]
pub enum RobotFormat {
    Mjcf,
    Urdf,
}

impl From<RobotFormat> for Format {
    fn from(raw: RobotFormat) -> Self {
        match raw {
            RobotFormat::Mjcf => Self::Mjcf,
            RobotFormat::Urdf => Self::Urdf,
        }
    }
}

/// A scale, as `--scale` takes it.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
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
pub struct Certs {
    #[command(subcommand)]
    pub action: CertsAction,
}

#[derive(Debug, Subcommand)]
pub enum CertsAction {
    /// Make a CA, certificates for coordinator, workers and clients, and tokens
    #[command(after_help = "\
Example:
  evogait certs init certs --host node1.example --host 10.0.0.1
Nothing that is there is replaced. Keys and tokens can be read by you alone.")]
    Init(CertsFolder),
    /// Replace the certificates by new ones of the same CA; CA and tokens stay
    #[command(after_help = "\
Example:
  evogait certs renew certs --host node1.example --host 10.0.0.1")]
    Renew(CertsFolder),
}

#[derive(Debug, Args)]
pub struct CertsFolder {
    /// Folder of the certificates
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,

    /// Name or IP address under which a coordinator is dialed, beside this machine's own; may be given several times
    #[arg(long = "host", value_name = "NAME|IP")]
    pub hosts: Vec<Host>,

    /// Days that the certificates are valid
    #[arg(long, value_name = "DAYS", default_value_t = 365, value_parser = clap::value_parser!(u32).range(1..=3650))]
    pub days: u32,
}

#[derive(Debug, Args)]
pub struct Scenarios {
    #[command(subcommand)]
    pub action: Option<ScenariosAction>,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Subcommand)]
pub enum ScenariosAction {
    /// Print the TOML of one
    Show {
        /// Its name; `robots/NAME`, `environments/NAME` or `jobs/NAME` where a name alone is not clear
        name: String,
    },
}
