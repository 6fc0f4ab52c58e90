//! Tests across processes: real coordinators and workers, talking over loopback, killed at will.

pub mod certificates;
pub mod chains;
pub mod crashes;
pub mod openmetrics;
pub mod parsers;
pub mod postgres;
pub mod proxy;
pub mod sandbox;
pub mod scripted;
