//! Test of the export of spans to a collector. `cargo test -p telemetry --features otlp`
#![cfg(feature = "otlp")]

use opentelemetry_proto::tonic::collector::trace::v1::trace_service_server::{TraceService, TraceServiceServer};
use opentelemetry_proto::tonic::collector::trace::v1::{ExportTraceServiceRequest, ExportTraceServiceResponse};
use opentelemetry_proto::tonic::common::v1::KeyValue;
use opentelemetry_proto::tonic::common::v1::any_value::Value;
use tokio::net::TcpListener;
use tokio::sync::mpsc::{UnboundedSender, unbounded_channel};
use tonic::transport::Server;
use tonic::transport::server::TcpIncoming;
use tonic::{Request, Response, Status};
use tracing_subscriber::prelude::*;

/// Collector that passes the spans it receives to the test.
struct Collector(UnboundedSender<ExportTraceServiceRequest>);

#[tonic::async_trait]
impl TraceService for Collector {
    async fn export(
        &self,
        request: Request<ExportTraceServiceRequest>,
    ) -> Result<Response<ExportTraceServiceResponse>, Status> {
        self.0.send(request.into_inner()).map_err(|_| Status::internal("the test has ended"))?;
        Ok(Response::new(ExportTraceServiceResponse::default()))
    }
}

fn text(attributes: &[KeyValue], key: &str) -> Option<String> {
    match attributes.iter().find(|a| a.key == key)?.value.as_ref()?.value.as_ref()? {
        Value::StringValue(text) => Some(text.clone()),
        _ => None,
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn only_spans_of_calls_reach_the_collector() {
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
    let endpoint = format!("http://{}", listener.local_addr().expect("an address"));
    let (collected, mut inbox) = unbounded_channel();
    let server = Server::builder().add_service(TraceServiceServer::new(Collector(collected)));
    tokio::spawn(server.serve_with_incoming(TcpIncoming::from(listener)));

    let (layer, exporting) = telemetry::otlp::layer(&endpoint, "test").expect("a good address");
    tracing::subscriber::with_default(tracing_subscriber::registry().with(layer), || {
        tracing::debug_span!(target: "telemetry::calls", "rpc", method = "/evogait.v1.JobService/GetJob")
            .in_scope(|| ());
        tracing::debug_span!(target: "h2::codec", "frame").in_scope(|| ());
    });
    tokio::task::spawn_blocking(move || drop(exporting)).await.expect("the remaining spans must be sent");

    let batch = inbox.recv().await.expect("a batch").resource_spans.remove(0);
    let resource = batch.resource.expect("a resource").attributes;
    assert_eq!(text(&resource, "service.name").as_deref(), Some("evogait-test"));
    let spans: Vec<_> = batch.scope_spans.into_iter().flat_map(|s| s.spans).collect();
    assert_eq!(spans.iter().map(|s| s.name.as_str()).collect::<Vec<_>>(), ["rpc"]);
    assert_eq!(text(&spans[0].attributes, "method").as_deref(), Some("/evogait.v1.JobService/GetJob"));
    assert!(inbox.try_recv().is_err());
}

#[tokio::test]
async fn malformed_address_is_refused() {
    let refused = telemetry::otlp::layer::<tracing_subscriber::Registry>("not a url", "test").err();
    assert!(refused.is_some_and(|why| why.starts_with("OTEL_EXPORTER_OTLP_ENDPOINT = not a url can't be used")));
}
