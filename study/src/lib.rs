//! Studies: what `evogait bench` measures of engines, planners and objectives. They change no result of a job.
//!
//! Studies measure time, so this crate reads clocks ([`clock`]); sim-core has none. It does no I/O: commands read and
//! write files, and draw the progress that a study reports through callbacks.

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
