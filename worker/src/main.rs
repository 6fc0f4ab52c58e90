//! The worker's binary.

use clap::Parser;
use std::process::ExitCode;
use tokio::signal::unix::{SignalKind, signal};
use worker::{Config, Error};

/// Runs evaluations for a coordinator.
///
/// A worker holds nothing that matters: start as many as there are machines, stop or kill them at any time. It waits for
/// its coordinator, keeps computing while the connection is down, and delivers when it is back.
#[derive(Parser)]
#[command(
    name = "worker",
    version,
    after_help = "Example:
  worker --coordinator http://127.0.0.1:7077 --slots 4

SIGINT and SIGTERM give back what runs and end the worker with exit code 0. Messages go to standard error (RUST_LOG=debug
for more)."
)]
struct Arguments {
    /// The coordinator to work for
    #[arg(long, value_name = "URL", default_value = "http://127.0.0.1:7077")]
    coordinator: String,

    /// Evaluations at once [default: one a core]
    #[arg(long, value_name = "N")]
    slots: Option<usize>,

    /// How people will see it in `evogait` [default: host and process]
    #[arg(long)]
    name: Option<String>,

    #[command(flatten)]
    telemetry: telemetry::Options,
}

#[tokio::main(worker_threads = 2)]
async fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let _logging = match telemetry::logs::start(arguments.telemetry.log_format, "worker") {
        Ok(logging) => logging,
        Err(error) => {
            eprintln!("worker: {error}");
            return ExitCode::FAILURE;
        }
    };
    match run(arguments).await {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("worker: {error}");
            ExitCode::FAILURE
        }
    }
}

async fn run(arguments: Arguments) -> Result<(), Error> {
    let signals = |kind| signal(kind).map_err(|e| Error::System(format!("signals can't be received: {e}")));
    let (mut interrupt, mut terminate) = (signals(SignalKind::interrupt())?, signals(SignalKind::terminate())?);
    let shutdown = async move {
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
        }
        tracing::info!("stopping: what runs is given back");
    };
    let config = Config {
        coordinator: arguments.coordinator,
        slots: arguments.slots.unwrap_or_else(worker::default_slots),
        name: arguments.name.unwrap_or_else(worker::default_name),
        metrics: arguments.telemetry.bind(),
    };
    worker::run(config, shutdown).await
}
