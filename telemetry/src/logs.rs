//! Messages on standard error, and spans for collectors.

use crate::variables::OTLP_ENDPOINT;
use std::io::IsTerminal as _;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::prelude::*;
use tracing_subscriber::{Layer, Registry};

/// Format of messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum LogFormat {
    /// Plain text.
    #[default]
    Text,
    /// A JSON object per line: timestamp, level, target, fields, spans.
    Json,
}

/// Guard of the logging. Drop it at the very end of the program.
#[derive(Debug, Default)]
pub struct Logging {
    #[cfg(feature = "otlp")]
    _exporting: Option<crate::otlp::Exporting>,
}

/// Starts logging for the whole process. `RUST_LOG` sets the levels; without it all messages from level info on are
/// logged. Call this once per process, inside a tokio runtime. `program`: name of the program, for the collector.
///
/// # Errors
/// A message, if the collector's address can't be used.
pub fn start(format: LogFormat, program: &'static str) -> Result<Logging, String> {
    let asked = std::env::var("RUST_LOG").ok().and_then(|text| text.parse().ok());
    let filter: Targets = asked.unwrap_or_else(|| Targets::new().with_default(LevelFilter::INFO));
    let lines = tracing_subscriber::fmt::layer().with_writer(std::io::stderr);
    let lines: Box<dyn Layer<Registry> + Send + Sync> = match format {
        LogFormat::Text => lines.with_ansi(std::io::stderr().is_terminal()).with_filter(filter).boxed(),
        LogFormat::Json => lines.json().flatten_event(true).with_filter(filter).boxed(),
    };
    let endpoint = std::env::var(OTLP_ENDPOINT).ok().filter(|endpoint| !endpoint.is_empty());
    with_export(lines, endpoint, program)
}

#[cfg(feature = "otlp")]
fn with_export(
    lines: Box<dyn Layer<Registry> + Send + Sync>,
    endpoint: Option<String>,
    program: &'static str,
) -> Result<Logging, String> {
    let Some(endpoint) = endpoint else {
        tracing_subscriber::registry().with(lines).init();
        return Ok(Logging::default());
    };
    let (spans, exporting) = crate::otlp::layer(&endpoint, program)?;
    tracing_subscriber::registry().with(vec![lines, spans.boxed()]).init();
    Ok(Logging { _exporting: Some(exporting) })
}

#[cfg(not(feature = "otlp"))]
fn with_export(
    lines: Box<dyn Layer<Registry> + Send + Sync>,
    endpoint: Option<String>,
    _program: &'static str,
) -> Result<Logging, String> {
    tracing_subscriber::registry().with(lines).init();
    if endpoint.is_some() {
        tracing::warn!("{OTLP_ENDPOINT} is set, but this build exports no spans: build it with --features otlp");
    }
    Ok(Logging::default())
}
