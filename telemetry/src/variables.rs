//! Variables of the environment.

/// What the environment calls the address of a collector of spans.
pub const OTLP_ENDPOINT: &str = "OTEL_EXPORTER_OTLP_ENDPOINT";
