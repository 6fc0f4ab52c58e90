//! Rollouts: one motion simulated from one state, by engines behind an interface that takes a batch.

mod engine;
pub mod lockstep;
mod motion;
mod rapier;
mod settings;
mod settle;
mod trace;

pub use engine::{Engine, Request, Unsupported};
pub(crate) use motion::Course;
pub use motion::{Change, Event, Motion, TICK, Targets, Track};
pub use rapier::RapierEngine;
pub use settings::{EngineChoice, EngineKind, JointKind, Physics, PhysicsSpec, Scale};
pub use settle::{LONGEST_SETTLING, Unsettled, settle, settle_until};
pub(crate) use settle::{canonical, settle_still};
pub use trace::{Bound, Effort, Outcome, Rollout, Span, Trace};
pub(crate) use trace::{sample_every, spans};
