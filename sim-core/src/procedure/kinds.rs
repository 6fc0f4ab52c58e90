//! Registry of procedures.

use super::{ProcedureKind, evolve, plan, simulate};
use crate::base::error::Invalid;
use crate::base::registry::{Registered, Registry};
use crate::problem::JobSpec;

/// All kinds of procedures; the first is the default.
static KINDS: Registry<dyn ProcedureKind> =
    Registry::new(&[&evolve::EvolveProcedure, &plan::PlanProcedure, &simulate::SimulateProcedure]);

impl Registered for dyn ProcedureKind {
    fn registry() -> &'static Registry<Self> {
        &KINDS
    }
}

/// Returns the kind of a job's procedure.
pub fn of(job: &JobSpec) -> Result<&'static dyn ProcedureKind, Invalid> {
    let Some(name) = &job.procedure else { return Ok(KINDS.default()) };
    KINDS.find(name).ok_or_else(|| Invalid::Unknown {
        field: "procedure".to_owned(),
        value: name.clone(),
        known: KINDS.names().into_iter().map(str::to_owned).collect(),
    })
}
