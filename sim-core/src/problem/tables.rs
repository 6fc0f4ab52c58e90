//! The tables of a job: those that its procedure needs, and the checks of each table on its own.

use super::{JobSpec, PLAN, SIMULATE, SimulateSpec};
use crate::base::error::{Faults, Invalid, name, whole_in_range};
use crate::base::limits;
use crate::control::validate_gaits;
use crate::plan::{PlannerSpec, validate_planner};

/// Kind of work that a job does, by the tables that it needs. A procedure that another program registers counts as
/// [`JobKind::Evolve`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JobKind {
    /// The search for gaits.
    Evolve,
    /// The growth of trees with given gaits.
    Plan,
    /// The execution of a given motion.
    Simulate,
}

impl JobKind {
    pub(super) fn of(spec: &JobSpec) -> Self {
        match spec.procedure.as_deref() {
            Some(PLAN) => Self::Plan,
            Some(SIMULATE) => Self::Simulate,
            _ => Self::Evolve,
        }
    }
}

/// Checks every table that needs no other part of the job, and resolves `[simulate]`.
pub(super) fn check_tables(spec: &mut JobSpec, faults: &mut Faults) {
    faults.take(name("name", &spec.name));
    let most = limits::MAX_DESCRIPTION_LENGTH as u64;
    faults.take(whole_in_range("description length", spec.description.len() as u64, (0, most), "bytes"));
    faults.take(whole_in_range("seed", spec.seed, (0, limits::MAX_SEED), ""));
    faults.take(spec.gaits.as_ref().map_or(Ok(()), validate_gaits));
    faults.take(validate_planner(&spec.planner));
    faults.take(tables_of_procedure(spec));
    if let Some(optimiser) = &spec.optimiser {
        faults.take(optimiser.validate());
    }
    if let Some(plan) = &spec.plan {
        faults.take(plan.validate(spec.planner.iterations));
    }
    if let Some(simulate) = &mut spec.simulate {
        faults.take(simulate.resolve());
    }
}

/// Rejects jobs with a table that their procedure does not use, and jobs without a table that it needs.
fn tables_of_procedure(spec: &JobSpec) -> Result<(), Invalid> {
    let does = JobKind::of(spec);
    let [evolves, plans, simulates] = [JobKind::Evolve, JobKind::Plan, JobKind::Simulate].map(|one| does == one);
    let needs_gaits = spec.simulate.as_ref().is_none_or(SimulateSpec::uses_gaits);
    let what = spec.procedure.as_deref().map_or("a job without `procedure`, which evolves,".to_owned(), |name| {
        format!("a job with procedure = \"{name}\"")
    });
    let conflict = |field: &str, reason: String| Err(Invalid::Conflict { field: field.to_owned(), reason });
    // Per table: its name, its presence, and `Some(true)` if it is required, `Some(false)` if forbidden, `None` if
    // optional.
    for (table, there, wanted) in [
        ("gaits", spec.gaits.is_some(), Some(!simulates || needs_gaits)),
        ("fitness", spec.fitness.is_some(), (!plans).then_some(evolves)),
        ("optimiser", spec.optimiser.is_some(), Some(evolves)),
        ("plan", spec.plan.is_some(), Some(plans)),
        ("simulate", spec.simulate.is_some(), Some(simulates)),
        ("finish", spec.finish.is_some(), (!evolves).then_some(false)),
    ] {
        match (there, wanted) {
            (false, Some(true)) => return conflict(table, format!("{what} needs this table: add it")),
            (true, Some(false)) => return conflict(table, format!("{what} has no such table: leave it out")),
            _ => {}
        }
    }
    if !evolves && spec.planner.repeats != 1 {
        let reason =
            "a job that plans or simulates does not use this key: leave it out; a job that plans has plan.seeds";
        return conflict("planner.repeats", reason.to_owned());
    }
    let grows = !simulates || spec.simulate.as_ref().is_some_and(|simulate| simulate.replan.is_some());
    if !grows && spec.planner != PlannerSpec::default() {
        let reason = "a job that simulates grows trees only if it replans: leave the table out, or add \
                      [simulate.replan]";
        return conflict("planner", reason.to_owned());
    }
    Ok(())
}
