//! Binary of the coordinator.

use clap::Parser;
use coordinator::{Access, BadStoreUrl, Config, Error, StoreError, StoreUrl, Tls};
use proto::credentials::{authority, identity};
use std::convert::Infallible;
use std::io::Write as _;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;
use tokio::signal::unix::{SignalKind, signal};

/// Runs jobs: leases their tasks to workers and stores all results
///
/// All state is in the store. A coordinator that stops or crashes continues where it was after a restart on the same
/// store. Workers wait for it meanwhile and lose no work.
#[derive(Parser)]
#[command(
    name = "coordinator",
    version,
    after_help = "Example on one machine:
  coordinator --store sqlite:evogait.db
  worker --coordinator http://127.0.0.1:7077
  evogait submit JOB.toml --coordinator http://127.0.0.1:7077

For several machines, with the files of `evogait certs init certs --host HOST`:
  coordinator --listen 0.0.0.0:7077 --store sqlite:evogait.db --tls-cert certs/coordinator.pem \\
    --tls-key certs/coordinator.key --client-ca certs/ca.pem --tokens certs/tokens

The first line on standard output is the address for clients and workers, the second the address of the metrics. Messages go to standard error (RUST_LOG=debug for more).
SIGINT and SIGTERM stop the coordinator cleanly; SIGHUP reloads its tokens. Exit codes: 0 stopped, 1 failed,
2 wrong usage, 3 another coordinator has taken over."
)]
struct Arguments {
    /// Address to listen on: an IP address or a host name, such as localhost:7077. Port 0 selects a free port
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:7077", value_parser = telemetry::address)]
    listen: SocketAddr,

    /// Store of the jobs: sqlite:PATH, a file that is created if it does not exist, or
    /// postgres://USER@HOST:PORT/DATABASE with the password in PGPASSWORD or ~/.pgpass. For tests, memory: keeps jobs
    /// until the coordinator exits
    // The result is checked later: clap's error message would repeat the text, and with it a password.
    #[arg(long, value_name = "URL", default_value = "sqlite:evogait.db", value_parser = store_url)]
    store: Result<StoreUrl, BadStoreUrl>,

    /// Wait while another coordinator is active on the same PostgreSQL store, and take over when that one ends
    #[arg(long)]
    standby: bool,

    /// If this coordinator can't reach a PostgreSQL store for this long, it stops and another one may take over
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = seconds, default_value = "5")]
    takeover_seconds: Duration,

    /// If a worker sends nothing for this long, its tasks go to other workers
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = seconds, default_value = "15")]
    lease_seconds: Duration,

    /// Certificate for encrypted connections, PEM [default: $EVOGAIT_TLS_CERT]
    #[arg(long, value_name = "FILE")]
    tls_cert: Option<PathBuf>,

    /// Private key of the certificate, PEM [default: $EVOGAIT_TLS_KEY]
    #[arg(long, value_name = "FILE")]
    tls_key: Option<PathBuf>,

    /// Require clients and workers to present a certificate signed by this CA, PEM [default: $EVOGAIT_CLIENT_CA]
    #[arg(long, value_name = "FILE")]
    client_ca: Option<PathBuf>,

    /// Require callers to send a token from this file, which has one role (client, worker, admin) and one token per
    /// line [default: $EVOGAIT_TOKENS]
    #[arg(long, value_name = "FILE")]
    tokens: Option<PathBuf>,

    /// Allow listening beyond loopback without encryption or without tokens: any machine that can reach the port can
    /// run jobs
    #[arg(long)]
    insecure_bind: bool,

    /// Address at which KEDA can read the number of slots that the jobs could use; port 0 selects a free port [default:
    /// not served]
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = telemetry::address)]
    keda: Option<SocketAddr>,

    /// Allow --keda beyond loopback: any machine that can reach the port can read the number
    #[arg(long, requires = "keda")]
    keda_insecure_bind: bool,

    #[command(flatten)]
    telemetry: telemetry::Options,
}

fn store_url(text: &str) -> Result<Result<StoreUrl, BadStoreUrl>, Infallible> {
    Ok(text.parse())
}

