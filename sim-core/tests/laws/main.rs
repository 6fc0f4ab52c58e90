//! Tests of robots, rollouts, planners, searches and procedures through the crate's public API: closed forms,
//! invariants and recorded bits. All are in one program, because linking and optimising a second one would take as
//! long as its tests.
//!
//! No test here adds a component to a registry, because some tests iterate over all registered components.

mod budget;
mod events;
mod exchange;
mod finish;
mod fixed_parameters;
mod formats;
mod import_doubts;
mod import_kinds;
mod jobs;
mod misspelt;
mod motions;
mod mtran;
mod nearest;
mod optimisers;
mod own_joints;
mod phases;
mod planning;
mod preparing;
mod procedure;
mod recorded_trees;
mod reuse;
mod rollouts;
mod sequence_search;
mod sequences;
mod simulating;
mod starts;
mod states;
mod trees;
mod versions;
