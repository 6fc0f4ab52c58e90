//! The worker's binary.

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

/// Carries out tasks for a coordinator.
///
/// A worker holds nothing that matters: start as many as there are machines, stop or kill them at any time. It waits for
/// its coordinator, keeps computing while the connection is down, and delivers when it is back.
#[derive(Parser)]
#[command(
    name = "worker",
    version,
    after_help = "Examples:
  worker --coordinator http://127.0.0.1:7077 --slots 4
  worker --coordinator https://a.example:7077,https://b.example:7077 --ca ca.pem --token-file worker.token

SIGINT, SIGTERM and SIGHUP (unless under nohup) drain it: it takes nothing new, finishes what it can within the grace time, gives back the rest, which
costs nothing, and ends with exit code 0. A second one cuts the grace time short. In a Slurm job it drains before its
time is up with --time-left; deploy/slurm has such a job.

A candidate that panics or gets stuck has failed an attempt; the worker goes on. Messages go to standard error
(RUST_LOG=debug for more)."
)]
struct Arguments {
    /// The coordinator to work for; several that stand in for each other are separated by commas [default:
    /// $EVOGAIT_COORDINATOR, else http://127.0.0.1:7077]
    #[arg(long, value_name = "URL")]
    coordinator: Option<String>,

    /// Certificate of the CA that signed the coordinator's, PEM; for https:// [default: $EVOGAIT_CA]
    #[arg(long, value_name = "FILE")]
    ca: Option<PathBuf>,

    /// Certificate to show to the coordinator, PEM [default: $EVOGAIT_CERT]
    #[arg(long, value_name = "FILE")]
    cert: Option<PathBuf>,

    /// Its private key, PEM [default: $EVOGAIT_KEY]
    #[arg(long, value_name = "FILE")]
    key: Option<PathBuf>,

    /// File with a worker's token [default: $EVOGAIT_TOKEN_FILE; else the token itself is $EVOGAIT_TOKEN]
    #[arg(long, value_name = "FILE")]
    token_file: Option<PathBuf>,

    /// Assignments at once [default: one a core]
    #[arg(long, value_name = "N", value_parser = slots)]
    slots: Option<usize>,

    /// Name of the worker in `evogait workers` [default: host and process]
    #[arg(long)]
    name: Option<String>,

    #[command(flatten)]
    telemetry: telemetry::Options,

    /// When told to stop, time to finish what runs
    #[arg(long, value_name = "SECONDS", value_parser = time_left::seconds, default_value = "10")]
    grace: Duration,

    /// Wall time that is left to this process: it drains by itself before that. Seconds, or as Slurm prints them
    /// ([DAYS-]HOURS:MINUTES:SECONDS)
    #[arg(long, value_name = "TIME", value_parser = time_left::slurm)]
    time_left: Option<Duration>,

    /// A slot that ends no batch of rollouts for this long is stuck: its work counts as failed, and a fresh one takes its
    /// place
    #[arg(long, value_name = "SECONDS", value_parser = time_left::seconds, default_value = "600")]
    stuck_after: Duration,

    /// Seconds between checks of an idle connection, and for the coordinator's answer
    #[arg(long, value_name = "SECONDS", value_parser = time_left::seconds, default_value = "10")]
    keepalive: Duration,
}

fn slots(text: &str) -> Result<usize, String> {
    text.parse().map_err(|_| format!("whole numbers from 1 to {MAX_SLOTS} are allowed"))
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
            // The task above never ends.
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
