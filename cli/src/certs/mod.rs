//! CA, certificates and tokens for a small cluster without a public key infrastructure of its own.

mod folder;
mod make;

pub use folder::{init, renew};
pub use make::{CA_DAYS, Host};
