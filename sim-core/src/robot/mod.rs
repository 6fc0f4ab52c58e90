//! Robots.
mod spec;
pub use spec::*;
