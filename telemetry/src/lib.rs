//! Telemetry of coordinator and worker: messages (`logs`), metrics for Prometheus (`endpoint`), and a span per call
//! (`calls`), which is sent to a collector if one is set (`otlp`). The programs define the content.

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

/// Command-line options of both programs.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Options {
    /// Format of messages on standard error: plain text, or a JSON object per line
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,

    /// Serve /metrics, for Prometheus, and /healthz at this address; port 0 takes any free port [default: not served]
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = address)]
    pub metrics: Option<SocketAddr>,

    /// Allow a --metrics address beyond loopback: every machine that can reach the port can read the metrics
    #[arg(long, requires = "metrics")]
    pub metrics_insecure_bind: bool,
}

impl Options {
    /// Returns the address of the metrics pages, or `None` if they are not served.
    pub fn bind(&self) -> Option<Bind> {
        self.metrics.map(|addr| Bind { addr, beyond_loopback: self.metrics_insecure_bind })
    }
}
