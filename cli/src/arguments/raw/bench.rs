//! Options of `evogait bench`.

mod fidelity;
mod fleet;

pub use fidelity::BenchFidelity;
pub use fleet::BenchFleet;

use super::number::{duration, seed, tolerance, whole};
use super::{JobFile, RobotScale};
use clap::{Args, Subcommand, ValueEnum};
use sim_core::base::limits::{MAX_REPEATS, MAX_VARIANTS};
use std::path::PathBuf;
use study::setting::PhysicsSetting;

#[derive(Debug, Args)]
pub struct Bench {
    #[command(subcommand)]
    pub what: BenchCommand,
}

#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// Measure the speed of physics: simulated seconds per CPU second
    #[command(after_help = "\
Examples:
  evogait bench rollout
  evogait bench rollout lizard --settings 30x8,60x16,60x16-multibody --gaits 50
  evogait bench rollout quadropod --settings 30x8,200x2-lockstep --gaits 128

Simulates random gaits from the settled start on one thread. A SETTING is
written STEPSxSUBSTEPS: steps per simulated second, substeps per step. The
ending -multibody selects multibody joints, -lockstep the lockstep engine. The
settings take turns gait by gait (with a lockstep setting: in groups of 64
gaits, which that engine simulates together), so their ratio is valid on a busy
machine, too. CPU seconds are those of the measuring thread. Intervals are 95 %
bootstrap intervals over the gaits.")]
    Rollout(BenchRollout),

    /// Measure evaluations of a job, and the shares of their time
    #[command(after_help = "\
Example:
  evogait bench evaluate quadropod-empty --evaluations 20

Evaluates candidates of the job's first generation, one after the other on one
thread. On the lockstep engine as many candidates are evaluated together as one
slot of this machine gets of a generation. Shares are shares of CPU time:
physics (the engine), target tables (oscillators), planning (nearest neighbours,
obstacles, transitions), and the rest (fitness).")]
    Evaluate(BenchEvaluate),

    /// Measure error and speed of engine settings against a converged reference
    #[command(after_help = fidelity::FIDELITY_HELP)]
    Fidelity(BenchFidelity),

    /// Measure the planner alone, on known transitions
    #[command(after_help = "\
Example:
  evogait bench plan quadropod-empty --iterations 20000

Takes that of the job's first candidates whose gaits lead farthest, and
simulates all its transitions. Then it grows trees from these transitions alone.
Each tree has twice the iterations of the previous one.")]
    Plan(BenchPlan),

    /// Measure the cost of dispatching evaluations from a coordinator to workers
    #[command(after_help = "\
Examples:
  evogait bench dispatch quadropod-quick
  evogait bench dispatch my-job.toml --slots 1,2,4,8 --evaluations 500

Each line of the table is a process of its own with a coordinator, a store on
disk and one worker with the given number of slots, over a loopback connection.
The job has one generation of --evaluations candidates, so slots wait for each
other only once. The time is measured from the end of the job's preparation to
the seal of that generation. Loads:
  job      the job as given
  plain    the job with reuse_tolerance = 0
  trivial  a job of almost no work, which shows the cost of dispatching alone
Memory is the peak resident set of the process.")]
    Dispatch(BenchDispatch),

    /// Measure how many light workers a coordinator serves, and how busy it keeps them
    #[command(after_help = fleet::FLEET_HELP)]
    Fleet(BenchFleet),

    /// Measure the effect of transition reuse: score the same genomes with and without it
    #[command(after_help = "\
Examples:
  evogait bench reuse --out bench/reuse
  evogait bench reuse my-job.toml --robot lizard --genomes 40 --gait-seconds 4
  evogait bench reuse --run runs/quadropod-empty-3f2a9c01d4e5 --environments empty

Half of the genomes are from the first generation. The other half are from the
last generations of a genetic algorithm, which runs first, or of the stored run.
Each genome is scored
  - without reuse (plain): every expanded node is simulated
  - with the job's own reuse, with other tolerances and with other numbers of
    variants, on the same random streams
  - on other random streams (--seeds), which shows the effect of chance alone
  - as the mean of several trees that share a table (--repeats)
Intervals are 95 % bootstrap intervals over the genomes. The literal method
simulates K x k rollouts, also those of transitions that are already known.

Files in the output folder:
  reuse.md, reuse.json          the tables; the JSON has every score
  scatter-ENVIRONMENT.svg, .png scores with reuse against plain ones")]
    Reuse(BenchReuse),

    /// Compare the scores and the ranking of genomes between engine settings
    #[command(after_help = "\
Examples:
  evogait bench fitness --out bench/fitness
  evogait bench fitness --settings 200x2-lockstep,30x8,60x16,240x8 --reference 480x8
  evogait bench fitness --runs runs/one,runs/two --genomes 0

