//! Gaits of a finished run for jobs that use them. The run is a folder or a coordinator's job.

use crate::arguments::RunOf;
use crate::client::Client;
use crate::error::Error;
use crate::output::{Stored, StoredPlans};
use crate::{load, watch};
use sim_core::genotype::Genotype;
use sim_core::job::Reference;
use sim_core::problem::{Checked, GaitSet, JobKind};
use sim_core::procedure::evolve::report::Report;
use sim_core::procedure::plan::{Grown, PlanReport};
use sim_core::report::TreeRecord;

/// Job, gaits and best plan of a finished run.
pub struct SourceRun {
    /// Job of the run.
    pub job: Checked,
    /// Genotype of the winner, or the gaits that the run planned with.
    pub gaits: Genotype,
    /// Name of the run in messages.
    pub called: String,
    /// Best plan: numbers of the gaits, from 1, and the pose after each (x, y, z, yaw); `None` if the run has none.
    plan: Option<Plan>,
}

type Plan = (Vec<u32>, Vec<[f64; 4]>);

impl SourceRun {
    /// Returns the gaits as a table of a job.
    pub fn set(&self) -> Reference<GaitSet> {
        let genome = self.gaits.gaits(self.job.gaits().count as usize).map(<[f64]>::to_vec).collect();
        Reference::Inline(Box::new(GaitSet { joints: self.job.robot().joint_names(), genome }))
    }

    /// Returns the best plan.
    ///
    /// # Errors
    /// If the plan has no step.
    pub fn plan(&self) -> Result<Plan, Error> {
        let message =
            || format!("{} has no plan, as its best path has no step: simulate a gait with --gait N", self.called);
        self.plan.clone().filter(|(steps, _)| !steps.is_empty()).ok_or_else(|| Error::Usage { message: message() })
    }
}

/// Reads the gaits of a run that evolved them or planned with them.
pub fn read(of: &RunOf) -> Result<SourceRun, Error> {
    match of {
        RunOf::Folder(folder) => {
            let called = folder.display().to_string();
            if let Some(stored) = StoredPlans::read(folder)? {
                return planned(stored.job.checked().clone(), &stored.report, called);
            }
            let stored = Stored::read(folder)?;
            let no_winner = || Error::NoWinner { folder: folder.clone() };
            let gaits = stored.result.winner.as_ref().ok_or_else(no_winner)?.scored().genotype;
            let plan = Some(best_path(&stored.report()?.tree));
            Ok(SourceRun { job: stored.job.checked().clone(), gaits, called, plan })
        }
        RunOf::Stored { id, on } => super::with_runtime(async {
            let mut client = Client::connect(on).await?;
            let (status, _) = client.get(id).await?;
            watch::succeeded(&status)?;
            let answer = client.result(id).await?;
            let called = format!("job {id}");
            let invalid = |source| Error::Invalid { file: called.clone(), source };
            let job = Checked::from_toml(&answer.job_toml).map_err(invalid)?;
            let plans = job.kind() == JobKind::Plan;
            if !plans {
                load::must_evolve(&job, &called)?;
            }
            let unreadable = |reason: String| Error::Answer { url: on.to_string(), reason };
            let name = if plans { "plans" } else { "report" };
            let report = answer.artefacts.iter().find(|artefact| artefact.name == name);
            let report = report.ok_or_else(|| unreadable("the job has no report".to_owned()))?;
            let damaged = |e: serde_json::Error| unreadable(format!("the report: {e}"));
            if plans {
                let report: PlanReport = serde_json::from_slice(&report.content).map_err(damaged)?;
                return planned(job, &report, called);
            }
            let report: Report = serde_json::from_slice(&report.content).map_err(damaged)?;
            let plan = Some(best_path(&report.tree));
            Ok(SourceRun { job, gaits: report.winner.genotype, called, plan })
        }),
    }
}

fn planned(job: Checked, report: &PlanReport, called: String) -> Result<SourceRun, Error> {
    let gaits = job.given_gaits().cloned().unwrap_or_else(|| Vec::new().into());
    let of_best = |Grown { plan, .. }: &Grown| -> Plan {
        plan.iter().map(|step| (step.gait + 1, [step.x, step.y, step.z, step.yaw])).unzip()
    };
    let plan = report.plans.get(report.best as usize).and_then(Option::as_ref).map(of_best);
    Ok(SourceRun { job, gaits, called, plan })
}

fn best_path(tree: &TreeRecord) -> Plan {
    let steps = tree.best_path.iter().filter_map(|&node| {
        let node = tree.nodes.get(node)?;
        Some((node.gait? as u32 + 1, [node.x, node.y, node.z, node.yaw]))
    });
    steps.unzip()
}
