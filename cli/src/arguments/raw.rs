//! Syntax of the command line: names, help texts and examples. The parent module resolves the defaults.

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
    Sequence, SequenceAction, Simulate, SimulateWhat, Validate, Verify,
};

pub use shell::{Completions, Man};

use clap::{Parser, Subcommand};

/// Default address of a coordinator.
pub const DEFAULT_COORDINATOR: &str = "http://127.0.0.1:7077";
/// Environment variable that names the coordinator.
pub const COORDINATOR_VARIABLE: &str = "EVOGAIT_COORDINATOR";

#[derive(Debug, Parser)]
#[command(
    name = "evogait",
    version,
    about = "Evolve sets of gaits for modular robots, and plan motions with them. The score of a set is what a motion planner achieves with it.",
    after_help = "\
Start here:
  evogait scenarios                      list the robots, environments and jobs
                                         that ship with the program
  evogait run quadropod-empty            evolve a gait set on this machine
  evogait verify runs/quadropod-empty-*  compute its result again, compare bits
  evogait plan runs/quadropod-empty-* --environment reuse-2
                                         plan with its gaits in another
                                         environment

Exit codes: 0 success, 1 failure, 2 wrong usage, 130 interrupted.",
    propagate_version = true,
    disable_help_subcommand = true,
    max_term_width = 120
)]
pub struct Cli {
    /// Print no progress and no summary, only errors and the output of --json
    #[arg(short, long, global = true, display_order = 100)]
    pub quiet: bool,

    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a job file on this machine or on the workers of a coordinator
    #[command(after_help = "\
Examples:
  evogait run quadropod-empty
  evogait run my-job.toml --seed 7 --out runs/seven
  evogait run my-job.toml --coordinator http://cluster:7077

The job runs inside this process if --workers is given, or if neither
--coordinator nor EVOGAIT_COORDINATOR is set. Ctrl-C, SIGTERM and SIGHUP stop
it. Enter the same command again to continue where it stopped. If the job is
done, the command reports that and computes nothing.

Files in the output folder:
  result.json              best score, genome with names, digests, counts, seed
  job.toml                 the job with all settings; input for `evogait run`
  history.csv              scores of each generation: min, quartiles, max, mean,
                           best so far
  archive.csv              scores of the best genomes on the reference setting
  audits.csv               scores without reuse of each new best genome
  gaits.json               gaits of the winner: parameters and displacement
  trajectories/gait-N.csv  time (s), joint targets and angles (rad), pivot pose
                           (mu), as input for hardware or pandas
  tree.json                the planner's tree
  report.json              all data of the report
  map, gaits, convergence, primitives
                           pictures, each as .svg and .png
  store.sqlite             state of the job, from which a stopped run continues")]
    Run(Run),

    /// Plan with the gaits of a run, in its own environment or in another one
    #[command(after_help = "\
Examples:
  evogait plan runs/quadropod-empty-3f2a9c01d4e5 --environment reuse-2
  evogait plan runs/quadropod-empty-3f2a9c01d4e5 --environment my-map.toml --seeds 50
  evogait plan RUN --environment reuse-3 --iterations 100 --whole-trees

The command writes a job file with procedure = \"plan\" and runs it. The job file
contains the gaits, so `evogait run` can repeat it on any machine. If the
environment has a goal, a tree ends when it reaches the goal, unless
--whole-trees is given. The result does not depend on the number of workers.

Files in the output folder:
  result.json              trees that reached the goal; mean and deviation of
                           distance to the goal, coverage and plan length; the
                           best plan
  job.toml                 the job with all settings; input for `evogait run`
  plans.csv, plans.json    a row for each tree; the steps of all plans
  plan.csv                 the best plan: gaits, times (s), poses (mu, rad)
  paths.csv                paths of the best plan: as in the tree, gait by gait
                           from rest, and without stops
  tree.json, gaits.json    the best tree; the gaits with their displacements
  map, gaits               pictures, each as .svg and .png")]
    Plan(Plan),

