//! Tests across processes: real coordinators and workers, connected over loopback and killed at any time.

pub mod certificates;
pub mod chains;
pub mod crashes;
pub mod openmetrics;
pub mod parsers;
pub mod postgres;
pub mod proxy;
pub mod sandbox;
pub mod scripted;
