//! `evogait`: command line for evolving gait sets of modular robots and planning with them. It is a gRPC client of the
//! coordinator, which it can start in its own process.
//!
//! Order of calls: [`main`] → `arguments` (parses and resolves the command line) → `commands` (one file per command) →
//! `output`.

mod arguments;
mod certs;
mod client;
mod commands;
mod console;
pub mod draw;
mod error;
mod failed_task;
mod first_generation;
mod gait_set;
mod inputs;
mod load;
mod local;
mod output;
mod plausibility;
mod progress;
mod signals;
mod standing;
mod summary;
mod target_table;
mod values;
mod view;
mod watch;

use std::process::ExitCode;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::prelude::*;

/// Runs the command line of this process. Errors are printed to standard error as one sentence.
pub fn main() -> ExitCode {
    // Logs are for debugging only: messages for users are errors or notes.
    if let Some(filter) = std::env::var("EVOGAIT_LOG").ok().and_then(|text| text.parse::<Targets>().ok()) {
        let messages = tracing_subscriber::fmt::layer().with_writer(std::io::stderr).with_filter(filter);
        tracing_subscriber::registry().with(messages).init();
    }
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