    /// Simulate a motion repeatedly with varied friction, motors, joints or start
    #[command(after_help = "\
Examples:
  evogait simulate runs/quadropod-empty-3f2a9c01d4e5 --gait 1
  evogait simulate RUN --plan --repeats 50 --friction 0.6..1.0
  evogait simulate RUN --plan --replan --friction 0.6..1.0 --dead-joints 1
  evogait simulate --robot lizard --stand 5
  evogait simulate --robot my-robot.urdf --targets targets.csv

The command writes a job file with procedure = \"simulate\" and runs it. The job
file contains the motion, so `evogait run` can repeat it on any machine. The
motion is simulated once with nothing varied. Then each repeat draws its values
from the ranges with random numbers of its own. A plan is simulated in two ways:
  resimulated  each gait starts from rest at the end of the previous one, as the
               planner assumes
  continuous   the robot does not stop between gaits
A run succeeds if it is stable, stays on the map, touches no obstacle, and ends
within the radius of the goal.

Files in the output folder:
  result.json              success rate with its 95 % interval; mean, deviation,
                           median and extremes of distances, motor work and
                           contacts
  job.toml                 the job with all settings; input for `evogait run`
  runs.csv                 a row for each run: drawn values, outcome, end pose
  motion-WAY.csv           samples of the run with nothing varied: time (s),
                           joint targets and angles (rad), pose (mu), bodies
                           that touch the ground
  paths.csv                path of the pivot in every run
  simulation.json          all data
  paths-WAY                pictures, each as .svg and .png")]
    Simulate(Box<Simulate>),

    /// Submit a job to a coordinator and return at once
    #[command(after_help = "\
Example:
  evogait submit quadropod-empty --coordinator http://cluster:7077

Prints the job's id, the ID of `evogait watch ID` and `evogait fetch ID`. If the
coordinator already has the same job, no second one is created and the id is
that of the first.")]
    Submit(Submit),

    /// Show the progress of a job on a coordinator until it ends
    #[command(after_help = "\
Example:
  evogait watch ID

Ctrl-C ends this command and not the job. The exit code is 0 if the job
succeeded, 1 if it failed or was cancelled.")]
    Watch(OneJob),

    /// List the jobs of a coordinator, newest first
    #[command(after_help = "\
Examples:
  evogait list --limit 20
  evogait list --state running --json | jq -r '.[].id'")]
    List(List),

    /// Show a job of a coordinator: state, progress, counts, and the next command
    #[command(after_help = "\
Examples:
  evogait show ID
  evogait show ID --toml > job.toml")]
    Show(Show),

    /// Pause a job of a coordinator: workers get no more of its tasks
    #[command(after_help = "\
Example:
  evogait pause ID

Tasks that already run may finish, and their results count. `evogait resume ID`
continues the job, also after a restart of the coordinator.")]
    Pause(OneJob),

    /// Continue a paused job
    #[command(after_help = "\
Example:
  evogait resume ID")]
    Resume(OneJob),

    /// Repeat an ended job of a coordinator from one of its generations on
    #[command(after_help = "\
Examples:
  evogait restart ID
  evogait restart ID --from-generation 40

The new job takes over all earlier generations. The bits of its result are those
of an undisturbed run. Without --from-generation a tainted job is repeated from
the generation with the wrong value. Prints the new job's id.")]
    Restart(Restart),

    /// Cancel a job of a coordinator permanently
    #[command(after_help = "\
Example:
  evogait cancel ID

`evogait submit JOB.toml --again` starts a cancelled job again from the
beginning.")]
    Cancel(OneJob),

    /// Evaluate one candidate on this machine, with the same bits as on a worker
    #[command(after_help = "\
Examples:
  evogait evaluate ID
  evogait evaluate my-job.toml --generation 2 --candidate 7 --genome-file genome.txt
  evogait evaluate ID --generation 2 --candidate 7 --genome=0.31,-1.5,2.25

The first example repeats the evaluation that failed a job of a coordinator: the
candidate that failed or crashed its worker in every attempt. `evogait show ID`
prints which candidate that was.")]
    Evaluate(Evaluate),

    /// Write the result of a job on a coordinator to a folder
    #[command(after_help = "\
Example:
  evogait fetch ID --out runs/from-cluster

The folder gets the same files as one of `evogait run`.")]
    Fetch(Fetch),

    /// List the workers that are connected to a coordinator
    #[command(after_help = "Example:\n  evogait workers --json")]
    Workers(OnCoordinator),

    /// Print the number of slots that the jobs of a coordinator can use, and the slots it has
    #[command(after_help = "\
Examples:
  evogait demand
  evogait demand --json | jq .wanted

For scripts that start and stop workers. A job can use as many slots as its
current generation can fill; an ended job uses none.")]
    Demand(OnCoordinator),

    /// Check that a coordinator serves: exit code 0 if it does, 1 if not
    #[command(after_help = "\
Examples:
  evogait health
  evogait health --alive --coordinator http://standby:7077
  evogait health --process 127.0.0.1:9464

For probes of containers, and for scripts that wait for a coordinator.")]
    Health(Health),

    /// Compare runs: settings that differ, scores and digests; draw their curves
    #[command(after_help = "\
Examples:
  evogait compare runs/quadropod-empty-*
  evogait compare runs/a runs/b --out curves.png
  evogait compare runs/a runs/b --json | jq .settings

The runs may be of any procedure. Curves need runs that evolved for the same
score.")]
    Compare(Compare),

