//! Tests across processes: real coordinators and workers, talking over loopback, killed at will.

pub mod openmetrics;
pub mod proxy;
pub mod sandbox;
pub mod scripted;