Takes genomes of all generations, from first to last, of stored runs or of a
genetic algorithm that runs first on the job's own setting. Each genome is
scored with every setting and with the job's own reuse, as in a job. The score
is the mean over --seeds trees, which grow towards the same random places with
every setting. The ceiling is the reference against itself from starts whose
joint angles differ by a millionth rad. Stored runs must be of one job and may
have any seeds. Of each stored run the published winner and the search's best
are scored, too. \"Kept\" is the reference's score divided by that of the first
setting.

Files in the output folder:
  fitness.md, fitness.json      the tables; the JSON has every tree's score
  scatter.svg, scatter.png      scores against the reference's, a point a genome")]
    Fitness(BenchFitness),

    /// Search for faults that an engine does not report, on random robots, gaits and starts
    #[command(after_help = "\
Examples:
  evogait bench soundness
  evogait bench soundness --rollouts 1000000 --duration 1
  evogait bench soundness --setting 30x8 --rollouts 500

Simulates random trees of 4 to 16 CoSMO modules with random gaits. They are
thrown in any orientation from up to 1 mu above the ground. The engine reports
rollouts that leave its bounds as unstable. An observer that uses only the poses
of the robot checks the same bounds: finite numbers, speed, depth in the ground,
kinetic energy, and energy beyond what the motors can supply. The command fails
if the observer finds a violation that the engine did not report.")]
    Soundness(BenchSoundness),
}

/// Robot on flat ground.
#[derive(Clone, Debug, Args)]
pub struct Subject {
    /// Name of a robot that ships, or a robot file
    #[arg(value_name = "NAME|FILE", default_value = "quadropod")]
    pub robot: String,

    /// Use the robot with the failed modules of this variant
    #[arg(long, value_name = "VARIANT")]
    pub variant: Option<String>,

    /// Size of the modules, which decides gravity and motors: paper for 1 m, real for 0.105 m
    #[arg(long, value_enum, default_value_t = RobotScale::Paper)]
    pub scale: RobotScale,
}

#[derive(Debug, Args)]
pub struct BenchRollout {
    #[command(flatten)]
    pub subject: Subject,

    /// Engine settings to measure [default: the default setting of the scale]
    #[arg(long, value_name = "SETTING,…", value_delimiter = ',')]
    pub settings: Vec<PhysicsSetting>,

