//! The output folder: what is in it, how it gets there, how it is read back.

pub mod atomic;
mod csv;
mod folder;
mod gaits;
mod pictures;
mod result;
mod stored;
mod write;

pub use csv::{gait as gait_csv, mode as mode_word, paths as paths_csv};
pub use folder::Folder;
pub use gaits::displacement;
pub use pictures::png;
pub use result::{Candidate, ResultFile};
pub use stored::Stored;
pub use write::write;

/// The summary of all that was found; written last, so where it is, the rest is.
pub const RESULT: &str = "result.json";
/// The resolved job.
pub const JOB: &str = "job.toml";
/// The report as the worker made it.
pub const REPORT: &str = "report.json";
/// The store of a run on this machine.
pub const STORE: &str = "store.sqlite";
