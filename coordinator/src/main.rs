//! The coordinator's binary.

use clap::Parser;
use coordinator::{Config, Error, StoreUrl};
use std::io::Write as _;
use std::net::SocketAddr;
use std::process::ExitCode;
use std::time::Duration;
use tokio::signal::unix::{SignalKind, signal};

/// Takes jobs in and hands their evaluations to workers.
///
/// Everything is kept in the store: a coordinator that is stopped or dies goes on where it was when it is started again
/// on the same store. Workers wait for it meanwhile, and lose nothing.
#[derive(Parser)]
#[command(
    name = "coordinator",
    version,
    after_help = "Example, on one machine:
  coordinator --store sqlite:evogait.db
  worker --coordinator http://127.0.0.1:7077
  evogait submit JOB.toml --coordinator http://127.0.0.1:7077

The first line on standard output says where it listens, a second one where metrics are served; messages go to standard error (RUST_LOG=debug for more).
SIGINT and SIGTERM stop it cleanly."
)]
struct Arguments {
    /// Where to listen. Port 0 takes any free port
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:7077")]
    listen: SocketAddr,

    /// Where jobs are kept: sqlite:PATH. The file is made if it is not there
    #[arg(long, value_name = "URL", default_value = "sqlite:evogait.db")]
    store: StoreUrl,

    /// Without a sign of life for this long, a worker's work goes to others
    #[arg(long, value_name = "SECONDS", default_value_t = 15.0)]
    lease_seconds: f64,

    /// Listen beyond loopback, without encryption or passwords: everybody who can reach the port can run jobs
    #[arg(long)]
    insecure_bind: bool,

    #[command(flatten)]
    telemetry: telemetry::Options,
}

#[tokio::main]
async fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let _logging = match telemetry::logs::start(arguments.telemetry.log_format, "coordinator") {
        Ok(logging) => logging,
        Err(error) => {
            eprintln!("coordinator: {error}");
            return ExitCode::FAILURE;
        }
    };
    coordinator::open_files::raise();
    match run(arguments).await {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("coordinator: {error}");
            ExitCode::FAILURE
        }
    }
}

async fn run(arguments: Arguments) -> Result<(), Error> {
    let Arguments { listen, store, lease_seconds, insecure_bind, telemetry } = arguments;
    // What is no duration is out of range, too.
    let lease = Duration::try_from_secs_f64(lease_seconds).unwrap_or_default();
    let signals = |kind| signal(kind).map_err(|e| Error::Server(format!("signals can't be received: {e}")));
    let (mut interrupt, mut terminate) = (signals(SignalKind::interrupt())?, signals(SignalKind::terminate())?);
    let mut running =
        coordinator::serve(Config { listen, store, lease, insecure_bind, metrics: telemetry.bind() }).await?;
    // Whoever started it may not be reading.
    let _ = writeln!(std::io::stdout(), "listening on {}", running.local_addr());
    if let Some(addr) = running.metrics_addr() {
        let _ = writeln!(std::io::stdout(), "metrics at http://{addr}/metrics");
    }
    tokio::select! {
        error = running.failed() => return Err(error),
        _ = interrupt.recv() => {}
        _ = terminate.recv() => {}
    }
    tracing::info!("stopping");
    running.shutdown().await
}