    /// Number of random gaits
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = whole(1..=100_000))]
    pub gaits: u32,

    /// Duration of each gait, s
    #[arg(long, value_name = "S", default_value = "10", value_parser = duration)]
    pub duration: f64,

    /// Seed of the gaits
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = seed())]
    pub seed: u64,

    /// Print JSON instead of text
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchEvaluate {
    #[command(flatten)]
    pub file: JobFile,

    /// Number of evaluations
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = whole(1..=1_000_000))]
    pub evaluations: u32,

    /// Print JSON instead of text
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchPlan {
    #[command(flatten)]
    pub file: JobFile,

    /// Iterations of the largest tree
    #[arg(long, value_name = "K", default_value_t = 12_800, value_parser = whole(100..=100_000))]
    pub iterations: u32,

    /// Number of candidates to choose from
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = whole(1..=10_000))]
    pub candidates: u32,

    /// Print JSON instead of text
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchDispatch {
    #[command(flatten)]
    pub file: JobFile,

    /// Numbers of slots to measure [default: 1, 2, 4, … up to the number of cores]
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = whole(1..=1024))]
    pub slots: Vec<u32>,

    /// Number of evaluations of the load job
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = whole(1..=10_000))]
    pub evaluations: u32,

    /// Number of evaluations of the load plain, each of which takes far longer; 0 skips it
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = whole(0..=10_000))]
    pub plain: u32,

    /// Number of evaluations of the load trivial; 0 skips it
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = whole(0..=10_000))]
    pub trivial: u32,

    /// Measure this one line in this process
    #[arg(long, value_enum, hide = true)]
    pub line: Option<Load>,

    /// Print JSON instead of text
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchReuse {
    /// Job file, or the name of a job that ships: source of gaits, planner, fitness and physics
    #[arg(value_name = "JOB.toml", default_value = "quadropod-empty")]
    pub job: String,

    /// Seed instead of the job's, 0 to 2⁶³ − 1
    #[arg(long, value_name = "S", value_parser = seed())]
    pub seed: Option<u64>,

    /// Robot instead of the job's: a name that ships, or a robot file
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<String>,

    /// Take job and genomes from the folder of this run
    #[arg(long, value_name = "DIR", conflicts_with_all = ["job", "seed", "robot", "generations"])]
    pub run: Option<PathBuf>,

    /// Environments to score in: names that ship, or files
    #[arg(long, value_name = "NAME|FILE,…", value_delimiter = ',', default_value = "empty,column")]
    pub environments: Vec<String>,

    /// Number of genomes
    #[arg(long, value_name = "G", default_value_t = 100, value_parser = whole(2..=10_000))]
    pub genomes: u32,

    /// Number of generations of the search that supplies half of the genomes
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = whole(2..=10_000))]
    pub generations: u32,

    /// Reuse tolerances to compare with the job's, rad
    #[arg(long, value_name = "T,…", value_delimiter = ',', default_value = "0.02,0.05,0.1,0.2", value_parser = tolerance)]
    pub tolerances: Vec<f64>,

    /// Numbers of variants to compare at each tolerance
    #[arg(long, value_name = "V,…", value_delimiter = ',', default_value = "1,4", value_parser = whole(1..=MAX_VARIANTS))]
    pub variants: Vec<u32>,

    /// Number of other draws of the random streams, with the job's own reuse
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = whole(0..=1000))]
    pub seeds: u32,

    /// Numbers of trees per evaluation, which share a table
    #[arg(long, value_name = "R,…", value_delimiter = ',', default_value = "1,3,5", value_parser = whole(1..=MAX_REPEATS))]
    pub repeats: Vec<u32>,

    /// Duration of each gait instead of the job's, s; plain evaluations of long gaits take long
    #[arg(long, value_name = "S", value_parser = duration)]
    pub gait_seconds: Option<f64>,

    /// Number of evaluations at once [default: number of cores]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = whole(1..=1024))]
    pub threads: Option<u32>,

    /// Write the tables and pictures to this folder
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// Print JSON instead of text
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchFitness {
    /// Job file, or the name of a job that ships: source of gaits, planner, fitness and physics
    #[arg(value_name = "JOB.toml", default_value = "quadropod-empty")]
    pub job: String,

    /// Seed instead of the job's, 0 to 2⁶³ − 1
    #[arg(long, value_name = "S", value_parser = seed())]
    pub seed: Option<u64>,

    /// Robot instead of the job's: a name that ships, or a robot file
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<String>,

    /// Environment instead of the job's: a name that ships, or a file
    #[arg(long, value_name = "NAME|FILE")]
    pub environment: Option<String>,

    /// Duration of each gait instead of the job's, s
    #[arg(long, value_name = "S", value_parser = duration)]
    pub gait_seconds: Option<f64>,

    /// Take job, genomes and winners from the folders of these runs
    #[arg(long, value_name = "DIR,…", value_delimiter = ',', conflicts_with_all = ["job", "seed", "robot", "gait_seconds", "generations"])]
    pub runs: Vec<PathBuf>,

    /// Engine settings to compare [default: the job's own, the default of rapier at its scale, that of its finish]
    #[arg(long, value_name = "SETTING,…", value_delimiter = ',')]
    pub settings: Vec<PhysicsSetting>,

    /// Setting to compare the others with [default: 480x8 for the scale paper, 960x16 for real]
    #[arg(long, value_name = "SETTING")]
    pub reference: Option<PhysicsSetting>,

    /// Number of genomes, from all generations
    #[arg(long, value_name = "G", default_value_t = 100, value_parser = whole(0..=10_000))]
    pub genomes: u32,

    /// Number of trees that each genome is scored on
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = whole(1..=1000))]
    pub seeds: u32,

    /// Number of generations of the search that supplies the genomes
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = whole(2..=10_000))]
    pub generations: u32,

    /// Number of evaluations at once [default: number of cores]; only times depend on it
    #[arg(long, value_name = "N", value_parser = whole(1..=1024))]
    pub threads: Option<u32>,

    /// Write the tables and the picture to this folder
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// Print JSON instead of text
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchSoundness {
    /// Engine setting to check
    #[arg(long, value_name = "SETTING", default_value = "200x2-lockstep")]
    pub setting: PhysicsSetting,

    /// Size of the robots' modules, which decides gravity and motors: paper for 1 m, real for 0.105 m
    #[arg(long, value_enum, default_value_t = RobotScale::Paper)]
    pub scale: RobotScale,

    /// Number of rollouts; each robot gets 64
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = whole(1..=100_000_000))]
    pub rollouts: u32,

    /// Duration of each rollout, s
    #[arg(long, value_name = "S", default_value = "1", value_parser = duration)]
    pub duration: f64,

    /// Seed of robots, gaits and starts
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = seed())]
    pub seed: u64,

    /// Number of robots simulated at once [default: number of cores]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = whole(1..=1024))]
    pub threads: Option<u32>,

    /// Print JSON instead of text
    #[arg(long, display_order = 99)]
    pub json: bool,
}

/// Load that a line of `evogait bench dispatch` measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Load {
    /// The job as given.
    Job,
    /// The job without reuse: every expansion is simulated.
    Plain,
    /// A job of almost no work.
    Trivial,
}
