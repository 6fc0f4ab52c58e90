//! Export of spans to an OpenTelemetry collector over gRPC. It needs a build with the feature `otlp`, and the
//! collector's address in the environment variable `OTEL_EXPORTER_OTLP_ENDPOINT`, such as `http://127.0.0.1:4317`.

use crate::variables::OTLP_ENDPOINT;
use opentelemetry::trace::TracerProvider as _;
use opentelemetry_otlp::{SpanExporter, WithExportConfig as _};
use opentelemetry_sdk::Resource;
use opentelemetry_sdk::trace::SdkTracerProvider;
use tracing_subscriber::Layer;
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::registry::LookupSpan;

/// Exporter of spans. When it is dropped, it sends the spans that remain.
#[derive(Debug)]
pub struct Exporting(SdkTracerProvider);

impl Drop for Exporting {
    fn drop(&mut self) {
        // An unreachable collector must not delay the end of the program.
        let _ = self.0.shutdown();
    }
}

/// Returns a layer that sends spans to the collector at `endpoint`: those of calls, with the messages of level info and
/// above inside them. `program`: name of this program. Call this inside a tokio runtime.
///
/// # Errors
/// A message, if the address can't be used.
pub fn layer<S>(endpoint: &str, program: &'static str) -> Result<(impl Layer<S> + Send + Sync, Exporting), String>
where
    S: tracing::Subscriber + for<'span> LookupSpan<'span> + Send + Sync,
{
    let exporter = SpanExporter::builder().with_tonic().with_endpoint(endpoint).build();
    let exporter = exporter.map_err(|e| format!("{OTLP_ENDPOINT} = {endpoint} can't be used: {e}"))?;
    let resource = Resource::builder().with_service_name(format!("evogait-{program}")).build();
    let provider = SdkTracerProvider::builder().with_batch_exporter(exporter).with_resource(resource).build();
    let tracer = provider.tracer("evogait");
    // Only our own crates: otherwise the exporter's own calls would be exported, and the calls for these again.
    let ours = ["coordinator", "worker"].map(|name| (name, LevelFilter::INFO));
    let filter = Targets::new().with_targets(ours).with_target("telemetry", LevelFilter::DEBUG);
    Ok((tracing_opentelemetry::layer().with_tracer(tracer).with_filter(filter), Exporting(provider)))
}
