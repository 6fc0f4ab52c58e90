//! `evogait plan`: writes a job that plans with the gaits of a run, and runs it.

use super::run::carry_out;
use crate::arguments::{Plan, PlanOf};
use crate::client::Client;
use crate::error::Error;
use crate::output::Stored;
use crate::{load, watch};
use serde::Deserialize;
use serde::de::IntoDeserializer as _;
use serde::de::value::{Error as NotKnown, StrDeserializer};
use sim_core::base::limits::MAX_NAME_LENGTH;
use sim_core::base::registry::Chosen;
use sim_core::genotype::Genotype;
use sim_core::job::{JobSpec, Reference};
use sim_core::plan::PlannerKind;
use sim_core::problem::{Checked, GaitSet, PLAN, PlanSpec};
use sim_core::procedure::evolve::report::Report;

/// Trees unless told otherwise.
const SEEDS: u32 = 20;

/// Makes the job and runs it as `evogait run` does.
pub fn run(args: Plan, quiet: bool) -> Result<(), Error> {
    let (evolved, gaits, called) = evolved(&args.of)?;
    let spec = job(&args, &evolved, &gaits)?;
    let label = format!("a plan with the gaits of {called}");
    let job = Checked::new(spec).map_err(|source| Error::Invalid { file: label, source })?;
    carry_out(&job, args.to, quiet)
}

/// The job that evolved the gaits, its winner, and how to call it.
fn evolved(of: &PlanOf) -> Result<(Checked, Genotype, String), Error> {
    match of {
        PlanOf::Folder(folder) => {
            let stored = Stored::read(folder)?;
            let no_winner = || Error::NoWinner { folder: folder.clone() };
            let winner = stored.result.winner.as_ref().ok_or_else(no_winner)?.scored().genotype;
            Ok((stored.job.checked().clone(), winner, folder.display().to_string()))
        }
        PlanOf::Stored { id, on } => super::with_runtime(async {
            let mut client = Client::connect(on).await?;
            let (status, _) = client.get(id).await?;
            watch::succeeded(&status)?;
            let answer = client.result(id).await?;
            let called = format!("job {id}");
            let invalid = |source| Error::Invalid { file: called.clone(), source };
            let job = Checked::from_toml(&answer.job_toml).map_err(invalid)?;
            load::must_evolve(&job, &called)?;
            let unreadable = |reason: String| Error::Answer { url: on.to_string(), reason };
            let report = answer.artefacts.iter().find(|artefact| artefact.name == "report");
            let report = report.ok_or_else(|| unreadable("the job has no report".to_owned()))?;
            let report: Report =
                serde_json::from_slice(&report.content).map_err(|e| unreadable(format!("the report: {e}")))?;
            Ok((job, report.winner.genotype, called))
        }),
    }
}

/// The job that plans: that of the run but for what was asked for.
fn job(args: &Plan, evolved: &Checked, gaits: &Genotype) -> Result<JobSpec, Error> {
    let mut spec = evolved.spec().clone();
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
    spec.description = format!("Plans with the gaits of {} ({}).", spec.name, evolved.digest().short());
    spec.name = format!("{}-plans-{environment}", spec.name).chars().take(MAX_NAME_LENGTH).collect();
    let genome = gaits.gaits(spec.gaits.count as usize).map(<[f64]>::to_vec).collect();
    let set = GaitSet { joints: evolved.robot().joint_names(), genome };
    spec.plan = Some(PlanSpec { seeds: args.seeds.unwrap_or(SEEDS), gaits: Reference::Inline(Box::new(set)) });
    spec.procedure = Some(PLAN.to_owned());
    (spec.fitness, spec.optimiser, spec.finish) = (None, None, None);
    Ok(spec)
}
