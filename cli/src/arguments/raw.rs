//! The command line as it is typed: names, help and examples. What defaults mean is settled in the parent module.

mod bench;
mod coordinator;
mod job;
mod number;
mod shell;

pub use bench::{
    Bench, BenchCommand, BenchDispatch, BenchEvaluate, BenchFidelity, BenchFitness, BenchFleet, BenchPlan, BenchReuse,
    BenchRollout, BenchSoundness, Load, Subject,
};
pub use coordinator::{
    Certs, CertsAction, CertsFolder, Fetch, Health, List, OnCoordinator, OneJob, Restart, Show, Shown, State, Submit,
};
pub use job::{
    Compare, Evaluate, JobFile, Plan, Replay, Robot, RobotFormat, RobotScale, Run, RunTo, Scenarios, ScenariosAction,
    Simulate, SimulateWhat, Validate, Verify,
};

pub use shell::{Completions, Man};

use clap::{Parser, Subcommand};

/// Where a coordinator listens unless told otherwise.
pub const DEFAULT_COORDINATOR: &str = "http://127.0.0.1:7077";
/// Environment variable that names the coordinator.
pub const COORDINATOR_VARIABLE: &str = "EVOGAIT_COORDINATOR";

#[derive(Debug, Parser)]
#[command(
    name = "evogait",
    version,
    about = "Evolve sets of gaits for modular robots, scored by what a motion planner can do with them, and plan with them.",
    after_help = "\
Begin with:
  evogait scenarios                      what ships: robots, environments, jobs
  evogait run quadropod-empty            evolve a gait set on this machine
  evogait verify runs/quadropod-empty-*  recompute the result, compare its bits
  evogait plan runs/quadropod-empty-* --environment reuse-2
                                         plan elsewhere with the gaits it found

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
    /// Run a job file: the whole job on this machine, or on a coordinator's workers
    #[command(after_help = "\
Examples:
  evogait run quadropod-empty
  evogait run my-job.toml --seed 7 --out runs/seven
  evogait run my-job.toml --coordinator http://cluster:7077

Without --coordinator and EVOGAIT_COORDINATOR, and with --workers, coordinator
and workers run inside this process. Stop it with Ctrl-C, SIGTERM or SIGHUP
whenever you like: the same command goes on where it stopped, and says so if the
job is done.

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

    /// Plan with the gaits of a run, in its environment or in another one
    #[command(after_help = "\
Examples:
  evogait plan runs/quadropod-empty-3f2a9c01d4e5 --environment reuse-2
  evogait plan runs/quadropod-empty-3f2a9c01d4e5 --environment my-map.toml --seeds 50
  evogait plan RUN --environment reuse-3 --iterations 100 --whole-trees

Writes a job file with procedure = \"plan\" and runs it: the winner's gaits are in
it, so job.toml can be run again anywhere. A tree ends at the goal if the
environment has one, unless --whole-trees is given. The result does not depend on
the number of workers.

Files in the output folder:
  result.json              trees that reached the goal; distance to it, coverage,
                           length of plans as mean and deviation; the best plan
  job.toml                 the job with every setting; `evogait run` takes it
  plans.csv, plans.json    a row a tree; all trees' plans, step by step
  plan.csv                 the best plan: gait, when (s), where it leads (mu, rad)
  paths.csv                that plan run in three ways: as the tree has it,
                           simulated again, without stops
  tree.json, gaits.json    the best tree; the gaits and where each leads
  map, gaits               pictures, each as .svg and .png")]
    Plan(Plan),

    /// Simulate a motion again and again, with friction, motors, joints or the start varied
    #[command(after_help = "\
Examples:
  evogait simulate runs/quadropod-empty-3f2a9c01d4e5 --gait 1
  evogait simulate RUN --plan --repeats 50 --friction 0.6..1.0
  evogait simulate RUN --plan --replan --friction 0.6..1.0 --dead-joints 1
  evogait simulate --robot lizard --stand 5
  evogait simulate --robot my-robot.urdf --targets targets.csv

Writes a job file with procedure = \"simulate\" and runs it: the motion is in it,
so job.toml can be run again anywhere. The motion is carried out once with nothing
varied, and then in repeats that draw from the ranges by random numbers of their
own. A plan runs in two ways: each gait from rest at the end of the one before, as
the planner assumes, and without a stop. A run succeeds that ends soundly, on the
map, without having touched an obstacle, and within the goal's radius.

Files in the output folder:
  result.json              success with its 95 % interval; distances, work of the
                           motors, contacts as mean, deviation, median, extremes
  job.toml                 the job with every setting; `evogait run` takes it
  runs.csv                 a row a run: what was drawn, how it ended, where
  motion-WAY.csv           the run with nothing varied, sample by sample: time (s),
                           targets and angles (rad), pose (mu), which bodies touch
                           the ground
  paths.csv                the pivot's path in every run
  simulation.json          all of it
  paths-WAY                pictures, each as .svg and .png")]
    Simulate(Box<Simulate>),

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

    /// Compare runs: settings that differ, scores, digests; draw their curves
    #[command(after_help = "\
Examples:
  evogait compare runs/quadropod-empty-*
  evogait compare runs/a runs/b --out curves.png
  evogait compare runs/a runs/b --json | jq .settings

Runs may evolve or plan. Curves are of runs that evolved for the same score.")]
    Compare(Compare),

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
  evogait robot my-robot.urdf --unit 0.065 --out my-robot.toml

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

    /// Print completions for a shell
    #[command(after_help = "\
Examples:
  evogait completions bash > ~/.local/share/bash-completion/completions/evogait
  evogait completions zsh > ~/.zfunc/_evogait
  evogait completions fish > ~/.config/fish/completions/evogait.fish")]
    Completions(Completions),

    /// Print the man page, or write the pages of all commands
    #[command(after_help = "\
Examples:
  evogait man | man -l -
  evogait man --out ~/.local/share/man/man1

With --out, pages of an earlier version are replaced.")]
    Man(Man),
}
