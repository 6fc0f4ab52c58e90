//! Cost of a job's evaluations on this machine, for `evogait validate` and `evogait bench evaluate`.

use crate::clock::{Spent, Stopwatch, timed};
use serde::Serialize;
use sim_core::base::score::Counts;
use sim_core::evaluate::{Stopped, Trial, grow_on, search_streams};
use sim_core::genotype::Genotype;
use sim_core::model::Robot;
use sim_core::model::environment::Block;
use sim_core::physics::{Engine, Motion, Physics, Request, Rollout, Unsupported};
use sim_core::problem::Job;
use sim_core::procedure::evolve::finish::total as total_counts;
use sim_core::procedure::simulate::{self, Task, TaskResult};
use sim_core::procedure::{Hooks, ProcedureKind as _};
use sim_core::search::OptimiserSpec;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Limits of a measurement.
#[derive(Clone, Copy, Debug)]
pub struct Budget {
    /// Greatest number of evaluations.
    pub evaluations: u32,
    /// Time limit. Afterwards no evaluation begins, and a running one is stopped and not counted, unless it is the
    /// first.
    pub time: Duration,
    /// Time limit of the first evaluation.
    pub first: Duration,
}

/// Time and counts of evaluations on one thread.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cost {
    /// Number of complete evaluations.
    pub evaluations: u32,
    /// True if the first evaluation was stopped at its time limit. Then only `total` is valid: the time until the stop.
    pub given_up: bool,
    /// Total time of the evaluations.
    pub total: Spent,
    /// Part of `total` spent in the physics engine.
    pub physics: Spent,
    /// Part of `total` spent on tables of joint targets.
    pub tables: Spent,
    /// Part of `total` spent on growing trees, without the physics engine.
    pub planning: Spent,
    /// Counts of rollouts, nodes and other quantities, summed over evaluations.
    pub counts: Counts,
    /// Scores in the order of the candidates, equal to those of the job's search.
    pub scores: Vec<f64>,
    /// Use of the engine's lanes.
    pub lanes: Lanes,
}

/// Use of an engine's lanes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lanes {
    /// Number of rollouts requested.
    pub useful: u64,
    /// Number of lanes simulated, including empty ones.
    pub all: u64,
}

/// Returns the number of candidates that are evaluated together, at least 1: the share of a generation that one of
/// `slots` slots gets at once.
pub fn at_once(job: &Job, slots: u32) -> u32 {
    match job.candidates_at_once() {
        1 => 1,
        least => {
            let population = job.spec().optimiser.as_ref().map_or(least, OptimiserSpec::population);
            population.div_ceil(slots).max(least)
        }
    }
}

/// Measures evaluations of a job's first candidates, or of its given gaits. If generation 0 has too few candidates,
/// they are evaluated again with other random streams. `together` candidates (at least 1) are evaluated at once;
/// [`at_once`] returns the number for a slot. `each` is called after every evaluation.
pub fn measure(job: &Job, together: u32, budget: Budget, each: &dyn Fn()) -> Cost {
    let started = Stopwatch::start();
    let mut cost = Cost::default();
    let genotypes = match job.given_gaits() {
        Some(gaits) => vec![gaits.clone(); together as usize],
        None => job.optimiser().ask().genotypes,
    };
    let candidates: Vec<(u32, &Genotype)> = (0..).zip(&genotypes).collect();
    let ranges = (0..)
        .flat_map(|generation| candidates.chunks(together as usize).map(move |candidates| (generation, candidates)));
    for (generation, candidates) in ranges {
        let left = (budget.evaluations - cost.evaluations) as usize;
        let candidates = &candidates[..left.min(candidates.len())];
        if candidates.is_empty() {
            break;
        }
        let limit = if cost.evaluations == 0 { budget.first } else { budget.time };
        match evaluations(job, generation, candidates, &|| started.elapsed() > limit) {
            Ok(range) => cost.add(range),
            Err(Stopped) if cost.evaluations == 0 => {
                let wall = started.elapsed().as_secs_f64();
                return Cost { given_up: true, total: Spent { wall, cpu: wall }, ..cost };
            }
            Err(Stopped) => return cost,
        }
        candidates.iter().for_each(|_| each());
        if started.elapsed() > budget.time {
            break;
        }
    }
    cost
}

