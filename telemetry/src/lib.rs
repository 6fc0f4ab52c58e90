//! What coordinator and worker tell those who run them: messages (`logs`), numbers for Prometheus (`endpoint`), a span
//! a call (`calls`), sent to a collector where that is asked for (`otlp`). What is told, the programs decide; here is how.

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
    /// How messages on standard error look: a line for people, or a JSON object a line
    #[arg(long, value_enum, value_name = "FORMAT", default_value_t)]
    pub log_format: LogFormat,

    /// Serve /metrics, for Prometheus, and /healthz at this address; port 0 takes any free port [default: not served]
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = address)]
    pub metrics: Option<SocketAddr>,

    /// Serve metrics beyond loopback, too: everybody who can reach the port can read them
    #[arg(long, requires = "metrics")]
    pub metrics_insecure_bind: bool,
}

impl Options {
    /// Where metrics are to be served, if at all.
    pub fn bind(&self) -> Option<Bind> {
        self.metrics.map(|addr| Bind { addr, beyond_loopback: self.metrics_insecure_bind })
    }
}
