//! Options of the commands that talk to a coordinator, or make the certificates for that.

use super::JobFile;
use super::number::whole;
use crate::certs::Host;
use clap::{Args, Subcommand};
use std::net::SocketAddr;
use std::path::PathBuf;

/// What is shown to a coordinator, and whom it may be.
#[derive(Clone, Debug, Args)]
pub struct Shown {
    /// Certificate of the CA that signed the coordinator's, PEM; for https:// [default: $EVOGAIT_CA]
    #[arg(long, value_name = "FILE", display_order = 90)]
    pub ca: Option<PathBuf>,

    /// Certificate to show to the coordinator, PEM [default: $EVOGAIT_CERT]
    #[arg(long, value_name = "FILE", display_order = 91)]
    pub cert: Option<PathBuf>,

    /// Its private key, PEM [default: $EVOGAIT_KEY]
    #[arg(long, value_name = "FILE", display_order = 92)]
    pub key: Option<PathBuf>,

    /// File with the token to send [default: $EVOGAIT_TOKEN_FILE; else the token itself is $EVOGAIT_TOKEN]
    #[arg(long, value_name = "FILE", display_order = 93)]
    pub token_file: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct OnCoordinator {
    /// Address of the coordinator; several that stand in for each other are separated by commas [default:
    /// $EVOGAIT_COORDINATOR, else http://127.0.0.1:7077]
    #[arg(long, value_name = "URL")]
    pub coordinator: Option<String>,

    #[command(flatten)]
    pub shown: Shown,

    /// Print JSON
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct Health {
    /// Be content with one that answers, whether it serves or stands by
    #[arg(long)]
    pub alive: bool,

    /// Ask a worker or a coordinator on this machine instead, at the address of its --metrics
    #[arg(long, value_name = "ADDRESS:PORT", conflicts_with_all = ["alive", "coordinator"],
        value_parser = telemetry::address)]
    pub process: Option<SocketAddr>,

    #[command(flatten)]
    pub on: OnCoordinator,
}

#[derive(Debug, Args)]
pub struct OneJob {
    /// The job's id, as `evogait submit` and `evogait list` print it
    pub id: String,

    #[command(flatten)]
    pub on: OnCoordinator,
}

#[derive(Debug, Args)]
pub struct Submit {
    #[command(flatten)]
    pub file: JobFile,

    /// Share of the workers relative to other jobs, 1 to 100 [default: 10]
    #[arg(long, value_name = "P", value_parser = whole(1..=100))]
    pub priority: Option<u32>,

    /// Start anew even if the coordinator knows this job, as after a cancel
    #[arg(long)]
    pub again: bool,

    #[command(flatten)]
    pub on: OnCoordinator,
}

/// Where a job stands, as `--state` takes it.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
#[allow(missing_docs)]
pub enum State {
    Queued,
    Running,
    Waiting,
    Succeeded,
    Failed,
    Cancelled,
    Tainted,
}

#[derive(Debug, Args)]
pub struct List {
    /// Only jobs in this state; may be given several times
    #[arg(long, value_name = "STATE")]
    pub state: Vec<State>,

    /// At most so many [default: all]
    #[arg(long, value_name = "N", value_parser = whole(1..=u32::MAX))]
    pub limit: Option<u32>,

    #[command(flatten)]
    pub on: OnCoordinator,
}

#[derive(Debug, Args)]
pub struct Show {
    /// Print the resolved job file instead
    #[arg(long, conflicts_with = "json")]
    pub toml: bool,

    #[command(flatten)]
    pub job: OneJob,
}

#[derive(Debug, Args)]
pub struct Restart {
    /// The first generation to be done again [default: where the job was tainted]
    #[arg(long, value_name = "G", value_parser = whole(0..=u32::MAX))]
    pub from_generation: Option<u32>,

    /// Start anew even if the job was restarted from there before
    #[arg(long)]
    pub again: bool,

    #[command(flatten)]
    pub job: OneJob,
}

#[derive(Debug, Args)]
pub struct Fetch {
    /// The job's id, as `evogait submit` and `evogait list` print it
    pub id: String,

    /// Output folder [default: runs/NAME-DIGEST, with the first 12 digits of the job digest]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    #[command(flatten)]
    pub on: OnCoordinator,
}

#[derive(Debug, Args)]
pub struct Certs {
    #[command(subcommand)]
    pub action: CertsAction,
}

#[derive(Debug, Subcommand)]
pub enum CertsAction {
    /// Make a CA, certificates for coordinator, workers and clients, and tokens
    #[command(after_help = "\
Example:
  evogait certs init certs --host node1.example --host 10.0.0.1
Nothing that is there is replaced. Keys and tokens can be read by you alone.")]
    Init(CertsFolder),
    /// Replace the certificates by new ones of the same CA; CA and tokens stay
    #[command(after_help = "\
Example:
  evogait certs renew certs --host node1.example --host 10.0.0.1")]
    Renew(CertsFolder),
}

#[derive(Debug, Args)]
pub struct CertsFolder {
    /// Folder of the certificates
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,

    /// Name or IP address under which a coordinator is dialed, beside this machine's own; may be given several times
    #[arg(long = "host", value_name = "NAME|IP")]
    pub hosts: Vec<Host>,

    /// Days that the certificates are valid
    #[arg(long, value_name = "DAYS", default_value_t = 365, value_parser = whole(1..=3650))]
    pub days: u32,
}
