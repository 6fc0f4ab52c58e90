//! The coordinator: takes jobs in, runs their population loops, hands evaluations to workers, keeps everything.
//!
//! `scheduler` decides and knows neither network nor clock; `store` keeps; `api` talks; `actor` holds them together; `door` and
//! `access` say who may come in and who may call what; `journal` and `metrics` tell whoever runs it.

mod access;
mod actor;
mod api;
mod convert;
mod door;
mod fail_point;
mod journal;
pub mod limits;
mod live;
mod metrics;
#[cfg(unix)]
pub mod open_files;
#[doc(hidden)]
pub mod parsers;
pub mod permit;
mod pulse;
pub mod record;
pub mod scheduler;
mod seldom;
mod server;
mod standby;
pub mod store;

pub use access::{Access, Role, TokensError};
pub use api::scaler::ScalerError;
pub use server::{Config, Error, Running, Tls, serve};
pub use store::{BadStoreUrl, StoreError, StoreUrl};
