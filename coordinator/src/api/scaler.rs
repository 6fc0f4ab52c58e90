//! External scaler for KEDA: serves the number of slots that the jobs could use. KEDA starts and stops workers by it.
//!
//! It has its own listener, without encryption and tokens: KEDA sends none. An unauthenticated peer can only read a
//! number.

use crate::limits::{DEMAND_EVERY, KEEPALIVE, MAX_HEADERS, MAX_SCALERS};
use crate::listener::{self, Admission, Listener};
use crate::scheduler::Demand;
use crate::vitals::CoordinatorVitals;
use prometheus_client::metrics::gauge::Gauge;
use proto::externalscaler::external_scaler_server::{ExternalScaler, ExternalScalerServer};
use proto::externalscaler::{
    GetMetricSpecResponse, GetMetricsRequest, GetMetricsResponse, IsActiveResponse, MetricSpec, MetricValue,
    ScaledObjectRef,
};
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Instant;
use tokio::net::TcpListener;
use tokio::sync::{Mutex, Semaphore, mpsc};
use tokio::task::JoinHandle;
use tokio_stream::Stream;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::Server;
use tonic::{Request, Response, Status};
use tower::util::MapRequestLayer;

/// Name of the only metric.
const SLOTS: &str = "slots_wanted";
/// Key in the trigger's metadata: the `--slots` of a worker.
const SLOTS_PER_WORKER: &str = "slotsPerWorker";

/// Reason why the external scaler can't start.
#[derive(Debug, thiserror::Error)]
pub enum ScalerError {
    /// The address is reachable from other machines.
    #[error(
        "other machines could read the demand at {addr} without authentication: use 127.0.0.1, or add \
         --keda-insecure-bind"
    )]
    NotLoopback {
        /// Address of the listener.
        addr: SocketAddr,
    },
    /// The system refuses the address.
    #[error("can't serve KEDA at {addr}: {source}; choose another --keda address")]
    Bind {
        /// Address of the listener.
        addr: SocketAddr,
        /// Error of the system.
        source: io::Error,
    },
}

/// Server for KEDA; stops when it is dropped.
#[derive(Debug)]
pub(crate) struct ScalerEndpoint {
    addr: SocketAddr,
    task: JoinHandle<()>,
}

impl Drop for ScalerEndpoint {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl ScalerEndpoint {
    /// Binds the address and starts serving.
    pub async fn start(bind: telemetry::Bind, vitals: Arc<CoordinatorVitals>) -> Result<Self, ScalerError> {
        let telemetry::Bind { addr, beyond_loopback } = bind;
        if !addr.ip().is_loopback() && !beyond_loopback {
            return Err(ScalerError::NotLoopback { addr });
        }
        let failed = |source| ScalerError::Bind { addr, source };
        let listener = TcpListener::bind(addr).await.map_err(failed)?;
        let addr = listener.local_addr().map_err(failed)?;
        let listener = Listener::new(listener, Admission::of_scaler(), Gauge::default());
        let scaler = Scaler { vitals: Arc::new(Asked::new(vitals)), streams: Arc::new(Semaphore::new(MAX_SCALERS)) };
        let task = tokio::spawn(async move {
            let server = Server::builder()
                .http2_keepalive_interval(Some(KEEPALIVE))
                .http2_keepalive_timeout(Some(KEEPALIVE))
                .http2_max_header_list_size(Some(MAX_HEADERS))
                .concurrency_limit_per_connection(MAX_SCALERS)
                .max_concurrent_streams(MAX_SCALERS as u32)
                .layer(MapRequestLayer::new(listener::know))
                .add_service(ExternalScalerServer::new(scaler))
                .serve_with_incoming(listener);
            if let Err(error) = server.await {
                tracing::error!(%error, "the server for KEDA has failed");
            }
        });
        Ok(Self { addr, task })
    }

