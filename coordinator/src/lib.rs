//! The coordinator: takes jobs in, runs their population loops, hands evaluations to workers, keeps everything.
//!
//! `scheduler` decides and knows neither network nor clock; `store` keeps; `api` talks; `actor` holds them together; `journal` and `metrics` tell
//! whoever runs it.

mod actor;
mod api;
mod journal;
pub mod limits;
mod metrics;
#[cfg(unix)]
pub mod open_files;
pub mod record;
pub mod scheduler;
mod server;
pub mod store;

pub use server::{Config, Error, Running, serve};
pub use store::{StoreError, StoreUrl};
