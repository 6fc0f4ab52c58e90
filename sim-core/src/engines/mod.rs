//! The engines by name, what makes two of them the same, how faithful they are, and which one a job runs on.

pub(crate) mod auto;
mod digest;
mod golden;
pub mod known;
mod settle;

pub use auto::{Chosen, Why};
pub use digest::{NUMERIC_CRATES, engine_digest, engine_digests, engines_digest};
pub use settle::{Quiet, Settled, settle_quietly, settle_quietly_until};

use crate::physics::lockstep::LockstepEngine;
use crate::physics::{Engine, EngineKind, RapierEngine};

/// The engine of a kind.
pub fn engine(kind: EngineKind) -> &'static dyn Engine {
    match kind {
        EngineKind::Rapier => &RapierEngine,
        EngineKind::Lockstep => &LockstepEngine,
    }
}
