//! Candidates in, scores out: what a worker does.
//!
//! All candidates of a call are advanced together. In each round their planners list the transitions they lack, the
//! engine simulates all of them in one batch, and the planners continue. Each candidate has a table of transitions of
//! its own, so its score does not depend on the other candidates of the batch.

mod execute;

pub use execute::{Executed, Stage, Standing, way};

use crate::base::random::{Purpose, Stream};
use crate::base::score::Counts;
use crate::control::{Controller, GaitsSpec, Infeasible, Run};
use crate::genotype::{Genotype, Space};
use crate::model::environment::{Block, Environment};
use crate::model::{Hinge, Place, Robot, State};
use crate::objective::Objective;
use crate::physics::{Engine, Motion, Outcome, Physics, Request};
use crate::plan::{Growth, PlannerSettings, Posture, Reuse, Root, Setting, TransitionKey, Transitions, Tree};
use std::collections::BTreeSet;

/// Rollouts between two looks at whether to stop, on an engine that does many at a time; on others each is looked at.
const BATCH: usize = 64;
/// Candidates advanced side by side: enough to fill an engine's lanes, few enough that what they hold, some 2 MiB each,
/// stays small.
const TOGETHER: usize = 20;

/// The parts of a problem that an evaluation needs: a robot at its start, and the settings of its gaits, trees and
/// scores.
pub trait Scene {
    /// All randomness follows from it.
    fn seed(&self) -> u64;
    /// The compiled robot.
    fn robot(&self) -> &Robot;
    /// Map, terrain, obstacles, goal.
    fn environment(&self) -> &Environment;
    /// The engine that simulates.
    fn engine(&self) -> &'static dyn Engine;
    /// Its setting.
    fn physics(&self) -> &Physics;
    /// The settled start in the canonical frame.
    fn start(&self) -> &State;
    /// Returns the place of the pivot at the start.
    fn root(&self) -> Place;
    /// Number and duration of gaits.
    fn gaits(&self) -> &GaitsSpec;
    /// The controller of a gait.
    fn controller(&self) -> &'static dyn Controller;
    /// The space of its candidates.
    fn space(&self) -> &Space;
    /// Returns the settings of the planner.
    fn planner(&self) -> PlannerSettings;
    /// Trees of a candidate.
    fn repeats(&self) -> u32;
    /// Returns the settings of the reuse of transitions.
    fn reuse(&self) -> Reuse;
    /// Returns the objective that rates a tree.
    fn fitness(&self) -> &dyn Objective;
    /// Rollouts that so many trees of a candidate may simulate; `as_in_search`: they reuse transitions as the search does.
    fn rollout_budget(&self, trees: u32, as_in_search: bool) -> u64;
}

/// Returns the setting of a scene's trees.
pub fn setting(scene: &dyn Scene) -> Setting<'_> {
    Setting {
        robot: scene.robot(),
        environment: scene.environment(),
        gaits: scene.gaits().count as usize,
        height: scene.start().pivot.translation.z.into(),
    }
}

/// Returns the root of a scene's trees.
fn root(scene: &dyn Scene) -> Root {
    let limits = |hinge: &Hinge| hinge.limits.map(f64::from);
    Root {
        place: scene.root(),
        posture: Posture::of(scene.start()),
        limits: scene.robot().hinges.iter().map(limits).collect(),
    }
}

/// The caller asked to stop before the work was done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped before the work was done")]
pub struct Stopped;

/// One candidate scored.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// Index in its generation.
    pub candidate: u32,
    /// The score; `None` where the evaluation failed ([`Failure`]), which counts as worst.
    pub score: Option<f64>,
    /// Its effort.
    pub counts: Counts,
}

/// One candidate being evaluated: its gaits, its table of transitions and its trees.
#[derive(Debug)]
pub struct Trial {
    /// The motion of each gait; none if one of them is infeasible.
    pub motions: Vec<Motion>,
    /// Local states and transitions, shared by the trees.
    pub table: Transitions,
    /// The trees.
    pub growths: Vec<Growth>,
    /// Its effort.
    pub counts: Counts,
    /// Rollouts it may simulate.
    pub budget: u64,
    /// Why its trees are not grown, if they can't be.
    pub failure: Option<Failure>,
}

/// Why an evaluation failed. It counts as worst.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// It needed more rollouts than it may simulate.
    #[error("it needs more than the {0} rollouts of its budget")]
    Budget(u64),
    /// One of its gaits has no motion.
    #[error(transparent)]
    Infeasible(#[from] Infeasible),
}

impl Trial {
    /// A trial with one tree a stream, at the given reuse tolerance and the job's number of variants, within the job's
    /// budget.
    ///
    /// # Panics
    /// If the genotype's length does not fit the scene.
    pub fn new(
        scene: &dyn Scene,
        genotype: &Genotype,
        tolerance: f64,
        streams: impl IntoIterator<Item = Stream>,
    ) -> Self {
        let reuse = Reuse { tolerance, ..scene.reuse() };
        let trial = Self::with_reuse(scene, genotype, reuse, streams);
        let budget = scene.rollout_budget(trial.growths.len() as u32, reuse == scene.reuse());
        Self { budget, ..trial }
    }

