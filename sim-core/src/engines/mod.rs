//! Physics engines by name, their digests and fidelity, and the choice of a job's engine.

pub(crate) mod auto;
mod digest;
pub mod fidelity;
mod golden;
mod settle;

pub use auto::{Chosen, Why};
pub use digest::{NUMERIC_CRATES, engine_digest, engine_digests, engines_digest};
pub use settle::{Quiet, Settled, settle_quietly, settle_quietly_until};

use crate::physics::lockstep::LockstepEngine;
use crate::physics::{Engine, EngineKind, RapierEngine};

/// Returns the engine of a kind.
pub fn engine(kind: EngineKind) -> &'static dyn Engine {
    match kind {
        EngineKind::Rapier => &RapierEngine,
        EngineKind::Lockstep => &LockstepEngine,
    }
}
