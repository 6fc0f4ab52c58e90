//! Replanning: a new plan is made if a motion deviates from its plan. Section I of Vonásek and Faigl (2016) names such
//! feedback as the way to execute plans.

use crate::base::random::{Purpose, Stream};
use crate::base::score::Counts;
use crate::control::{Controller, GaitsSpec};
use crate::evaluate::{Scene, Standing, Stopped, Trial, grow};
use crate::genotype::{Genotype, Space};
use crate::model::environment::Environment;
use crate::model::{Place, Robot, State};
use crate::objective::Objective;
use crate::physics::{Engine, Physics, canonical};
use crate::plan::{PlannerSettings, Reuse};
use crate::problem::{Job, ReplanSpec, SimulateSpec};
use crate::report::end_of_plan;

/// A plan in execution.
pub(super) struct Replanning<'a> {
    job: &'a Job,
    /// The job on which plans are made.
    planning: &'a Job,
    spec: &'a ReplanSpec,
    repeat: Option<u32>,
    stop: &'a dyn Fn() -> bool,
    /// Remaining steps, the next one last: the gait, and its planned end if the job gives one.
    left: Vec<(u32, Option<Place>)>,
    /// Planned end of the last step.
    expected: Option<Place>,
    made: u32,
}

impl<'a> Replanning<'a> {
    pub fn new(
        job: &'a Job,
        simulate: &'a SimulateSpec,
        spec: &'a ReplanSpec,
        repeat: Option<u32>,
        stop: &'a dyn Fn() -> bool,
    ) -> Self {
        let place = |i: usize| {
            let [x, y, z, yaw] = *simulate.places.as_ref()?.get(i)?;
            Some(Place { x, y, z, yaw })
        };
        let steps = simulate.steps.as_deref().unwrap_or_default().iter().enumerate();
        let left = steps.map(|(i, step)| (step - 1, place(i))).rev().collect();
        let planning = job.reference().unwrap_or(job);
        Self { job, planning, spec, repeat, stop, left, expected: None, made: 0 }
    }

    /// Returns the number of plans that were made.
    pub fn made(&self) -> u32 {
        self.made
    }

    /// Returns the next gait for a robot that stands at `at`. `None` if the robot is at the goal, no further plan is
    /// allowed, or the plan has no steps.
    pub fn next(&mut self, at: &Standing, counts: &mut Counts) -> Result<Option<u32>, Stopped> {
        let goal = self.job.environment().goal;
        if goal.is_some_and(|goal| {
            at.place.planar_distance(&Place { x: goal.x, y: goal.y, ..Place::ORIGIN }) <= goal.radius
        }) {
            return Ok(None);
        }
        let astray = self.expected.is_some_and(|place| place.planar_distance(&at.place) > self.spec.deviation);
        if self.left.is_empty() || astray {
            if self.made == self.spec.most {
                return Ok(None);
            }
            self.plan(at, counts)?;
        }
        let Some((gait, expected)) = self.left.pop() else { return Ok(None) };
        self.expected = expected;
        Ok(Some(gait))
    }

    fn plan(&mut self, at: &Standing, counts: &mut Counts) -> Result<(), Stopped> {
        let (job, scene) =
            (self.planning, From { job: self.planning, start: canonical(at.state.clone()), root: at.place });
        let stream = Stream::new(
            job.spec().seed,
            Purpose::Replan,
            self.made,
            self.repeat.is_none().into(),
            self.repeat.unwrap_or(0),
        );
        self.made += 1;
        self.left.clear();
        let none = Genotype::from(Vec::new());
        let gaits = self.job.given_gaits().unwrap_or(&none);
        let mut trials = [Trial::new(&scene, gaits, scene.reuse().tolerance, [stream])];
        grow(&scene, &mut trials, self.stop)?;
        let [trial] = trials;
        *counts += trial.counts();
        let tree = trial.tree();
        let path = tree.path(end_of_plan(job.environment(), tree));
        let steps =
            path.iter().rev().filter_map(|&node| Some((tree.nodes[node].edge?.1 as u32, tree.nodes[node].place)));
        self.left = steps.map(|(gait, place)| (gait, Some(place))).collect();
        Ok(())
    }
}

/// A job's scene with another start of the robot.
struct From<'a> {
    job: &'a Job,
    /// Start configuration in the canonical frame.
    start: State,
    root: Place,
}

impl Scene for From<'_> {
    fn seed(&self) -> u64 {
        Scene::seed(self.job)
    }

    fn robot(&self) -> &Robot {
        Scene::robot(self.job)
    }

    fn environment(&self) -> &Environment {
        Scene::environment(self.job)
    }

    fn engine(&self) -> &'static dyn Engine {
        Scene::engine(self.job)
    }

    fn physics(&self) -> &Physics {
        Scene::physics(self.job)
    }

    fn start(&self) -> &State {
        &self.start
    }

    fn root(&self) -> Place {
        self.root
    }

    fn gaits(&self) -> &GaitsSpec {
        Scene::gaits(self.job)
    }

    fn controller(&self) -> &'static dyn Controller {
        Scene::controller(self.job)
    }

    fn space(&self) -> &Space {
        Scene::space(self.job)
    }

    fn planner(&self) -> PlannerSettings {
        Scene::planner(self.job)
    }

    fn repeats(&self) -> u32 {
        Scene::repeats(self.job)
    }

    fn reuse(&self) -> Reuse {
        Scene::reuse(self.job)
    }

    fn fitness(&self) -> &dyn Objective {
        Scene::fitness(self.job)
    }

    fn rollout_budget(&self, trees: u32, as_in_search: bool) -> u64 {
        Scene::rollout_budget(self.job, trees, as_in_search)
    }
}
