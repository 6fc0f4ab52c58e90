//! Options of the commands that connect to a coordinator, and of `evogait certs`.

use super::JobFile;
use super::number::whole;
use crate::certs::Host;
use clap::{Args, Subcommand};
use std::net::SocketAddr;
use std::path::PathBuf;

/// Credentials for a coordinator, and the CA that its certificate must be signed by.
#[derive(Clone, Debug, Args)]
pub struct Shown {
    /// CA certificate that the coordinator's certificate must be signed by, PEM; for https:// [default: $EVOGAIT_CA]
    #[arg(long, value_name = "FILE", display_order = 90)]
    pub ca: Option<PathBuf>,

    /// Certificate of this client, PEM [default: $EVOGAIT_CERT]
    #[arg(long, value_name = "FILE", display_order = 91)]
    pub cert: Option<PathBuf>,

    /// Private key of this client's certificate, PEM [default: $EVOGAIT_KEY]
    #[arg(long, value_name = "FILE", display_order = 92)]
    pub key: Option<PathBuf>,

    /// File with the token to send [default: $EVOGAIT_TOKEN_FILE; else $EVOGAIT_TOKEN contains the token itself]
    #[arg(long, value_name = "FILE", display_order = 93)]
    pub token_file: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct OnCoordinator {
    /// Address of the coordinator; addresses of standbys follow after commas
    /// [default: $EVOGAIT_COORDINATOR, else http://127.0.0.1:7077]
    #[arg(long, value_name = "URL")]
    pub coordinator: Option<String>,

    #[command(flatten)]
    pub shown: Shown,

    /// Print JSON instead of text
    #[arg(long, display_order = 99)]
    pub json: bool,
}

#[derive(Debug, Args)]
pub struct Health {
    /// Accept a coordinator that stands by: exit code 0 if it answers
    #[arg(long)]
    pub alive: bool,

    /// Check a worker or a coordinator on this machine instead, at the address of its --metrics
    #[arg(long, value_name = "ADDRESS:PORT", conflicts_with_all = ["alive", "coordinator"],
        value_parser = telemetry::address)]
    pub process: Option<SocketAddr>,

    #[command(flatten)]
    pub on: OnCoordinator,
}

#[derive(Debug, Args)]
pub struct OneJob {
    /// Id of the job, from `evogait submit` or `evogait list`
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

    /// Start the job again even if the coordinator already has it, for instance after a cancel
    #[arg(long)]
    pub again: bool,

    #[command(flatten)]
    pub on: OnCoordinator,
}

/// Values of `--state`.
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
    /// List only jobs in this state; may be given several times
    #[arg(long, value_name = "STATE")]
    pub state: Vec<State>,

    /// Maximum number of jobs [default: all]
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
    /// First generation to repeat [default: the generation where the job was tainted]
    #[arg(long, value_name = "G", value_parser = whole(0..=u32::MAX))]
    pub from_generation: Option<u32>,

    /// Start another job even if this one was already restarted from there
    #[arg(long)]
    pub again: bool,

    #[command(flatten)]
    pub job: OneJob,
}

#[derive(Debug, Args)]
pub struct Fetch {
    /// Id of the job, from `evogait submit` or `evogait list`
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

Existing files are never replaced. Only their owner can read keys and tokens.")]
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

    /// Host name or IP address of the coordinator, beside those of this machine; may be given several times
    #[arg(long = "host", value_name = "NAME|IP")]
    pub hosts: Vec<Host>,

    /// Days that the certificates are valid
    #[arg(long, value_name = "DAYS", default_value_t = 365, value_parser = whole(1..=3650))]
    pub days: u32,
}
