//! Digests of engines: what makes two of them the same.

use super::golden::golden_rollout;
use crate::base::digest::Digest;
use crate::physics::{EngineKind, lockstep};
use std::sync::OnceLock;

/// Raised by hand when a change of ours alters rollouts. Planners, objectives, searches, controllers and procedures have
/// revisions of their own.
const REVISION: u32 = 2;

/// The exact versions of the crates with arithmetic that results depend on; `tests/versions.rs` compares them with
/// `Cargo.lock`.
pub const NUMERIC_CRATES: &[(&str, &str)] = &[
    ("rapier3d", "0.36.1"),
    ("parry3d", "0.31.1"),
    ("glam", "0.33.12"),
    ("nalgebra", "0.35.0"),
    ("libm", "0.2.16"),
    ("fearless_simd", "1.2.0"),
];

/// The digest of an engine as this build and machine have it: revision, crate versions and the bits of a short golden
/// rollout. A worker runs a job only if it has an engine of the same digest.
pub fn engine_digest(kind: EngineKind) -> Digest {
    match kind {
        EngineKind::Rapier => {
            static DIGEST: OnceLock<Digest> = OnceLock::new();
            *DIGEST.get_or_init(|| {
                Digest::of("evogait engine rapier 1", &(REVISION, NUMERIC_CRATES, golden_rollout(kind)))
            })
        }
        EngineKind::Lockstep => {
            static DIGEST: OnceLock<Digest> = OnceLock::new();
            *DIGEST.get_or_init(|| {
                let revisions = (REVISION, lockstep::REVISION);
                Digest::of("evogait engine lockstep 1", &(revisions, NUMERIC_CRATES, golden_rollout(kind)))
            })
        }
    }
}

/// Digest that a job needs if it searches on one engine and chooses its winner on another: both, so that all of its
/// tasks are leased to workers that have both.
pub fn engines_digest(search: EngineKind, finish: EngineKind) -> Digest {
    if search == finish {
        return engine_digest(search);
    }
    Digest::of("evogait engines 1", &(engine_digest(search), engine_digest(finish)))
}

/// Engines that jobs of this build may need: name and digest.
pub fn engine_digests() -> Vec<(&'static str, Digest)> {
    let (rapier, lockstep) = (EngineKind::Rapier, EngineKind::Lockstep);
    vec![
        ("rapier", engine_digest(rapier)),
        ("lockstep", engine_digest(lockstep)),
        ("lockstep with rapier", engines_digest(lockstep, rapier)),
    ]
}
