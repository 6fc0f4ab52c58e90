//! What holds of robots, rollouts, planners, searches and procedures, seen from outside the crate: closed forms, invariants and
//! recorded bits. One program: each more would cost as long to link and optimise as all of its tests take to run.
//!
//! No test here adds a component to a registry: some go through all that are registered.

mod budget;
mod events;
mod exchange;
mod finish;
mod fixed_parameters;
mod formats;
mod import_kinds;
mod jobs;
mod misspelt;
mod motions;
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
mod simulating;
mod starts;
mod states;
mod trees;
mod versions;