    /// Address of the listener, with the chosen port.
    pub fn addr(&self) -> SocketAddr {
        self.addr
    }
}

struct Scaler {
    vitals: Arc<Asked>,
    streams: Arc<Semaphore>,
}

/// Cache of the demand. It limits the queries, so that unauthenticated peers can't overload the coordinator.
struct Asked {
    vitals: Arc<CoordinatorVitals>,
    last: Mutex<Option<(Instant, Option<Demand>)>>,
}

impl Asked {
    fn new(vitals: Arc<CoordinatorVitals>) -> Self {
        Self { vitals, last: Mutex::new(None) }
    }

    /// Returns the demand, at most half of [`DEMAND_EVERY`] old. An error can be retried: another coordinator serves,
    /// or this one will.
    async fn demand(&self) -> Result<Demand, Status> {
        let mut last = self.last.lock().await;
        let demand = match *last {
            Some((at, demand)) if at.elapsed() < DEMAND_EVERY / 2 => demand,
            _ => {
                let demand = self.vitals.demand().await;
                *last = Some((Instant::now(), demand));
                demand
            }
        };
        demand.ok_or_else(|| Status::unavailable("this coordinator is not active: try again"))
    }
}

#[tonic::async_trait]
impl ExternalScaler for Scaler {
    type StreamIsActiveStream = Pin<Box<dyn Stream<Item = Result<IsActiveResponse, Status>> + Send>>;

    async fn is_active(&self, _: Request<ScaledObjectRef>) -> Result<Response<IsActiveResponse>, Status> {
        Ok(Response::new(IsActiveResponse { result: self.vitals.demand().await?.wanted > 0 }))
    }

    async fn stream_is_active(
        &self,
        _: Request<ScaledObjectRef>,
    ) -> Result<Response<Self::StreamIsActiveStream>, Status> {
        let room = self.streams.clone().try_acquire_owned();
        let room =
            room.map_err(|_| Status::resource_exhausted(format!("{MAX_SCALERS} streams are open: try again later")))?;
        let vitals = self.vitals.clone();
        let (out, stream) = mpsc::channel(1);
        tokio::spawn(async move {
            let (mut told, mut every) = (None, tokio::time::interval(DEMAND_EVERY));
            loop {
                tokio::select! {
                    _ = every.tick() => {}
                    () = out.closed() => break,
                }
                let now = vitals.demand().await.map(|demand| demand.wanted > 0);
                let failed = now.is_err();
                if now.as_ref().ok().copied() != told || failed {
                    told = now.as_ref().ok().copied();
                    if out.send(now.map(|result| IsActiveResponse { result })).await.is_err() || failed {
                        break;
                    }
                }
            }
            drop(room);
        });
        Ok(Response::new(Box::pin(ReceiverStream::new(stream))))
    }

    async fn get_metric_spec(
        &self,
        request: Request<ScaledObjectRef>,
    ) -> Result<Response<GetMetricSpecResponse>, Status> {
        let slots: u32 = match request.into_inner().scaler_metadata.get(SLOTS_PER_WORKER) {
            None => 1,
            Some(text) => text.parse().ok().filter(|slots| *slots > 0).ok_or_else(|| {
                Status::invalid_argument(format!("{SLOTS_PER_WORKER} = \"{text}\" must be an integer of at least 1"))
            })?,
        };
        let spec = MetricSpec {
            metric_name: SLOTS.to_owned(),
            target_size: i64::from(slots),
            target_size_float: f64::from(slots),
        };
        Ok(Response::new(GetMetricSpecResponse { metric_specs: vec![spec] }))
    }

    async fn get_metrics(&self, _: Request<GetMetricsRequest>) -> Result<Response<GetMetricsResponse>, Status> {
        let wanted = self.vitals.demand().await?.wanted;
        let value = MetricValue {
            metric_name: SLOTS.to_owned(),
            metric_value: i64::from(wanted),
            metric_value_float: f64::from(wanted),
        };
        Ok(Response::new(GetMetricsResponse { metric_values: vec![value] }))
    }
}
