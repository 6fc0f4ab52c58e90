//! The registry of procedures: one line each.

use super::{ProcedureKind, evolve};
use crate::problem::Checked;

/// All kinds of procedures; the first is that of a job that names none.
pub static KINDS: &[&dyn ProcedureKind] = &[&evolve::Kind];

/// The kind of a job's procedure.
pub(super) fn of(_problem: &Checked) -> &'static dyn ProcedureKind {
    KINDS[0]
}
