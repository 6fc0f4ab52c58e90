//! Server for clients and workers: its listener, its services and its shutdown.

use super::health::Health;
use super::{Error, Tls};
use crate::access::{self, Access};
use crate::actor::Command;
use crate::api::Api;
use crate::limits::{
    HANDSHAKE_WITHIN, KEEPALIVE, MAX_CALLS_OF_CONNECTION, MAX_CLIENT_REQUEST, MAX_HEADERS, STOP_WITHIN,
};
use crate::listener::{self, Admission, Listener};
use crate::standby::Gate;
use prometheus_client::metrics::gauge::Gauge;
use proto::limits::{MAX_ANSWER, MAX_MESSAGE};
use proto::v1::job_service_server::JobServiceServer;
use proto::v1::worker_service_server::WorkerServiceServer;
use std::sync::Arc;
use tokio::net::TcpListener;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::{Server, ServerTlsConfig};
use tower::util::MapRequestLayer;

/// Descriptors of the services, for reflection. `access::rules` must have a rule for each of their methods.
pub(crate) const DESCRIPTORS: [&[u8]; 2] = [proto::DESCRIPTORS, tonic_health::pb::FILE_DESCRIPTOR_SET];

/// Listener for clients and workers, with its access rules.
pub(super) struct ServiceListener {
    pub listener: TcpListener,
    /// Gauge of open connections.
    pub connections: Gauge,
    pub tls: Option<Tls>,
    pub access: Option<Arc<Access>>,
    /// Refuses calls while this coordinator is a standby.
    pub gate: Gate,
    pub health: Health,
}

/// Serves until a stop request, or until the work fails.
pub(super) async fn run(
    listener: ServiceListener,
    api: Api,
    mut work: JoinHandle<Result<(), Error>>,
    commands: mpsc::Sender<Command>,
    stop: watch::Sender<bool>,
    mut stopping: watch::Receiver<bool>,
) -> Result<(), Error> {
    let store = api.store.clone();
    let ServiceListener { listener, connections, tls, access, gate, health } = listener;
    let mut reflection = tonic_reflection::server::Builder::configure();
    for descriptors in DESCRIPTORS {
        reflection = reflection.register_encoded_file_descriptor_set(descriptors);
    }
    let reflection = reflection.build_v1().map_err(|e| Error::Server(e.to_string()))?;
    let jobs = JobServiceServer::new(api.clone())
        .max_decoding_message_size(MAX_CLIENT_REQUEST)
        .max_encoding_message_size(MAX_ANSWER);
    let workers =
        WorkerServiceServer::new(api).max_decoding_message_size(MAX_MESSAGE).max_encoding_message_size(MAX_MESSAGE);
    let mut told = stopping.clone();
    let listener = Listener::new(listener, Admission::of_service(access.is_some()), connections);
    let mut server = Server::builder()
        .http2_keepalive_interval(Some(KEEPALIVE))
        .http2_keepalive_timeout(Some(KEEPALIVE))
        .max_concurrent_streams(Some(MAX_CALLS_OF_CONNECTION))
        .http2_max_header_list_size(Some(MAX_HEADERS));
    if let Some(tls) = tls {
        server = server.tls_config(tls_config(tls)).map_err(unusable)?;
    }
    let server = server
        .layer(MapRequestLayer::new(listener::introduce))
        .layer(telemetry::calls::layer())
        .layer(access::layer(access, gate.clone()))
        .add_service(health.service())
        .add_service(reflection)
        .add_service(InterceptedService::new(jobs, gate.clone()))
        .add_service(InterceptedService::new(workers, gate))
        .serve_with_incoming_shutdown(listener, async move {
            // An error means that the sender, and so the server, no longer exists.
            let _ = told.wait_for(|stop| *stop).await;
        });
    let mut server = tokio::spawn(server);

    let work_ended = tokio::select! {
        ended = &mut work => Some(ended),
        ended = &mut server => {
            let why = match ended {
                Ok(Ok(())) => None,
                Ok(Err(e)) => Some(e.to_string()),
                Err(e) => Some(e.to_string()),
            };
            if let Some(why) = why {
                return Err(Error::Server(why));
            }
            None
        }
        _ = stopping.wait_for(|stop| *stop) => None,
    };
    stop.send_replace(true);
    health.stopping().await;
    let outcome = match work_ended {
        Some(ended) => ended,
        None => {
            // The actor may have stopped, or may not have started.
            let _ = commands.send(Command::Stop).await;
            work.await
        }
    };
    if !server.is_finished() && tokio::time::timeout(STOP_WITHIN, &mut server).await.is_err() {
        server.abort();
    }
    let closed = store.close().await;
    match outcome {
        Ok(result) => result.and(closed.map_err(Error::Store)),
        Err(panic) => Err(Error::Server(panic.to_string())),
    }
}

fn tls_config(tls: Tls) -> ServerTlsConfig {
    let config = ServerTlsConfig::new().identity(tls.identity.identity).timeout(HANDSHAKE_WITHIN);
    match tls.clients {
        Some(clients) => config.client_ca_root(clients.certificate),
        None => config,
    }
}

fn unusable(error: tonic::transport::Error) -> Error {
    Error::Tls { reason: proto::dial::reason(&error) }
}
