//! Binary of the worker.

mod time_left;

use clap::Parser;
use proto::credentials::{Credentials, Sources};
use proto::limits::MAX_SLOTS;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;
use worker::{Config, Error, Hangup};

/// Computes tasks for a coordinator.
///
/// A worker stores nothing: start as many as you need, and stop or kill them at any time. It waits for its coordinator,
/// continues to compute while the connection is down, and delivers its results after reconnecting.
#[derive(Parser)]
#[command(
    name = "worker",
    version,
    after_help = "Examples:
  worker --coordinator http://127.0.0.1:7077 --slots 4
  worker --coordinator https://a.example:7077,https://b.example:7077 --ca ca.pem --token-file worker.token

SIGINT, SIGTERM and SIGHUP (unless under nohup) drain the worker: it accepts no new tasks, finishes what it can within
the grace time, returns the remaining leases, and ends with exit code 0. A returned lease costs its tasks no attempt.
A second signal ends the grace time. In a Slurm job, --time-left drains the worker before the job's time is up;
deploy/slurm has an example.

A task that panics or gets stuck costs one of its attempts; the worker continues. Log messages go to standard error
(RUST_LOG=debug for more)."
)]
struct Arguments {
    /// URL of the coordinator; separate the URLs of a coordinator and its standbys by commas [default:
    /// $EVOGAIT_COORDINATOR, else http://127.0.0.1:7077]
    #[arg(long, value_name = "URL")]
    coordinator: Option<String>,

    /// Certificate of the CA that signed the coordinator's certificate, PEM; for https:// [default: $EVOGAIT_CA]
    #[arg(long, value_name = "FILE")]
    ca: Option<PathBuf>,

    /// Client certificate of the worker, PEM [default: $EVOGAIT_CERT]
    #[arg(long, value_name = "FILE")]
    cert: Option<PathBuf>,

    /// Private key of the client certificate, PEM [default: $EVOGAIT_KEY]
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,

    /// File with a token of role worker [default: $EVOGAIT_TOKEN_FILE; else $EVOGAIT_TOKEN holds the token itself]
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,

    /// Number of assignments computed at the same time, 1 to 4096 [default: number of cores]
    #[arg(long, value_name = "N", value_parser = slots)]
    slots: Option<usize>,

    /// Name of the worker in `evogait workers` [default: HOST:PID]
    #[arg(long)]
    name: Option<String>,

    #[command(flatten)]
    telemetry: telemetry::Options,

    /// Time to finish running tasks after a request to stop
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = time_left::seconds,
        default_value = "10")]
    grace: Duration,

    /// Wall time left to this process: it drains before the end. Seconds, or Slurm's format
    /// ([DAYS-]HOURS:MINUTES:SECONDS)
    #[arg(long, value_name = "TIME", allow_negative_numbers = true, value_parser = time_left::slurm)]
    time_left: Option<Duration>,

    /// Time without a finished batch of rollouts after which a slot is stuck: its tasks count as failed, and a new
    /// thread replaces it
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = time_left::seconds,
        default_value = "600")]
    stuck_after: Duration,

    /// Time between checks of an idle connection, and time limit for the coordinator's answer
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = time_left::seconds,
        default_value = "10")]
    keepalive: Duration,
}

fn slots(text: &str) -> Result<usize, String> {
    text.parse().map_err(|_| format!("must be a whole number from 1 to {MAX_SLOTS}"))
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
    let mut hangup = Hangup::listen().map_err(|e| Error::System(format!("signals can't be received: {e}")))?;
    let (told, times) = watch::channel(0);
    tokio::spawn(async move {
        loop {
            tokio::select! {
                _ = interrupt.recv() => {}
                _ = terminate.recv() => {}
                () = hangup.recv() => {}
            }
            told.send_modify(|times| *times += 1);
        }
    });
    let after = |least: u32| {
        let mut times = times.clone();
        async move {
            // The sender lives in the task above, which never ends.
            let _ = times.wait_for(|times| *times >= least).await;
        }
    };
    let Arguments { coordinator, ca, cert, key, token_file, .. } = arguments;
    let named = || std::env::var("EVOGAIT_COORDINATOR").ok().filter(|url| !url.is_empty());
    let coordinator = coordinator.or_else(named).unwrap_or_else(|| "http://127.0.0.1:7077".to_owned());
    let config = Config {
        credentials: Credentials::of_process(Sources { ca, cert, key, token_file })?,
        name: arguments.name.unwrap_or_else(worker::default_name),
        metrics: arguments.telemetry.bind(),
        grace: arguments.grace,
        time_left: arguments.time_left,
        stuck_after: arguments.stuck_after,
        keepalive: arguments.keepalive,
        ..Config::new(coordinator, arguments.slots.unwrap_or_else(worker::default_slots))
    };
    worker::run_until(config, after(1), after(2)).await
}
