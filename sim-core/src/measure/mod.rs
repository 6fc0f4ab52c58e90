//! Measures of the engine itself: how near one setting comes to another, and the statistics that say how sure that is.

pub mod fidelity;
pub mod fitness;
pub mod genomes;
pub mod known;
pub mod reuse;
pub mod soundness;
pub mod statistics;