    /// Simulate again a stored gait, or the best path of the stored tree
    #[command(after_help = "\
Examples:
  evogait replay runs/quadropod-empty-3f2a9c01d4e5 --gait 1 --out gait-1.csv
  evogait replay runs/quadropod-empty-3f2a9c01d4e5 --plan

The CSV file of a gait has time (s), joint targets and angles (rad), pivot
position (mu) and rotation (unit quaternion). The CSV file of a plan has the
path of the pivot (mu) in three ways: as in the tree, gait by gait from rest,
without stops.")]
    Replay(Replay),

    /// Compute a stored result again and compare it bit by bit
    #[command(after_help = "\
Examples:
  evogait verify runs/quadropod-empty-3f2a9c01d4e5
  evogait verify runs/quadropod-empty-3f2a9c01d4e5 --full

The command computes the winner's score again, as in the search and on the
reference setting. With --full it computes the whole report: archive, audits,
fresh seeds, friction, gaits, tree, paths. The exit code is 0 if every compared
number has the same bits, 1 if not.")]
    Verify(Verify),

    /// Check a job file and estimate its cost
    #[command(after_help = "\
Examples:
  evogait validate my-job.toml
  evogait validate my-job.toml --json | jq .estimate

Prints the faults of the job file, or the resolved settings of the job. For the
estimate some evaluations are timed on this machine.")]
    Validate(Validate),

    /// Measure speed and fidelity on this machine
    #[command(after_help = "\
Examples:
  evogait bench rollout quadropod --settings 30x8,60x16
  evogait bench fidelity quadropod --settings 30x8,60x8 --out bench/quadropod
  evogait bench evaluate quadropod-empty

`evogait bench COMMAND --help` describes what is measured, and how.")]
    Bench(Bench),

    /// Show facts and a picture of a robot, or export it to MJCF or URDF
    #[command(after_help = "\
Examples:
  evogait robot lizard
  evogait robot lizard --variant E1 --out lizard-e1.svg
  evogait robot my-robot.toml --json
  evogait robot lizard --format mjcf --scale real > lizard.xml
  evogait robot my-robot.urdf
  evogait robot my-robot.urdf --unit 0.065 --out my-robot.toml

MJCF (MuJoCo) contains bodies, hinges, motors, friction, gravity and the ground.
URDF has no elements for gains, friction and gravity: a comment in the file
states them. One unit of length in both formats is 1 mu. The importer accepts
trees of hinges from -90° to 90° with boxes and capsules. A job may name such a
file as its robot.")]
    Robot(Robot),

    /// Make certificates and tokens for a cluster
    #[command(after_help = "\
Examples:
  evogait certs init certs --host node1.example --host 10.0.0.1
  evogait certs renew certs --host node1.example --host 10.0.0.1

`init` prints the commands that use the new files.")]
    Certs(Certs),

    /// Check, tabulate or simulate a motion sequence of M-TRAN modules
    #[command(after_help = "\
Examples:
  evogait sequence check walk.seq --robot mtran-three
  evogait sequence run walk.seq --robot mtran-three --duration 60
  evogait sequence targets walk.seq --robot mtran-three --out targets.csv

A sequence consists of segments in braces, which are carried out one after the
other and from the first again until the time is over:
  { m [1 1] 0, -90  c [1 1] 0 }   module 1 turns with base part 1; the
                                  connection of its part 1, face 0 is kept
  L 3 { { m [0 0] 30, 0 } { m [0 0] 0, 0 } }   the same three times
Angles are multiples of 30 degrees from -90 to 90. Modules are numbered from 0 in
the order of the robot file. A moving part loses its connections unless the
segment names a face of them. `#` begins a comment.")]
    Sequence(Sequence),

    /// List the robots, environments and jobs that ship with the program, or print one
    #[command(after_help = "\
Examples:
  evogait scenarios
  evogait scenarios show quadropod-empty > my-job.toml")]
    Scenarios(Scenarios),

    /// Print the completion script of a shell
    #[command(after_help = "\
Examples:
  evogait completions bash > ~/.local/share/bash-completion/completions/evogait
  evogait completions zsh > ~/.zfunc/_evogait
  evogait completions fish > ~/.config/fish/completions/evogait.fish")]
    Completions(Completions),

    /// Print the man page of `evogait`, or write the pages of all commands
    #[command(after_help = "\
Examples:
  evogait man | man -l -
  evogait man --out ~/.local/share/man/man1

With --out, pages of an earlier version are overwritten.")]
    Man(Man),
}
