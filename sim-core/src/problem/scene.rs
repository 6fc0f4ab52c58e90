//! Access of evaluations to a prepared job.

use super::Job;
use crate::control::{Controller, GaitsSpec};
use crate::evaluate::Scene;
use crate::genotype::Space;
use crate::model::environment::Environment;
use crate::model::{Place, Robot, State};
use crate::objective::Objective;
use crate::physics::{Engine, Physics};
use crate::plan::{PlannerSettings, Reuse};

impl Scene for Job {
    fn seed(&self) -> u64 {
        self.spec().seed
    }

    fn robot(&self) -> &Robot {
        self.checked().robot()
    }

    fn environment(&self) -> &Environment {
        self.checked().environment()
    }

    fn engine(&self) -> &'static dyn Engine {
        self.checked().engine()
    }

    fn physics(&self) -> &Physics {
        self.checked().physics()
    }

    fn start(&self) -> &State {
        self.start()
    }

    fn root(&self) -> Place {
        self.root()
    }

    fn gaits(&self) -> &GaitsSpec {
        self.checked().gaits()
    }

    fn controller(&self) -> &'static dyn Controller {
        self.checked().controller()
    }

    fn space(&self) -> &Space {
        self.checked().space()
    }

    fn planner(&self) -> PlannerSettings {
        self.checked().planner()
    }

    fn repeats(&self) -> u32 {
        self.spec().planner.repeats
    }

    fn reuse(&self) -> Reuse {
        self.checked().reuse()
    }

    fn fitness(&self) -> &dyn Objective {
        self.fitness()
    }

    fn rollout_budget(&self, trees: u32, as_in_search: bool) -> u64 {
        self.checked().rollout_budget(trees, as_in_search)
    }
}