fn seconds(text: &str) -> Result<Duration, String> {
    let wrong = || "it must be a number of seconds that is not negative, such as 15 or 0.5".to_owned();
    let seconds = text.parse().map_err(|_| wrong())?;
    // Fails for numbers that are negative, not finite, or beyond the range of a duration.
    Duration::try_from_secs_f64(seconds).map_err(|_| wrong())
}

/// Exit code if another coordinator has taken over the store.
const TAKEN_OVER: u8 = 3;

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
            if is_taken_over(&error) { ExitCode::from(TAKEN_OVER) } else { ExitCode::FAILURE }
        }
    }
}

/// Returns the path from an argument, or else from the environment.
fn file(given: Option<PathBuf>, variable: &str) -> Option<PathBuf> {
    given.or_else(|| std::env::var_os(variable).filter(|value| !value.is_empty()).map(PathBuf::from))
}

fn tls(cert: Option<PathBuf>, key: Option<PathBuf>, clients: Option<PathBuf>) -> Result<Option<Tls>, Failure> {
    let (cert, key) = (file(cert, "EVOGAIT_TLS_CERT"), file(key, "EVOGAIT_TLS_KEY"));
    let clients = file(clients, "EVOGAIT_CLIENT_CA").as_deref().map(authority).transpose()?;
    let identity = match (cert, key) {
        (Some(cert), Some(key)) => identity(&cert, &key)?,
        (None, None) if clients.is_none() => return Ok(None),
        _ => return Err("--tls-cert and --tls-key must be given together; --client-ca requires both".into()),
    };
    tracing::info!(until = identity.valid_until, "connections are encrypted; the certificate is valid until this day");
    Ok(Some(Tls { identity, clients }))
}

/// Error that prevents the start or ends the coordinator.
type Failure = Box<dyn std::error::Error>;

fn is_taken_over(error: &Failure) -> bool {
    matches!(error.downcast_ref(), Some(Error::Store(StoreError::Superseded { .. })))
}

async fn run(arguments: Arguments) -> Result<(), Failure> {
    let Arguments {
        listen,
        store,
        standby,
        takeover_seconds,
        lease_seconds,
        tls_cert,
        tls_key,
        client_ca,
        tokens,
        insecure_bind,
        keda,
        keda_insecure_bind,
        telemetry,
    } = arguments;
    let keda = keda.map(|addr| telemetry::Bind { addr, beyond_loopback: keda_insecure_bind });
    let signals = |kind| signal(kind).map_err(|e| Error::Server(format!("can't receive signals: {e}")));
    let (mut interrupt, mut terminate) = (signals(SignalKind::interrupt())?, signals(SignalKind::terminate())?);
    let mut hang_up = signals(SignalKind::hangup())?;
    let tls = tls(tls_cert, tls_key, client_ca)?;
    let access = file(tokens, "EVOGAIT_TOKENS").as_deref().map(Access::read).transpose()?.map(Arc::new);
    let mut running = coordinator::serve(Config {
        listen,
        store: store?,
        standby,
        takeover: takeover_seconds,
        lease: lease_seconds,
        tls,
        access: access.clone(),
        insecure_bind,
        metrics: telemetry.bind(),
        keda,
    })
    .await?;
    // The reading end of standard output may be closed.
    let _ = writeln!(std::io::stdout(), "listening on {}", running.local_addr());
    if let Some(addr) = running.metrics_addr() {
        let _ = writeln!(std::io::stdout(), "metrics at http://{addr}/metrics");
    }
    loop {
        tokio::select! {
            error = running.failed() => return Err(error.into()),
            _ = interrupt.recv() => break,
            _ = terminate.recv() => break,
            _ = hang_up.recv() => match access.as_deref().map(Access::reload) {
                Some(Ok(count)) => tracing::info!(count, "tokens reloaded"),
                Some(Err(error)) => tracing::error!(%error, "can't reload the tokens: they stay unchanged"),
                None => tracing::warn!("SIGHUP: there are no tokens to reload"),
            },
        }
    }
    tracing::info!("stopping");
    Ok(running.shutdown().await?)
}
