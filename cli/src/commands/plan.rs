//! `evogait plan`: writes a job that plans with the gaits of a run, and runs it.

use super::run::carry_out;
use super::source_run::{SourceRun, read};
use crate::arguments::Plan;
use crate::error::Error;
use crate::load;
use serde::Deserialize;
use serde::de::IntoDeserializer as _;
use serde::de::value::{Error as NotKnown, StrDeserializer};
use sim_core::base::limits::MAX_NAME_LENGTH;
use sim_core::base::registry::Chosen;
use sim_core::job::{JobSpec, Reference};
use sim_core::plan::PlannerKind;
use sim_core::problem::{Checked, PLAN, PlanSpec};

/// Default number of trees.
const SEEDS: u32 = 20;

/// Creates the job and runs it like `evogait run`.
pub fn run(args: Plan, quiet: bool) -> Result<(), Error> {
    let given = read(&args.of)?;
    let spec = job(&args, &given)?;
    let label = format!("a plan with the gaits of {}", given.called);
    let job = Checked::new(spec).map_err(|source| Error::Invalid { file: label, source })?;
    carry_out(&job, args.to, quiet)
}

/// Returns the job that plans: the job of the run, changed by the options.
fn job(args: &Plan, given: &SourceRun) -> Result<JobSpec, Error> {
    let mut spec = given.job.spec().clone();
    if let Some(name) = &args.environment {
        let (environment, _) = load::environment(name)?;
        spec.environment = Reference::Inline(Box::new(environment));
    }
    if let Some(name) = &args.algorithm {
        let named: StrDeserializer<'_, NotKnown> = name.as_str().into_deserializer();
        spec.planner.algorithm = Chosen::<dyn PlannerKind>::deserialize(named)
            .map_err(|e| Error::Usage { message: format!("--algorithm: {e}") })?;
    }
    spec.planner.iterations = args.iterations.unwrap_or(spec.planner.iterations);
    spec.planner.reuse_tolerance = args.reuse_tolerance.unwrap_or(spec.planner.reuse_tolerance);
    (spec.planner.repeats, spec.planner.max_rollouts) = (1, None);
    spec.planner.stop_at_goal = args.whole_trees.then_some(false);
    spec.seed = args.seed.unwrap_or(spec.seed);
    let environment = match &spec.environment {
        Reference::Inline(environment) => environment.name.clone(),
        Reference::Named(name) => name.clone(),
    };
    spec.description = format!("Plans with the gaits of {} ({}).", spec.name, given.job.digest().short());
    spec.name = format!("{}-plans-{environment}", spec.name).chars().take(MAX_NAME_LENGTH).collect();
    spec.plan = Some(PlanSpec { seeds: args.seeds.unwrap_or(SEEDS), gaits: given.set() });
    spec.procedure = Some(PLAN.to_owned());
    (spec.fitness, spec.optimiser, spec.finish) = (None, None, None);
    Ok(spec)
}