    /// A trial with one tree a stream and with its own settings of reuse, not the job's. It has no budget.
    ///
    /// # Panics
    /// If the genotype's length does not fit the scene.
    pub fn with_reuse(
        scene: &dyn Scene,
        genotype: &Genotype,
        reuse: Reuse,
        streams: impl IntoIterator<Item = Stream>,
    ) -> Self {
        let gaits = scene.gaits().count as usize;
        let fits = scene.space().check_length(genotype.numbers().len());
        assert_eq!(fits, Ok(()), "the genotype does not fit the job");
        let of_gait = Run::new(scene.robot(), scene.gaits().duration);
        let compile = |gait: &[f64]| scene.controller().compile(&of_gait, gait);
        let compiled: Result<Vec<Motion>, Infeasible> = genotype.gaits(gaits).map(compile).collect();
        let (motions, failure) = match compiled {
            Ok(motions) => (motions, None),
            Err(infeasible) => (Vec::new(), Some(infeasible.into())),
        };
        Self {
            motions,
            table: Transitions::new(gaits, reuse, scene.start()),
            growths: streams.into_iter().map(|s| Growth::new(scene.planner(), root(scene), s)).collect(),
            counts: Counts::default(),
            budget: u64::MAX,
            failure,
        }
    }

    /// The score of each tree.
    pub fn scores(&self, scene: &dyn Scene) -> Vec<f64> {
        self.growths.iter().map(|g| scene.fitness().score(g.tree())).collect()
    }

    /// The mean of the trees' scores.
    pub fn score(&self, scene: &dyn Scene) -> f64 {
        let scores = self.scores(scene);
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

    fn wishes(&mut self, scene: &dyn Scene) -> Vec<TransitionKey> {
        if self.failure.is_some() {
            return Vec::new();
        }
        let (mut wishes, mut wished) = (Vec::new(), BTreeSet::new());
        for growth in &mut self.growths {
            let missing = growth.advance(&setting(scene), &mut self.table);
            wishes.extend(missing.into_iter().filter(|key| wished.insert(*key)));
        }
        // What is wished for follows from this trial alone, and so does where it ends.
        if self.counts.rollouts + wishes.len() as u64 > self.budget {
            self.failure = Some(Failure::Budget(self.budget));
            wishes.clear();
        }
        wishes
    }
}

/// Advances trials side by side until all their trees are grown, or their budgets are spent.
pub fn grow(scene: &dyn Scene, trials: &mut [Trial], stop: &dyn Fn() -> bool) -> Result<(), Stopped> {
    grow_on(scene.engine(), scene, trials, stop)
}

/// Like [`grow`], with the rollouts done by `engine`, which may be the job's own in a wrapping that watches it.
pub fn grow_on(
    engine: &dyn Engine,
    scene: &dyn Scene,
    trials: &mut [Trial],
    stop: &dyn Fn() -> bool,
) -> Result<(), Stopped> {
    loop {
        let wishes: Vec<(usize, TransitionKey)> = trials
            .iter_mut()
            .enumerate()
            .flat_map(|(i, trial)| trial.wishes(scene).into_iter().map(move |key| (i, key)))
            .collect();
        if wishes.is_empty() {
            return Ok(());
        }
        // Canonical rollouts have flat ground only; rollouts in place have the terrain. A trial receives its outcomes
        // by kind and then in the order of its wishes, independent of the rest of the batch.
        let (placed, canonical): (Vec<_>, Vec<_>) =
            wishes.into_iter().partition(|(i, key)| trials[*i].table.is_in_place(key.start));
        run(engine, scene, trials, &[], &canonical, stop)?;
        run(engine, scene, trials, &scene.environment().terrain, &placed, stop)?;
    }
}

/// Simulates the wishes of trials and hands each its outcomes.
fn run(
    engine: &dyn Engine,
    scene: &dyn Scene,
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
            Request { start: trial.table.start(key.start), motion: &trial.motions[key.gait] }
        };
        let requests: Vec<Request<'_>> = batch.iter().map(request).collect();
        let rollouts = engine.run(scene.robot(), scene.physics(), terrain, &requests);
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
pub fn search_streams(scene: &dyn Scene, generation: u32, candidate: u32) -> impl Iterator<Item = Stream> {
    let (seed, repeats) = (scene.seed(), scene.repeats());
    (0..repeats).map(move |r| Stream::new(seed, Purpose::Planner, generation, candidate, r))
}

/// Scores candidates of one generation, given as (index in the generation, genotype). What a candidate scores does not
/// depend on which others are in the batch. One that exceeds the job's budget has failed. `stop` is asked before every
/// batch of rollouts; once true, the work is given up.
///
/// # Panics
/// If a genotype's length does not fit the scene.
pub fn evaluate(
    scene: &dyn Scene,
    generation: u32,
    candidates: &[(u32, Genotype)],
    stop: &dyn Fn() -> bool,
) -> Result<Vec<Evaluation>, Stopped> {
    let tolerance = scene.reuse().tolerance;
    let mut evaluations = Vec::with_capacity(candidates.len());
    for some in candidates.chunks(TOGETHER) {
        let mut trials: Vec<Trial> = some
            .iter()
            .map(|(index, genotype)| Trial::new(scene, genotype, tolerance, search_streams(scene, generation, *index)))
            .collect();
        grow(scene, &mut trials, stop)?;
        evaluations.extend(trials.iter().zip(some).map(|(trial, (index, _))| Evaluation {
            candidate: *index,
            score: trial.failure.is_none().then(|| trial.score(scene)),
            counts: trial.counts(),
        }));
    }
    Ok(evaluations)
}
