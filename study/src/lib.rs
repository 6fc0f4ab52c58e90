//! Studies: the measurements of engines, planners and objectives behind `evogait bench`. They change no result of a
//! job.
//!
//! Studies measure time, so this crate reads clocks ([`clock`]); sim-core has none. It does no I/O: commands read and
//! write files. A study reports its progress through callbacks.

pub mod clock;
pub mod cost;
pub mod fidelity;
pub mod fitness;
pub mod gaits;
pub mod genotypes;
pub mod planning;
pub mod reuse;
pub mod setting;
pub mod soundness;
pub mod speed;
pub mod statistics;
pub mod subject;
pub mod threads;
