//! Components that another program adds to the registries. Robots and jobs use them like the shipped ones.
//!
//! Registries only grow and are shared by all tests of this program. Each test therefore adds components under its own
//! names.

mod examples;
mod jobs;
mod kind;
mod planner;
mod procedure;
mod search;
mod spaces;
