//! `evogait bench` as it is typed.

mod fleet;

pub use fleet::BenchFleet;

use super::number::{duration, seed, tolerance, whole};
use super::{JobFile, RobotScale};
use clap::{Args, Subcommand, ValueEnum};
use sim_core::base::limits::{MAX_REPEATS, MAX_VARIANTS};
use std::path::PathBuf;
use study::setting::Setting;

#[derive(Debug, Args)]
pub struct Bench {
    #[command(subcommand)]
    pub what: BenchCommand,
}

#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// Physics alone: simulated seconds a CPU second
    #[command(after_help = "\
Examples:
  evogait bench rollout
  evogait bench rollout lizard --settings 30x8,60x16,60x16-multibody --gaits 50
  evogait bench rollout quadropod --settings 30x8,200x2-lockstep --gaits 128

Random gaits from the settled start, on one thread. A setting is steps a second
x substeps of a step, with -multibody for multibody joints, -lockstep for the
lockstep engine. Settings take turns gait by gait (with a lockstep one: 64 gaits
by 64, which it simulates at once), so that their ratio holds on a busy machine
too. CPU seconds are those of the own thread. Intervals are 95 % bootstrap
intervals over the gaits.")]
    Rollout(BenchRollout),

    /// Whole evaluations of a job, and what their time goes to
    #[command(after_help = "\
Example:
  evogait bench evaluate quadropod-empty --evaluations 20

Candidates of the job's first generation, one after the other on one thread; on
the lockstep engine as many at once as a slot of this machine gets of a generation.
Shares are of CPU time: physics (the engine), target tables (oscillators),
planning (nearest neighbours, obstacles, transitions), the rest (fitness).")]
    Evaluate(BenchEvaluate),

    /// How near engine settings come to a converged reference, and at what speed
    #[command(after_help = "\
Examples:
  evogait bench fidelity quadropod --settings 30x8,60x16,240x4 --out bench/quadropod
  evogait bench fidelity --gaits runs/quadropod-empty-3f2a9c01d4e5 --random 0
  evogait bench fidelity lizard --random 10 --evolved 10 --duration 2
  evogait bench fidelity quadropod --settings 30x8,200x2-lockstep
  evogait bench fidelity lizard --environment stairs --settings 200x2-lockstep
  evogait bench fidelity quadropod --table scenarios/fidelity.toml

The same gaits, from the same settled start, with every setting and with the
reference. Errors are those of the pivot's pose after the gait; the rank
correlation is Spearman's, of the distances travelled. Two lines more put them
into perspective: the ceiling is the reference against itself with joint angles
of the start off by a millionth rad; the halved steps are the reference against
one with twice its substeps, and one with twice its steps. docs/performance.md
says how to read them.

Settings of both engines may be compared with a reference of either. --table
measures settings of the lockstep engine against its converged reference (unless
said otherwise its own, and those of a half, a quarter and an eighth of its step) and
keeps them as rows of the table by which engine = \"auto\" chooses;
tests/fidelity-table.sh does it for every robot that ships.

Evolved gaits are those of a stored run's winner (--gaits), or evolved on the
spot: genetic algorithms of 8 generations of 17 candidates of two gaits of 4 s,
for coverage, as many as it takes (34 gaits each, some seconds), on the engine of
the reference. With the defaults nearly all time goes to the reference: some
minutes.

Files in the output folder:
  fidelity.md, fidelity.json    the tables
  frontier.svg, frontier.png    speed against rank correlation and error")]
    Fidelity(BenchFidelity),

    /// The planner alone, on known transitions
    #[command(after_help = "\
Example:
  evogait bench plan quadropod-empty --iterations 20000

Of the job's first candidates the one whose gaits lead farthest is taken, all its
transitions are simulated, and then trees are grown from them alone: each of
twice the iterations of the one before.")]
    Plan(BenchPlan),

    /// Coordinator and workers: what dispatching an evaluation costs
    #[command(after_help = "\
Examples:
  evogait bench dispatch quadropod-quick
  evogait bench dispatch my-job.toml --slots 1,2,4,8 --evaluations 500

