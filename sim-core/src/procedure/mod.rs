//! Procedures: what a job does, round by round.

pub mod evolve;
