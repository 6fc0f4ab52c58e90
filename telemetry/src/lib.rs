//! Telemetry of coordinator and worker: messages (`logs`), numbers for Prometheus (`endpoint`), a span a call
//! (`calls`), sent to a collector if one is set (`otlp`). The content is up to the programs.

mod address;
pub mod calls;
pub mod endpoint;
pub mod logs;
#[cfg(feature = "otlp")]
pub mod otlp;
pub mod variables;

pub use address::address;
pub use endpoint::{Bind, BindError, Endpoint, Vitals};
pub use logs::LogFormat;

use std::net::SocketAddr;

/// The options that both programs have.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Options {
    /// Format of messages on standard error: a line for people, or a JSON object a line
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,

    /// Serve /metrics, for Prometheus, and /healthz at this address; port 0 takes any free port [default: not served]
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = address)]
    pub metrics: Option<SocketAddr>,

    /// Serve metrics beyond loopback, too: every machine that can reach the port can read them
    #[arg(long, requires = "metrics")]
    pub metrics_insecure_bind: bool,
}

impl Options {
    /// Returns the address of the metrics pages, if they are wanted.
    pub fn bind(&self) -> Option<Bind> {
        self.metrics.map(|addr| Bind { addr, beyond_loopback: self.metrics_insecure_bind })
    }
}
