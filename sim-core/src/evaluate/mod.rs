//! Candidates in, scores out: what a worker does.
//!
//! All candidates of a call are advanced together: each round, their planners say which transitions they lack, the
//! engine simulates all of them in one batch, and they go on. A candidate has a table of transitions of its own, so what
//! it scores does not depend on whom it shares a batch with.

use crate::base::random::{Purpose, Stream};
use crate::base::score::Counts;
use crate::genotype::Genome;
use crate::model::environment::Block;
use crate::physics::{Engine, Outcome, Request, Targets};
use crate::plan::{Growth, Reuse, TransitionKey, Transitions, Tree};
use crate::problem::Job;
use std::collections::BTreeSet;

/// Rollouts between two looks at whether to stop, on an engine that does many at a time; on others each is looked at.
const BATCH: usize = 64;
/// Candidates advanced side by side: enough to fill an engine's lanes, few enough that what they hold, some 2 MiB each,
/// stays small.
const TOGETHER: usize = 20;

/// The caller asked to stop before the work was done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped before the work was done")]
pub struct Stopped;

/// One candidate scored.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// Index in its generation.
    pub candidate: u32,
    /// The score; `None` where the evaluation failed (it exceeded its budget), which counts as worst.
    pub score: Option<f64>,
    /// What it took.
    pub counts: Counts,
}

/// One candidate being evaluated: its gaits, its table of transitions and its trees.
#[derive(Clone, Debug)]
pub struct Trial {
    /// What the joints are told, by gait.
    pub targets: Vec<Targets>,
    /// Local states and transitions, shared by the trees.
    pub table: Transitions,
    /// The trees.
    pub growths: Vec<Growth>,
    /// What it took.
    pub counts: Counts,
    /// Rollouts it may simulate.
    pub budget: u64,
    /// It needed more: its trees are not grown.
    pub exhausted: bool,
}

impl Trial {
    /// A trial with one tree a stream, at the given reuse tolerance and the job's number of variants, within the job's
    /// budget.
    ///
    /// # Panics
    /// If the genome's length does not fit the job.
    pub fn new(job: &Job, genome: &[f64], tolerance: f64, streams: impl IntoIterator<Item = Stream>) -> Self {
        let reuse = Reuse { tolerance, ..job.reuse() };
        let trial = Self::with_reuse(job, genome, reuse, streams);
        let budget = job.rollout_budget(trial.growths.len() as u32, reuse == job.reuse());
        Self { budget, ..trial }
    }

    /// A trial with one tree a stream, whose transitions are reused otherwise than the job says. It may cost what it likes.
    ///
    /// # Panics
    /// If the genome's length does not fit the job.
    pub fn with_reuse(job: &Job, genome: &[f64], reuse: Reuse, streams: impl IntoIterator<Item = Stream>) -> Self {
        let (gaits, joints) = (job.spec().gaits.count as usize, job.robot().hinges.len());
        assert_eq!(genome.len(), job.bounds().0.len(), "the genome does not fit the job");
        let compile = |gait: &[f64]| job.controller().compile(gait, joints, job.spec().gaits.duration);
        Self {
            targets: genome.chunks(genome.len() / gaits).map(compile).collect(),
            table: Transitions::new(gaits, reuse, job.start()),
            growths: streams.into_iter().map(|s| Growth::new(job.planner(), job.root(), s)).collect(),
            counts: Counts::default(),
            budget: u64::MAX,
            exhausted: false,
        }
    }

    /// The score of each tree.
    pub fn scores(&self, job: &Job) -> Vec<f64> {
        self.growths.iter().map(|g| job.fitness().score(g.tree())).collect()
    }

    /// The mean of the trees' scores.
    pub fn score(&self, job: &Job) -> f64 {
        let scores = self.scores(job);
        scores.iter().sum::<f64>() / scores.len() as f64
    }

    /// The first tree.
    pub fn tree(&self) -> &Tree {
        self.growths[0].tree()
    }

    /// Everything that was counted, rollouts and trees.
    pub fn counts(&self) -> Counts {
        let mut counts = self.counts;
        self.growths.iter().for_each(|g| counts += g.counts());
        counts
    }

