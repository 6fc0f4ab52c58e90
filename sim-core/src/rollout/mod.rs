//! Rollouts: one gait simulated from one state. The engines that do it stand behind one interface that takes a batch.

mod engine;
mod rapier;
mod settings;
mod settle;
mod trace;

pub use engine::{Engine, NUMERIC_CRATES, Request, engine, engine_digest, engine_digests, engines_digest};
pub use rapier::RapierEngine;
pub use settings::Physics;
pub(crate) use settle::canonical;
pub use settle::{
    LONGEST as LONGEST_SETTLING, Quiet, Settled, Unsettled, settle, settle_quietly, settle_quietly_until, settle_until,
};
pub use trace::{Bound, Outcome, Rollout, Span, Trace};
pub(crate) use trace::{sample_every, spans};
