//! Components that another program adds to the registries: robots and jobs use them like those that ship.
//!
//! A registry only grows, and serves all tests of this program: each test adds what it uses under names of its own.

mod examples;
mod jobs;
mod kind;
mod planner;
mod procedure;
mod search;
mod spaces;
