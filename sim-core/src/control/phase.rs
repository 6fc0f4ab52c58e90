//! The phase that a motion of signals ends in: the last target of every joint, which its speed may keep behind the signal, and
//! the controller's own state.

use super::Infeasible;
use crate::model::Phase;

/// The phase of these targets, rad, and this state.
pub(super) fn write(state: &[u8], targets: &[f32]) -> Phase {
    Phase(targets.iter().flat_map(|target| target.to_le_bytes()).chain(state.iter().copied()).collect())
}

/// The controller's state of a phase, and the target of each of so many joints.
pub(super) fn read(phase: &Phase, joints: usize) -> Result<(&[u8], Vec<f32>), Infeasible> {
    let Some((targets, state)) = phase.0.split_at_checked(4 * joints) else { return Err(unfit()) };
    let (targets, _) = targets.as_chunks();
    Ok((state, targets.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()))
}

/// The refusal of a state that the controller did not write for this gait.
pub(super) fn unfit() -> Infeasible {
    Infeasible("it can't go on from the phase of another gait".to_owned())
}
