//! Names of environment variables.

/// Environment variable with the address of a collector of spans.
pub const OTLP_ENDPOINT: &str = "OTEL_EXPORTER_OTLP_ENDPOINT";
