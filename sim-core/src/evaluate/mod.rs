//! Evaluation of candidates on workers: genotypes in, scores out.
//!
//! All candidates of a call are advanced together. In each pass their planners list the transitions that are missing,
//! the engine simulates all of them in one batch, and the planners continue. Each candidate has its own table of
//! transitions, so its score does not depend on the other candidates of the batch.

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
use crate::plan::{Growth, PlannerSettings, Posture, Reuse, Root, TransitionKey, Transitions, Tree, TreeScene};
use std::collections::BTreeSet;

/// Rollouts between two checks of `stop` on an engine that simulates many at a time. On other engines `stop` is checked
/// before every rollout.
const BATCH: usize = 64;
/// Candidates advanced side by side: enough to fill an engine's lanes, and few enough to limit memory, at some 2 MiB
/// each.
const TOGETHER: usize = 20;

/// Parts of a problem that an evaluation needs: a robot at its start, and the settings of its gaits, trees and scores.
pub trait Scene {
    /// Returns the seed, from which all randomness follows.
    fn seed(&self) -> u64;
    /// Returns the compiled robot.
    fn robot(&self) -> &Robot;
    /// Returns the environment: map, terrain, obstacles, goal.
    fn environment(&self) -> &Environment;
    /// Returns the engine that simulates.
    fn engine(&self) -> &'static dyn Engine;
    /// Returns the setting of the engine.
    fn physics(&self) -> &Physics;
    /// Returns the settled start in the canonical frame.
    fn start(&self) -> &State;
    /// Returns the place of the pivot at the start.
    fn root(&self) -> Place;
    /// Returns the settings of the gaits, such as their number and duration.
    fn gaits(&self) -> &GaitsSpec;
    /// Returns the controller of the gaits.
    fn controller(&self) -> &'static dyn Controller;
    /// Returns the space of the candidates.
    fn space(&self) -> &Space;
    /// Returns the settings of the planner.
    fn planner(&self) -> PlannerSettings;
    /// Returns the number of trees of a candidate.
    fn repeats(&self) -> u32;
    /// Returns the settings of the reuse of transitions.
    fn reuse(&self) -> Reuse;
    /// Returns the objective that rates a tree.
    fn fitness(&self) -> &dyn Objective;
    /// Returns the number of rollouts that `trees` trees of a candidate may simulate. `as_in_search`: the trees reuse
    /// transitions as the search does.
    fn rollout_budget(&self, trees: u32, as_in_search: bool) -> u64;
}

/// Returns the setting of a scene's trees.
pub fn setting(scene: &dyn Scene) -> TreeScene<'_> {
    TreeScene {
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

/// Error: the caller stopped the work before it was done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("stopped before the work was done")]
pub struct Stopped;

/// Score and effort of one candidate.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// Index of the candidate in its generation.
    pub candidate: u32,
    /// Score; `None` if the evaluation failed ([`Failure`]), which counts as worst.
    pub score: Option<f64>,
    /// Effort of the evaluation.
    pub counts: Counts,
}

/// Evaluation of one candidate in progress: its gaits, its table of transitions and its trees.
#[derive(Debug)]
pub struct Trial {
    /// Motion of each gait; empty if one of them is infeasible.
    pub motions: Vec<Motion>,
    /// Local states and transitions, shared by the trees.
    pub table: Transitions,
    /// The trees.
    pub growths: Vec<Growth>,
    /// Effort so far.
    pub counts: Counts,
    /// Greatest number of rollouts.
    pub budget: u64,
    /// Reason for which the trees are not grown, if there is one.
    pub failure: Option<Failure>,
}

/// Reason of a failed evaluation, which counts as worst.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// The trees need more rollouts than the budget allows.
    #[error("the evaluation needs more than the {0} rollouts of its budget")]
    Budget(u64),
    /// A gait can't be compiled to a motion.
    #[error(transparent)]
    Infeasible(#[from] Infeasible),
}

impl Trial {
    /// Returns a trial with one tree for each stream, at the given reuse tolerance, with the job's number of variants
    /// and within the job's budget.
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

    /// Returns a trial with one tree for each stream and with the given settings of reuse instead of the job's. It has
    /// no budget.
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
        assert_eq!(fits, Ok(()), "the genotype's length does not fit the job's space");
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

    /// Returns the score of each tree.
    pub fn scores(&self, scene: &dyn Scene) -> Vec<f64> {
        (0..self.growths.len()).map(|i| self.score_by(scene, scene.fitness(), i)).collect()
    }

    /// Returns the score of a tree by an objective.
    pub fn score_by(&self, scene: &dyn Scene, objective: &dyn Objective, tree: usize) -> f64 {
        let growth = &self.growths[tree];
        objective.score(growth.tree(), &|node| growth.mass_center(scene.robot(), &self.table, node))
    }

    /// Returns the mean of the trees' scores.
    pub fn score(&self, scene: &dyn Scene) -> f64 {
        let scores = self.scores(scene);
        scores.iter().sum::<f64>() / scores.len() as f64
    }

    /// Returns the first tree.
    pub fn tree(&self) -> &Tree {
        self.growths[0].tree()
    }

    /// Returns all counts, those of rollouts and those of trees.
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
        // The missing transitions follow from this trial alone, so the trial ends at the same point in every batch.
        if self.counts.rollouts + wishes.len() as u64 > self.budget {
            self.failure = Some(Failure::Budget(self.budget));
            wishes.clear();
        }
        wishes
    }
}

/// Advances trials side by side until all their trees are grown or their budgets are spent.
pub fn grow(scene: &dyn Scene, trials: &mut [Trial], stop: &dyn Fn() -> bool) -> Result<(), Stopped> {
    grow_on(scene.engine(), scene, trials, stop)
}

/// Advances trials as [`grow`] does, with rollouts from `engine`, which may be a wrapper that observes the job's own
/// engine.
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
        // by kind and then in the order of its missing transitions, independent of the rest of the batch.
        let (placed, canonical): (Vec<_>, Vec<_>) =
            wishes.into_iter().partition(|(i, key)| trials[*i].table.is_in_place(key.start));
        run(engine, scene, trials, &[], &canonical, stop)?;
        run(engine, scene, trials, &scene.environment().terrain, &placed, stop)?;
    }
}

/// Simulates missing transitions of trials and inserts the rollouts into the trials' tables.
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

/// Returns the random streams of a candidate's trees in the search.
pub fn search_streams(scene: &dyn Scene, generation: u32, candidate: u32) -> impl Iterator<Item = Stream> {
    let (seed, repeats) = (scene.seed(), scene.repeats());
    (0..repeats).map(move |r| Stream::new(seed, Purpose::Planner, generation, candidate, r))
}

/// Scores candidates of one generation, given as (index in the generation, genotype). A candidate's score does not
/// depend on the other candidates of the batch. A candidate that exceeds the job's budget fails. `stop` is checked
/// before every batch of rollouts; once it returns true, the result is [`Stopped`].
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
