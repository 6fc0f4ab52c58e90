//! Spans around the calls of a gRPC server, at level debug: method, peer, status and duration.
//!
//! Messages and other headers are not recorded, so no token and no genotype gets into a log.

use std::time::Duration;
use tonic::Code;
use tonic::codegen::http::{HeaderMap, Request, Response};
use tonic::transport::server::TcpConnectInfo;
use tower_http::classify::{GrpcErrorsAsFailures, SharedClassifier};
use tower_http::trace::{MakeSpan, OnEos, OnResponse, TraceLayer};
use tracing::Span;
use tracing::field::{Empty, debug};

/// Layer that adds the spans to a server's services.
pub type CallLayer = TraceLayer<SharedClassifier<GrpcErrorsAsFailures>, CallSpan, (), Answered, (), Answered, ()>;

/// Returns the layer that makes the spans and records the ends of calls.
pub fn layer() -> CallLayer {
    TraceLayer::new_for_grpc()
        .make_span_with(CallSpan)
        .on_request(())
        .on_response(Answered)
        .on_body_chunk(())
        .on_eos(Answered)
        .on_failure(())
}

/// Makes the span of a call.
#[derive(Clone, Copy, Debug)]
pub struct CallSpan;

impl<B> MakeSpan<B> for CallSpan {
    fn make_span(&mut self, request: &Request<B>) -> Span {
        let span = tracing::debug_span!(
            "rpc",
            method = request.uri().path(),
            peer = Empty,
            status = Empty,
            ms = Empty,
            stream_ms = Empty
        );
        if !span.is_disabled()
            && let Some(peer) = request.extensions().get::<TcpConnectInfo>().and_then(TcpConnectInfo::remote_addr)
        {
            span.record("peer", debug(peer));
        }
        span
    }
}

/// Records the end of a call.
#[derive(Clone, Copy, Debug)]
pub struct Answered;

impl<B> OnResponse<B> for Answered {
    /// Records the duration, and the status if it is in the headers: that of an error without a message. All other
    /// calls have it in the trailers.
    fn on_response(self, response: &Response<B>, latency: Duration, span: &Span) {
        if span.is_disabled() {
            return;
        }
        span.record("ms", latency.as_secs_f64() * 1e3);
        if response.headers().contains_key("grpc-status") {
            told(response.headers(), span);
        }
    }
}

impl OnEos for Answered {
    fn on_eos(self, trailers: Option<&HeaderMap>, stream: Duration, span: &Span) {
        if let Some(trailers) = trailers.filter(|_| !span.is_disabled()) {
            // Time since the answer began: of a stream, nearly its whole duration.
            span.record("stream_ms", stream.as_secs_f64() * 1e3);
            told(trailers, span);
        }
    }
}

fn told(headers: &HeaderMap, span: &Span) {
    let code = headers.get("grpc-status").map_or(Code::Unknown, |value| Code::from_bytes(value.as_bytes()));
    span.record("status", debug(code));
    span.in_scope(|| tracing::debug!("call answered"));
}