    fn wishes(&mut self, job: &Job) -> Vec<TransitionKey> {
        if self.exhausted {
            return Vec::new();
        }
        let (mut wishes, mut wished) = (Vec::new(), BTreeSet::new());
        for growth in &mut self.growths {
            let missing = growth.advance(&job.setting(), &mut self.table);
            wishes.extend(missing.into_iter().filter(|key| wished.insert(*key)));
        }
        // What is wished for follows from this trial alone, and so does where it ends.
        if self.counts.rollouts + wishes.len() as u64 > self.budget {
            self.exhausted = true;
            wishes.clear();
        }
        wishes
    }
}

/// Advances trials side by side until all their trees are grown, or their budgets are spent.
pub fn grow(job: &Job, trials: &mut [Trial], stop: &dyn Fn() -> bool) -> Result<(), Stopped> {
    grow_on(job.engine(), job, trials, stop)
}

/// Like [`grow`], with the rollouts done by `engine`, which may be the job's own in a wrapping that watches it.
pub fn grow_on(engine: &dyn Engine, job: &Job, trials: &mut [Trial], stop: &dyn Fn() -> bool) -> Result<(), Stopped> {
    loop {
        let wishes: Vec<(usize, TransitionKey)> = trials
            .iter_mut()
            .enumerate()
            .flat_map(|(i, trial)| trial.wishes(job).into_iter().map(move |key| (i, key)))
            .collect();
        if wishes.is_empty() {
            return Ok(());
        }
        // Canonical rollouts see flat ground only; rollouts in place see the terrain. A trial's outcomes are taken in by
        // kind and then in the order of its wishes, whatever else is in the batch.
        let (placed, canonical): (Vec<_>, Vec<_>) =
            wishes.into_iter().partition(|(i, key)| trials[*i].table.is_in_place(key.start));
        run(engine, job, trials, &[], &canonical, stop)?;
        run(engine, job, trials, &job.environment().terrain, &placed, stop)?;
    }
}

/// Simulates the wishes of trials and hands each its outcomes.
fn run(
    engine: &dyn Engine,
    job: &Job,
    trials: &mut [Trial],
    terrain: &[Block],
    wishes: &[(usize, TransitionKey)],
    stop: &dyn Fn() -> bool,
) -> Result<(), Stopped> {
    let at_once = if engine.lanes() > 1 { BATCH } else { 1 };
    for batch in wishes.chunks(at_once) {
        if stop() {
            return Err(Stopped);
        }
        let request = |&(i, key): &(usize, TransitionKey)| {
            let trial: &Trial = &trials[i];
            Request { start: trial.table.start(key.start), targets: &trial.targets[key.gait] }
        };
        let requests: Vec<Request<'_>> = batch.iter().map(request).collect();
        let rollouts = engine.run(job.robot(), job.physics(), terrain, &requests);
        for (&(i, key), rollout) in batch.iter().zip(rollouts) {
            let counts = &mut trials[i].counts;
            counts.rollouts += 1;
            counts.unstable += u64::from(rollout.outcome != Outcome::Completed);
            counts.simulated_ms += rollout.simulated_ms;
            trials[i].table.insert(key, rollout);
        }
    }
    Ok(())
}

/// The random streams of a candidate's trees in the search.
pub fn search_streams(job: &Job, generation: u32, candidate: u32) -> impl Iterator<Item = Stream> {
    let seed = job.spec().seed;
    (0..job.spec().planner.repeats).map(move |r| Stream::new(seed, Purpose::Planner, generation, candidate, r))
}

/// Scores candidates of one generation, given as (index in the generation, genome). What a candidate scores does not
/// depend on which others are in the batch. One that exceeds the job's budget has failed. `stop` is asked before every
/// batch of rollouts; once true, the work is given up.
///
/// # Panics
/// If a genome's length does not fit the job.
pub fn evaluate(
    job: &Job,
    generation: u32,
    candidates: &[(u32, Genome)],
    stop: &dyn Fn() -> bool,
) -> Result<Vec<Evaluation>, Stopped> {
    let tolerance = job.spec().planner.reuse_tolerance;
    let mut evaluations = Vec::with_capacity(candidates.len());
    for some in candidates.chunks(TOGETHER) {
        let mut trials: Vec<Trial> = some
            .iter()
            .map(|(index, genome)| Trial::new(job, genome, tolerance, search_streams(job, generation, *index)))
            .collect();
        grow(job, &mut trials, stop)?;
        evaluations.extend(trials.iter().zip(some).map(|(trial, (index, _))| Evaluation {
            candidate: *index,
            score: (!trial.exhausted).then(|| trial.score(job)),
            counts: trial.counts(),
        }));
    }
    Ok(evaluations)
}