/// Measures runs of a simulate job, one after the other on one thread, until the budget is used up: first the unvaried
/// run, then repeats.
pub fn measure_runs(job: &Job, budget: Budget) -> Cost {
    struct Until<'a>(&'a Stopwatch, Duration);
    impl Hooks for Until<'_> {
        fn stop(&self) -> bool {
            self.0.elapsed() > self.1
        }
    }
    let started = Stopwatch::start();
    let mut cost = Cost::default();
    let tasks = std::iter::once(Task::Unvaried).chain((0..).map(|repeat| Task::Repeat { repeat }));
    for task in tasks.take(budget.evaluations as usize) {
        let limit = if cost.evaluations == 0 { budget.first } else { budget.time };
        let (done, spent) =
            timed(|| simulate::SimulateProcedure.run(job, &[(0, task.encode())], &Until(&started, limit)));
        let Ok(results) = done else {
            let given_up = cost.evaluations == 0;
            return Cost { given_up, total: if given_up { spent } else { cost.total }, ..cost };
        };
        if let Ok(result) = TaskResult::decode(&results.concat()) {
            cost.counts += *result.runs().1;
        }
        cost.evaluations += 1;
        cost.total += spent;
        if started.elapsed() > budget.time {
            break;
        }
    }
    cost
}

/// Evaluates candidates in the same three steps as [`sim_core::evaluate::evaluate`] (tables, trees, scores) and
/// measures them.
fn evaluations(
    job: &Job,
    generation: u32,
    candidates: &[(u32, &Genotype)],
    stop: &dyn Fn() -> bool,
) -> Result<Cost, Stopped> {
    let engine = Watched { engine: job.engine(), seen: Mutex::default() };
    let (done, total) = timed(|| {
        let tolerance = job.spec().planner.reuse_tolerance;
        let trial = |&(index, genotype): &(u32, &Genotype)| {
            Trial::new(job, genotype, tolerance, search_streams(job, generation, index))
        };
        let (mut trials, tables) = timed(|| candidates.iter().map(trial).collect::<Vec<_>>());
        let (grown, growth) = timed(|| grow_on(&engine, job, &mut trials, stop));
        let scores: Vec<f64> = trials.iter().map(|trial| trial.score(job)).collect();
        let counts = total_counts(trials.iter().map(Trial::counts).collect::<Vec<_>>().iter());
        grown.map(|()| (scores, counts, tables, growth))
    });
    let (scores, counts, tables, growth) = done?;
    let (physics, lanes) = engine.seen.into_inner().unwrap_or_else(PoisonError::into_inner);
    let planning = Spent { wall: growth.wall - physics.wall, cpu: growth.cpu - physics.cpu };
    let evaluations = candidates.len() as u32;
    Ok(Cost { evaluations, given_up: false, total, physics, tables, planning, counts, scores, lanes })
}

/// Shares of the CPU time; their sum is 1.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Shares {
    /// Share of the physics engine.
    pub physics: f64,
    /// Share of the tables of joint targets.
    pub target_tables: f64,
    /// Share of growing trees, without the physics engine.
    pub planning: f64,
    /// Share of all other work.
    pub rest: f64,
}

impl Cost {
    /// Returns the shares of the CPU time.
    pub fn shares(&self) -> Shares {
        let share = |part: Spent| part.cpu / self.total.cpu;
        let (physics, target_tables, planning) = (share(self.physics), share(self.tables), share(self.planning));
        Shares { physics, target_tables, planning, rest: 1.0 - physics - target_tables - planning }
    }

