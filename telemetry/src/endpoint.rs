//! `/metrics` and `/healthz` over plain HTTP/1, for Prometheus and for supervisors that restart a hung program.
//!
//! Unauthenticated peers can only read numbers here. Bodies of requests are ignored, and the number and the duration of
//! connections are limited.

use http_body_util::Full;
use hyper::body::{Bytes, Incoming};
use hyper::header::{ALLOW, CONTENT_TYPE, HeaderValue};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use std::convert::Infallible;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio::task::JoinHandle;

/// Address of the metrics pages.
#[derive(Clone, Copy, Debug)]
pub struct Bind {
    /// Port 0 lets the system choose.
    pub addr: SocketAddr,
    /// Allows an address that other machines can reach.
    pub beyond_loopback: bool,
}

/// Greatest number of connections at once; others wait.
pub const MAX_CONNECTIONS: usize = 16;
/// Greatest age of a connection, even if it is in use.
pub const MAX_CONNECTION_AGE: Duration = Duration::from_secs(60);
/// Time within which a request's headers must arrive.
pub const HEADERS_WITHIN: Duration = Duration::from_secs(5);

/// Content type of OpenMetrics text.
const OPENMETRICS: HeaderValue = HeaderValue::from_static("application/openmetrics-text; version=1.0.0; charset=utf-8");
const PLAIN: HeaderValue = HeaderValue::from_static("text/plain; charset=utf-8");

/// Boxed future of an answer.
pub type Answer<'a, T> = Pin<Box<dyn Future<Output = T> + Send + 'a>>;

/// Metrics and health of a program.
pub trait Vitals: Send + Sync + 'static {
    /// Returns the current values of all metrics as OpenMetrics text.
    fn metrics(&self) -> Answer<'_, String>;

    /// Returns the program's activity in a few words, or the reason why it is unhealthy.
    fn health(&self) -> Answer<'_, Result<String, String>>;
}

/// Reason why metrics can't be served.
#[derive(Debug, thiserror::Error)]
pub enum BindError {
    /// The address is reachable from other machines.
    #[error(
        "other machines could read metrics at {addr} without authentication: serve them on 127.0.0.1, or add \
         --metrics-insecure-bind"
    )]
    NotLoopback {
        /// The address.
        addr: SocketAddr,
    },
    /// Another program listens at the address. Retryable after that program has ended.
    #[error("{addr} is in use by another program: stop it, or choose another --metrics address")]
    PortTaken {
        /// The address.
        addr: SocketAddr,
    },
    /// The operating system refuses the address.
    #[error("can't serve metrics at {addr}: {source}; choose another --metrics address")]
    Bind {
        /// The address.
        addr: SocketAddr,
        /// Error of the operating system.
        source: io::Error,
    },
}

/// Server of the metrics pages. It serves until it is dropped.
#[derive(Debug)]
pub struct Endpoint {
    addr: SocketAddr,
    task: JoinHandle<()>,
}

impl Drop for Endpoint {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl Endpoint {
    /// Binds the address and starts serving.
    // Boxed, so that it is compiled once, here, and not in every crate that awaits it.
    pub fn start(bind: Bind, vitals: Arc<dyn Vitals>) -> Answer<'static, Result<Self, BindError>> {
        Box::pin(Self::bind(bind, vitals))
    }

    async fn bind(bind: Bind, vitals: Arc<dyn Vitals>) -> Result<Self, BindError> {
        let Bind { addr, beyond_loopback } = bind;
        if !addr.ip().is_loopback() && !beyond_loopback {
            return Err(BindError::NotLoopback { addr });
        }
        let listener = TcpListener::bind(addr).await.map_err(|source| match source.kind() {
            io::ErrorKind::AddrInUse => BindError::PortTaken { addr },
            _ => BindError::Bind { addr, source },
        })?;
        let addr = listener.local_addr().map_err(|source| BindError::Bind { addr, source })?;
        tracing::info!(%addr, "metrics are served");
        Ok(Self { addr, task: tokio::spawn(serve(listener, vitals)) })
    }

    /// Returns the address, with the port that was chosen.
    pub fn addr(&self) -> SocketAddr {
        self.addr
    }
}

async fn serve(listener: TcpListener, vitals: Arc<dyn Vitals>) {
    let room = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    loop {
        // The semaphore is never closed.
        let Ok(permit) = room.clone().acquire_owned().await else { return };
        let stream = match listener.accept().await {
            Ok((stream, _)) => stream,
            Err(error) => {
                // Probably all file descriptors are in use. Some will become free.
                tracing::warn!(%error, "accepting a connection for metrics failed");
                tokio::time::sleep(Duration::from_secs(1)).await;
                continue;
            }
        };
        let vitals = vitals.clone();
        tokio::spawn(async move {
            let service = service_fn(move |request| {
                let vitals = vitals.clone();
                async move { Ok::<_, Infallible>(answer(&request, &*vitals).await) }
            });
            let connection = http1::Builder::new()
                .timer(TokioTimer::new())
                .header_read_timeout(HEADERS_WITHIN)
                .serve_connection(TokioIo::new(stream), service);
            // Errors of a connection are ignored here; the client sees them.
            let _ = tokio::time::timeout(MAX_CONNECTION_AGE, connection).await;
            drop(permit);
        });
    }
}

async fn answer(request: &Request<Incoming>, vitals: &dyn Vitals) -> Response<Full<Bytes>> {
    let (status, kind, text) = match request.uri().path() {
        "/metrics" | "/healthz" if !matches!(*request.method(), Method::GET | Method::HEAD) => {
            (StatusCode::METHOD_NOT_ALLOWED, PLAIN, "only GET and HEAD are allowed\n".to_owned())
        }
        "/metrics" => (StatusCode::OK, OPENMETRICS, vitals.metrics().await),
        "/healthz" => match vitals.health().await {
            Ok(text) => (StatusCode::OK, PLAIN, text + "\n"),
            Err(text) => (StatusCode::SERVICE_UNAVAILABLE, PLAIN, text + "\n"),
        },
        _ => (StatusCode::NOT_FOUND, PLAIN, "unknown path: use /metrics or /healthz\n".to_owned()),
    };
    let mut response = Response::new(Full::new(Bytes::from(text)));
    *response.status_mut() = status;
    response.headers_mut().insert(CONTENT_TYPE, kind);
    if status == StatusCode::METHOD_NOT_ALLOWED {
        response.headers_mut().insert(ALLOW, HeaderValue::from_static("GET, HEAD"));
    }
    response
}
