//! Engines of this build.

use sim_core::base::digest::Digest;

/// Digests of this worker's engines.
#[derive(Debug)]
pub(crate) struct Engines(Vec<Digest>);

impl Engines {
    /// Runs each engine's short golden rollout and stores the digests.
    pub fn measure() -> Self {
        Self(sim_core::engines::engine_digests().into_iter().map(|(_, digest)| digest).collect())
    }

    /// Returns the digests as bytes for Hello.
    pub fn to_wire(&self) -> Vec<Vec<u8>> {
        self.0.iter().map(|d| d.0.to_vec()).collect()
    }

    pub fn has(&self, digest: &Digest) -> bool {
        self.0.contains(digest)
    }
}
