//! Studies: what `evogait bench` measures of engines, planners and objectives. They change no result of a job.

pub mod fidelity;
pub mod fitness;
pub mod genotypes;
pub mod reuse;
pub mod soundness;
pub mod statistics;
