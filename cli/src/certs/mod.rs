//! A CA of one's own, certificates that it signs, and tokens: what a small cluster needs to close its doors.

mod folder;
mod make;

pub use folder::{init, renew};
pub use make::{CA_DAYS, Host};
