//! Coordinator: accepts jobs, runs their procedures round by round, leases tasks to workers and stores all results.
//!
//! `scheduler` makes the decisions and uses neither network nor clock; `store` persists; `api` serves calls; `actor`
//! connects them. `listener` limits connections and `access` authorises calls; `journal` and `metrics` report to the
//! operator.

mod access;
mod actor;
mod api;
mod convert;
mod fail_point;
mod journal;
pub mod limits;
mod listener;
mod live;
mod log_limit;
mod metrics;
#[cfg(unix)]
pub mod open_files;
#[doc(hidden)]
pub mod parsers;
pub mod permit;
pub mod record;
pub mod scheduler;
mod server;
mod standby;
pub mod store;
mod vitals;

pub use access::{Access, Role, TokensError};
pub use api::scaler::ScalerError;
pub use server::{Config, Error, Running, Tls, serve};
pub use store::{BadStoreUrl, StoreError, StoreUrl};
