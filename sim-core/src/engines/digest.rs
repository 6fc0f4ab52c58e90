//! Digests that identify engines by revision, crate versions and golden rollout.

use super::golden::golden_rollout;
use crate::base::digest::Digest;
use crate::physics::{EngineKind, lockstep};
use std::sync::OnceLock;

/// Revision of the engines, raised by hand when a change in this project alters rollouts. Planners, objectives,
/// searches, controllers and procedures have their own revisions.
const REVISION: u32 = 2;

/// Exact versions of the crates with arithmetic that results depend on. `tests/laws/versions.rs` compares them with
/// `Cargo.lock`.
pub const NUMERIC_CRATES: &[(&str, &str)] = &[
    ("rapier3d", "0.36.1"),
    ("parry3d", "0.31.1"),
    ("glam", "0.33.12"),
    ("nalgebra", "0.35.0"),
    ("libm", "0.2.16"),
    ("fearless_simd", "1.2.0"),
];

/// Returns the digest of an engine in this build and on this machine: revision, crate versions and the bits of a short
/// golden rollout. A worker runs a job only if it has an engine with the same digest.
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

/// Returns the digest that a job needs if it searches on one engine and chooses its winner on another. It covers both
/// engines, so all tasks of the job are leased to workers that have both.
pub fn engines_digest(search: EngineKind, finish: EngineKind) -> Digest {
    if search == finish {
        return engine_digest(search);
    }
    Digest::of("evogait engines 1", &(engine_digest(search), engine_digest(finish)))
}

/// Returns name and digest of every engine, or pair of engines, that jobs of this build may need.
pub fn engine_digests() -> Vec<(&'static str, Digest)> {
    let (rapier, lockstep) = (EngineKind::Rapier, EngineKind::Lockstep);
    vec![
        ("rapier", engine_digest(rapier)),
        ("lockstep", engine_digest(lockstep)),
        ("lockstep with rapier", engines_digest(lockstep, rapier)),
    ]
}
