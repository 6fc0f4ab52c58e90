//! The coordinator's binary.

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

For other machines, with what `evogait certs init certs --host HOST` makes:
  coordinator --listen 0.0.0.0:7077 --store sqlite:evogait.db --tls-cert certs/coordinator.pem \\
    --tls-key certs/coordinator.key --client-ca certs/ca.pem --tokens certs/tokens

The first line on standard output says where it listens, a second one where metrics are served; messages go to standard error (RUST_LOG=debug for more).
SIGINT and SIGTERM stop it cleanly; SIGHUP makes it read its tokens again. Exit codes: 0 stopped, 1 failed, 3 another
coordinator has taken over."
)]
struct Arguments {
    /// Where to listen: an address or a host name, such as localhost:7077. Port 0 takes any free port
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:7077", value_parser = telemetry::address)]
    listen: SocketAddr,

    /// Where jobs are kept: sqlite:PATH, a file that is made if it is not there, or postgres://USER@HOST:PORT/DATABASE, with
    /// the password in PGPASSWORD or ~/.pgpass. For tests, memory: keeps jobs until the coordinator ends
    // Parsed later: a refusal here would repeat the whole text, and with it a password.
    #[arg(long, value_name = "URL", default_value = "sqlite:evogait.db", value_parser = store_url)]
    store: Result<StoreUrl, BadStoreUrl>,

    /// Wait while another coordinator is at work on the same PostgreSQL store, and take over when that one ends
    #[arg(long)]
    standby: bool,

    /// Out of touch with a PostgreSQL store for this long, this coordinator stops and another one may take over
    #[arg(long, value_name = "SECONDS", value_parser = seconds, default_value = "5")]
    takeover_seconds: Duration,

    /// Without a sign of life for this long, a worker's work goes to others
    #[arg(long, value_name = "SECONDS", value_parser = seconds, default_value = "15")]
    lease_seconds: Duration,

    /// Certificate to encrypt connections with, PEM [default: $EVOGAIT_TLS_CERT]
    #[arg(long, value_name = "FILE")]
    tls_cert: Option<PathBuf>,

    /// Its private key, PEM [default: $EVOGAIT_TLS_KEY]
    #[arg(long, value_name = "FILE")]
    tls_key: Option<PathBuf>,

    /// Whoever connects has to show a certificate signed by this CA, PEM [default: $EVOGAIT_CLIENT_CA]
    #[arg(long, value_name = "FILE")]
    client_ca: Option<PathBuf>,

    /// Callers have to send one of these tokens: a role (client, worker, admin) and a token a line [default:
    /// $EVOGAIT_TOKENS]
    #[arg(long, value_name = "FILE")]
    tokens: Option<PathBuf>,

    /// Listen beyond loopback without encryption or without tokens: everybody who can reach the port can run jobs
    #[arg(long)]
    insecure_bind: bool,

    /// Tell KEDA at this address how many slots the jobs could use; port 0 takes any free port [default: not told]
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = telemetry::address)]
    keda: Option<SocketAddr>,

    /// Tell KEDA beyond loopback, too: everybody who can reach the port can read it
    #[arg(long, requires = "keda")]
    keda_insecure_bind: bool,

    #[command(flatten)]
    telemetry: telemetry::Options,
}

fn store_url(text: &str) -> Result<Result<StoreUrl, BadStoreUrl>, Infallible> {
    Ok(text.parse())
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().map_err(|_| "it is no number of seconds".to_owned())?;
    // What is no duration is out of range, too.
    Ok(Duration::try_from_secs_f64(seconds).unwrap_or_default())
}

/// The exit code when another coordinator has taken the store over.
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

/// A file that an argument or else the environment names.
fn file(given: Option<PathBuf>, variable: &str) -> Option<PathBuf> {
    given.or_else(|| std::env::var_os(variable).filter(|value| !value.is_empty()).map(PathBuf::from))
}

fn tls(cert: Option<PathBuf>, key: Option<PathBuf>, clients: Option<PathBuf>) -> Result<Option<Tls>, Failure> {
    let (cert, key) = (file(cert, "EVOGAIT_TLS_CERT"), file(key, "EVOGAIT_TLS_KEY"));
    let clients = file(clients, "EVOGAIT_CLIENT_CA").as_deref().map(authority).transpose()?;
    let identity = match (cert, key) {
        (Some(cert), Some(key)) => identity(&cert, &key)?,
        (None, None) if clients.is_none() => return Ok(None),
        _ => return Err("--tls-cert FILE and --tls-key FILE go together, and --client-ca FILE with both".into()),
    };
    tracing::info!(until = identity.valid_until, "connections are encrypted; this is the certificate's last day");
    Ok(Some(Tls { identity, clients }))
}

/// Why it does not start or go on, in a sentence.
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
    let signals = |kind| signal(kind).map_err(|e| Error::Server(format!("signals can't be received: {e}")));
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
    // Whoever started it may not be reading.
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
                Some(Ok(count)) => tracing::info!(count, "the tokens were read again"),
                Some(Err(error)) => tracing::error!(%error, "the tokens stay as they were"),
                None => tracing::warn!("SIGHUP: there are no tokens to read again"),
            },
        }
    }
    tracing::info!("stopping");
    Ok(running.shutdown().await?)
}
