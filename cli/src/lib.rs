//! `evogait`: evolve gait sets for modular robots from the command line. A gRPC client of the coordinator, which it can
//! start in its own process.
//!
//! The way through: [`main`] → `arguments` (what was typed → what is meant) → `commands` (one file each) → `output`.

mod arguments;
mod client;
mod commands;
mod console;
pub mod draw;
mod error;
mod load;
mod local;
mod output;
mod progress;
mod signals;
mod summary;
mod view;
mod watch;

use std::process::ExitCode;

/// Runs the command line of this process. Errors are told on standard error, in a sentence.
pub fn main() -> ExitCode {
    // Logs are for debugging: what a user must know is an error or a note.
    let filter = tracing_subscriber::EnvFilter::try_from_env("EVOGAIT_LOG")
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new("off"));
    tracing_subscriber::fmt().with_env_filter(filter).with_writer(std::io::stderr).init();
    match arguments::parse().and_then(commands::execute) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            if !matches!(error, error::Error::OutputClosed) {
                console::note(&format!("error: {error}"));
            }
            error.exit_code()
        }
    }
}