Each line is a process of its own with a coordinator, a store on disk and one
worker of so many slots, over a loopback connection. The job has one generation
of --evaluations candidates, timed from the end of the job's preparation to the
seal of the generation, so that slots wait for each other only once. `plain` is
the job with reuse_tolerance = 0; `trivial` is a job of almost no work, which
shows what dispatching alone costs. Memory is the process' peak resident set.")]
    Dispatch(BenchDispatch),

    /// A coordinator and thousands of light workers: what it bears, and how busy it keeps them
    #[command(after_help = fleet::FLEET_HELP)]
    Fleet(BenchFleet),

    /// What transition reuse changes: the same genomes with and without it
    #[command(after_help = "\
Examples:
  evogait bench reuse --out bench/reuse
  evogait bench reuse my-job.toml --robot lizard --genomes 40 --gait-seconds 4
  evogait bench reuse --run runs/quadropod-empty-3f2a9c01d4e5 --environments empty

Half of the genomes are a first generation's, half those of the last generations
of a genetic algorithm run on the spot (or of the stored run). Each is scored
without reuse (plain: every expanded node simulated), with the job's own reuse,
with other tolerances and variants, on the same random streams; on other streams
(--seeds), which shows what luck alone changes; and as the mean of several trees
that share a table (--repeats). Intervals are 95 % bootstrap intervals over the
genomes. The literal method simulates K x k rollouts whatever was expanded before.

Files in the output folder:
  reuse.md, reuse.json          the tables; the JSON has every score
  scatter-ENVIRONMENT.svg, .png scores with reuse against plain ones")]
    Reuse(BenchReuse),

    /// Do engine settings agree on what genomes are worth?
    #[command(after_help = "\
Examples:
  evogait bench fitness --out bench/fitness
  evogait bench fitness --settings 200x2-lockstep,30x8,60x16,240x8 --reference 480x8
  evogait bench fitness --runs runs/one,runs/two --genomes 0

Genomes of all ages (first generation to last) of a genetic algorithm run on the
spot on the job's own setting, or of stored runs. Each is scored with every
setting as a job scores it, with the job's own reuse, but as the mean over --seeds
trees, which grow towards the same random places with every setting. The ceiling
is the reference against itself from starts whose joint angles are off by a
millionth rad. Of stored runs (of one job, with any seeds) the published winner
and the search's best are scored too: what is kept is the reference's score over
that of the first setting.

Files in the output folder:
  fitness.md, fitness.json      the tables; the JSON has every tree's score
  scatter.svg, scatter.png      scores against the reference's, a point a genome")]
    Fitness(BenchFitness),

    /// Random robots, gaits and starts: does the engine report all that goes wrong?
    #[command(after_help = "\
Examples:
  evogait bench soundness
  evogait bench soundness --rollouts 1000000 --duration 1
  evogait bench soundness --setting 30x8 --rollouts 500

Random trees of 4 to 16 CoSMO modules, thrown from up to 1 mu above the ground in
any orientation, with random gaits. The engine reports rollouts that leave its
bounds as unstable. An observer that sees only where the robot was looks for
bounds left that were not reported: numbers, speed, depth in the ground, kinetic
energy, and energy that no motor can have given. There should be none; if there
are, the command fails.")]
    Soundness(BenchSoundness),
}

/// A robot on flat ground.
#[derive(Clone, Debug, Args)]
pub struct Subject {
    /// Name of a robot that ships, or a robot file
    #[arg(value_name = "NAME|FILE", default_value = "quadropod")]
    pub robot: String,

    /// Take it with the failed modules of this variant
    #[arg(long, value_name = "VARIANT")]
    pub variant: Option<String>,

    /// How big it is, which decides gravity and motors
    #[arg(long, value_enum, default_value_t = RobotScale::Paper)]
    pub scale: RobotScale,
}

#[derive(Debug, Args)]
pub struct BenchRollout {
    #[command(flatten)]
    pub subject: Subject,

    /// Engine settings to time [default: that of the scale]
    #[arg(long, value_name = "SETTING,…", value_delimiter = ',')]
    pub settings: Vec<Setting>,