    fn add(&mut self, other: Self) {
        self.evaluations += other.evaluations;
        self.total += other.total;
        self.physics += other.physics;
        self.tables += other.tables;
        self.planning += other.planning;
        self.counts += other.counts;
        self.scores.extend(other.scores);
        self.lanes += other.lanes;
    }
}

impl std::ops::AddAssign for Lanes {
    fn add_assign(&mut self, other: Self) {
        self.useful += other.useful;
        self.all += other.all;
    }
}

/// Engine that measures its time and counts its lanes.
struct Watched {
    engine: &'static dyn Engine,
    seen: Mutex<(Spent, Lanes)>,
}

impl Engine for Watched {
    fn supports(&self, robot: &Robot, terrain: &[Block], motion: &Motion) -> Result<(), Unsupported> {
        self.engine.supports(robot, terrain, motion)
    }

    fn run(&self, robot: &Robot, physics: &Physics, terrain: &[Block], batch: &[Request<'_>]) -> Vec<Rollout> {
        let (rollouts, spent) = timed(|| self.engine.run(robot, physics, terrain, batch));
        let (useful, width) = (batch.len() as u64, self.engine.lanes() as u64);
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        seen.0 += spent;
        seen.1 += Lanes { useful, all: useful.next_multiple_of(width) };
        rollouts
    }

    fn lanes(&self) -> usize {
        self.engine.lanes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sim_core::evaluate::evaluate;

    const ALWAYS: Duration = Duration::MAX;

    fn job(engine: &str) -> Job {
        let text = "name = \"a\"\nrobot = \"quadropod\"\nenvironment = \"empty\"\n[gaits]\ncount = 2\nduration = 1.0\n\
                    [planner]\niterations = 10\n[fitness]\nkind = \"coverage\"\n[optimiser]\nkind = \"pso\"\nparticles = 3";
        Job::from_toml(&format!("{text}\n[physics]\nengine = \"{engine}\"\n")).unwrap()
    }

    #[test]
    fn measured_evaluations_equal_those_of_a_worker() {
        for engine in ["rapier", "lockstep"] {
            assert_equals_worker(&job(engine));
        }
    }

    fn assert_equals_worker(job: &Job) {
        let cost = measure(job, at_once(job, 2), Budget { evaluations: 3, time: ALWAYS, first: ALWAYS }, &|| ());
        let candidates: Vec<(u32, Genotype)> = (0..).zip(job.optimiser().ask().genotypes).collect();
        let scored = evaluate(job, 0, &candidates, &|| false).unwrap();
        assert_eq!(cost.scores, scored.iter().map(|e| e.score.unwrap()).collect::<Vec<_>>());
        let mut counts = Counts::default();
        scored.iter().for_each(|e| counts += e.counts);
        assert_eq!((cost.evaluations, cost.counts), (3, counts));
        assert_eq!(cost.lanes.useful, counts.rollouts);
        assert_eq!(cost.lanes.all % job.engine().lanes() as u64, 0);
    }

    #[test]
    fn parts_do_not_exceed_the_total_time() {
        let cost = measure(&job("rapier"), 1, Budget { evaluations: 4, time: ALWAYS, first: ALWAYS }, &|| ());
        let parts = cost.physics.cpu + cost.tables.cpu + cost.planning.cpu;
        assert!(cost.physics.cpu > 0.0 && cost.planning.cpu > 0.0 && parts <= cost.total.cpu, "{cost:?}");
    }

    #[test]
    fn slow_first_evaluation_is_given_up() {
        let none = Duration::ZERO;
        let cost = measure(&job("rapier"), 1, Budget { evaluations: 3, time: none, first: none }, &|| ());
        assert!(cost.given_up && cost.evaluations == 0, "{cost:?}");
        let one = measure(&job("rapier"), 1, Budget { evaluations: 3, time: none, first: ALWAYS }, &|| ());
        assert_eq!((one.given_up, one.evaluations), (false, 1));
    }
}
