//! Phase at the end of a motion: the last target of every joint and the controller's own state. A joint's greatest
//! speed can keep its target behind the signal.

use super::Infeasible;
use crate::model::Phase;

/// Encodes the controller's state and the joint targets, rad, as a phase.
pub(super) fn write(state: &[u8], targets: &[f32]) -> Phase {
    Phase(targets.iter().flat_map(|target| target.to_le_bytes()).chain(state.iter().copied()).collect())
}

/// Decodes a phase into the controller's state and the targets of `joints` joints, rad.
pub(super) fn read(phase: &Phase, joints: usize) -> Result<(&[u8], Vec<f32>), Infeasible> {
    let Some((targets, state)) = phase.0.split_at_checked(4 * joints) else { return Err(unfit()) };
    let (targets, _) = targets.as_chunks();
    Ok((state, targets.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()))
}

/// Returns the error for a state that the controller did not write for this gait.
pub(super) fn unfit() -> Infeasible {
    Infeasible("its start phase is that of another gait; use the end phase of a motion of the same gait".to_owned())
}