    /// Random gaits
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = whole(1..=100_000))]
    pub gaits: u32,

    /// How long each is applied, s
    #[arg(long, value_name = "S", default_value = "10", value_parser = duration)]
    pub duration: f64,

    /// Seed of the gaits
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = seed())]
    pub seed: u64,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchEvaluate {
    #[command(flatten)]
    pub file: JobFile,

    /// How many
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = whole(1..=1_000_000))]
    pub evaluations: u32,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchFidelity {
    #[command(flatten)]
    pub subject: Subject,

    /// On the terrain of this environment (name or file), from its start
    #[arg(long, value_name = "NAME")]
    pub environment: Option<String>,

    /// Engine settings to compare [default: that of the scale, on the reference's engine]
    #[arg(long, value_name = "SETTING,…", value_delimiter = ',')]
    pub settings: Vec<Setting>,

    /// The converged setting [default: 480x8 for the scale paper, 960x16 for real; where all settings are lockstep,
    /// 1600x4-lockstep and 4800x4-lockstep]
    #[arg(long, value_name = "SETTING")]
    pub reference: Option<Setting>,

    /// Random gaits
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = whole(0..=10_000))]
    pub random: u32,

    /// Evolved gaits
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = whole(0..=10_000))]
    pub evolved: u32,

    /// Take robot, physics, gait duration and evolved gaits from this run's folder
    #[arg(long, value_name = "DIR", conflicts_with_all = ["robot", "variant", "scale", "duration", "environment"])]
    pub gaits: Option<PathBuf>,

    /// How long each is applied, s
    #[arg(long, value_name = "S", default_value = "10", value_parser = duration)]
    pub duration: f64,

    /// Seed of the gaits
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = seed())]
    pub seed: u64,

    /// Gaits at once; speeds are truest with 1
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = whole(1..=1024))]
    pub threads: u32,

    /// Write tables and picture to this folder
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// Keep the settings of the lockstep engine as rows of this file
    #[arg(long, value_name = "FILE", conflicts_with_all = ["gaits", "environment"])]
    pub table: Option<PathBuf>,

    /// Print JSON
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

    /// Candidates to choose from
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = whole(1..=10_000))]
    pub candidates: u32,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchDispatch {
    #[command(flatten)]
    pub file: JobFile,

    /// Numbers of slots [default: 1, 2, 4, … up to the number of cores]
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = whole(1..=1024))]
    pub slots: Vec<u32>,

    /// Evaluations of the job
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = whole(1..=10_000))]
    pub evaluations: u32,

    /// Evaluations of the job with reuse_tolerance = 0, which take far longer; 0 leaves it out
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = whole(0..=10_000))]
    pub plain: u32,

    /// Evaluations of almost no work; 0 leaves them out
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = whole(0..=10_000))]
    pub trivial: u32,

    /// Measure this one line, in this process
    #[arg(long, value_enum, hide = true)]
    pub line: Option<Load>,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchReuse {
    /// Job file, or the name of a job that ships: gaits, planner, fitness, physics
    #[arg(value_name = "JOB.toml", default_value = "quadropod-empty")]
    pub job: String,

    /// Replace the job's seed, 0 to 2⁶³ − 1
    #[arg(long, value_name = "S", value_parser = seed())]
    pub seed: Option<u64>,

    /// Replace the job's robot: a name that ships, or a robot file
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<String>,

    /// Take job and genomes from this run's folder
    #[arg(long, value_name = "DIR", conflicts_with_all = ["job", "seed", "robot", "generations"])]
    pub run: Option<PathBuf>,

    /// Environments to score in: names that ship, or files
    #[arg(long, value_name = "NAME|FILE,…", value_delimiter = ',', default_value = "empty,column")]
    pub environments: Vec<String>,

    /// Genomes
    #[arg(long, value_name = "G", default_value_t = 100, value_parser = whole(2..=10_000))]
    pub genomes: u32,

    /// Generations of the evolution that half of them are from
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = whole(2..=10_000))]
    pub generations: u32,

    /// Tolerances to compare besides the job's
    #[arg(long, value_name = "T,…", value_delimiter = ',', default_value = "0.02,0.05,0.1,0.2", value_parser = tolerance)]
    pub tolerances: Vec<f64>,

    /// Numbers of variants to compare at each tolerance
    #[arg(long, value_name = "V,…", value_delimiter = ',', default_value = "1,4", value_parser = whole(1..=MAX_VARIANTS))]
    pub variants: Vec<u32>,

    /// Other draws of random streams, with the job's own reuse
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = whole(0..=1000))]
    pub seeds: u32,

    /// Numbers of trees an evaluation, which share a table
    #[arg(long, value_name = "R,…", value_delimiter = ',', default_value = "1,3,5", value_parser = whole(1..=MAX_REPEATS))]
    pub repeats: Vec<u32>,

    /// Replace how long each gait is applied, s: plain evaluations take long
    #[arg(long, value_name = "S", value_parser = duration)]
    pub gait_seconds: Option<f64>,

    /// Evaluations at once [default: number of cores]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = whole(1..=1024))]
    pub threads: Option<u32>,

    /// Write tables and pictures to this folder
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchFitness {
    /// Job file, or the name of a job that ships: gaits, planner, fitness, physics
    #[arg(value_name = "JOB.toml", default_value = "quadropod-empty")]
    pub job: String,

    /// Replace the job's seed, 0 to 2⁶³ − 1
    #[arg(long, value_name = "S", value_parser = seed())]
    pub seed: Option<u64>,

    /// Replace the job's robot: a name that ships, or a robot file
    #[arg(long, value_name = "NAME|FILE")]
    pub robot: Option<String>,

    /// Replace the job's environment: a name that ships, or a file
    #[arg(long, value_name = "NAME|FILE")]
    pub environment: Option<String>,

    /// Replace how long each gait is applied, s
    #[arg(long, value_name = "S", value_parser = duration)]
    pub gait_seconds: Option<f64>,

    /// Take job, genomes and winners from these runs' folders
    #[arg(long, value_name = "DIR,…", value_delimiter = ',', conflicts_with_all = ["job", "seed", "robot", "gait_seconds", "generations"])]
    pub runs: Vec<PathBuf>,

    /// Engine settings to compare [default: the job's own, rapier's of its scale, its finish's]
    #[arg(long, value_name = "SETTING,…", value_delimiter = ',')]
    pub settings: Vec<Setting>,

    /// The setting that they are compared with [default: 480x8 for the scale paper, 960x16 for real]
    #[arg(long, value_name = "SETTING")]
    pub reference: Option<Setting>,

    /// Genomes of all ages
    #[arg(long, value_name = "G", default_value_t = 100, value_parser = whole(0..=10_000))]
    pub genomes: u32,

    /// Trees that each is scored on
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = whole(1..=1000))]
    pub seeds: u32,

    /// Generations of the evolution that they are from
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = whole(2..=10_000))]
    pub generations: u32,

    /// Evaluations at once [default: number of cores]; only times depend on it
    #[arg(long, value_name = "N", value_parser = whole(1..=1024))]
    pub threads: Option<u32>,

    /// Write tables and picture to this folder
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct BenchSoundness {
    /// Engine setting
    #[arg(long, value_name = "SETTING", default_value = "200x2-lockstep")]
    pub setting: Setting,

    /// How big the robots are, which decides gravity and motors
    #[arg(long, value_enum, default_value_t = RobotScale::Paper)]
    pub scale: RobotScale,

    /// Rollouts, 64 a robot
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = whole(1..=100_000_000))]
    pub rollouts: u32,

    /// How long each is, s
    #[arg(long, value_name = "S", default_value = "1", value_parser = duration)]
    pub duration: f64,

    /// Seed of robots, gaits and starts
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = seed())]
    pub seed: u64,

    /// Robots at once [default: number of cores]; the result does not depend on it
    #[arg(long, value_name = "N", value_parser = whole(1..=1024))]
    pub threads: Option<u32>,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

/// What is dispatched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Load {
    /// The job as it is.
    Job,
    /// The job with every expansion simulated.
    Plain,
    /// Almost no work.
    Trivial,
}
