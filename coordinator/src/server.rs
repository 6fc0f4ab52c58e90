//! Start and stop of a coordinator.

mod config;
mod health;
mod serve;
mod takeover;

pub use config::{Config, Error, Tls};
#[cfg(test)]
pub(crate) use serve::DESCRIPTORS;

use crate::api::scaler::ScalerEndpoint;
use crate::api::{Api, Gates};
use crate::live::Live;
use crate::metrics::Metrics;
use crate::standby::Gate;
use crate::store;
use crate::vitals::CoordinatorVitals;
use health::Health;
use serve::ServiceListener;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use tokio::net::TcpListener;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;

/// Running coordinator. Dropping it does not stop it cleanly: call [`Running::shutdown`].
#[derive(Debug)]
pub struct Running {
    local_addr: SocketAddr,
    metrics: Option<telemetry::Endpoint>,
    secure: bool,
    scaler: Option<ScalerEndpoint>,
    stop: watch::Sender<bool>,
    task: JoinHandle<Result<(), Error>>,
    /// True once [`Running::failed`] has returned the result of `task`.
    ended: bool,
}

impl Running {
    /// Address for clients and workers, with the chosen port.
    pub fn local_addr(&self) -> SocketAddr {
        self.local_addr
    }

    /// Address of the metrics, with the chosen port.
    pub fn metrics_addr(&self) -> Option<SocketAddr> {
        self.metrics.as_ref().map(telemetry::Endpoint::addr)
    }

    /// Address for KEDA, with the chosen port.
    pub fn keda_addr(&self) -> Option<SocketAddr> {
        self.scaler.as_ref().map(ScalerEndpoint::addr)
    }

    /// URL for clients and workers.
    pub fn url(&self) -> String {
        format!("{}://{}", if self.secure { "https" } else { "http" }, self.local_addr)
    }

    /// Waits for a failure that ends the coordinator, and returns it. The future may be dropped and the function called
    /// again.
    pub async fn failed(&mut self) -> Error {
        if self.ended {
            return Error::Server("it has already ended".to_owned());
        }
        let end = (&mut self.task).await;
        self.ended = true;
        match end {
            Ok(Err(error)) => error,
            Ok(Ok(())) => Error::Server("it ended without a stop request".to_owned()),
            Err(error) => Error::Server(error.to_string()),
        }
    }

    /// Ends all calls, commits pending changes and stops.
    pub async fn shutdown(self) -> Result<(), Error> {
        self.stop.send_replace(true);
        if self.ended {
            return Ok(()); // `failed` has returned the error
        }
        self.task.await.unwrap_or_else(|error| Err(Error::Server(error.to_string())))
    }
}

/// Starts a coordinator: binds its address, opens the store and resumes its jobs. A standby resumes them when it
/// becomes active.
// Boxed, so that it is compiled once, here, and not in every crate that awaits it.
pub fn serve(config: Config) -> Pin<Box<dyn Future<Output = Result<Running, Error>> + Send>> {
    Box::pin(start(config))
}

async fn start(config: Config) -> Result<Running, Error> {
    config.check()?;
    let addr = config.listen;
    let listener = TcpListener::bind(addr).await.map_err(|source| match source.kind() {
        io::ErrorKind::AddrInUse => Error::PortTaken { addr },
        _ => Error::Bind { addr, source },
    })?;
    let local_addr = listener.local_addr().map_err(|source| Error::Bind { addr, source })?;
    let metrics = Arc::new(Metrics::new());
    let vitals = Arc::new(CoordinatorVitals::new(metrics.clone()));
    let endpoint = match config.metrics {
        Some(bind) => Some(telemetry::Endpoint::start(bind, vitals.clone()).await?),
        None => None,
    };
    let scaler = match config.keda {
        Some(bind) => Some(ScalerEndpoint::start(bind, vitals.clone()).await?),
        None => None,
    };
    let store = store::open(&config.store, config.takeover).await?;
    let engines = tokio::task::spawn_blocking(sim_core::engines::engine_digests).await;
    let engines: Arc<[_]> = engines.map_err(|e| Error::Server(e.to_string()))?.into();
    metrics.engines(&engines);

    let live = Live::default();
    let (commands, inbox) = mpsc::channel(1024);
    let (stop, mut stopping) = watch::channel(false);
    let stopped = stopping.clone();
    let (key, gate) = Gate::new(!config.standby);
    let api = Api {
        store: store.clone(),
        commands: commands.clone(),
        live: live.clone(),
        stopping: stopping.clone(),
        engines: engines.clone(),
        gates: Gates::default(),
    };
    let secure = config.tls.is_some();
    let connections = metrics.connections.clone();
    let health = Health::new().await;
    let listener =
        ServiceListener { listener, connections, tls: config.tls, access: config.access, gate, health: health.clone() };
    let takeover = takeover::take_over(store, config.standby, config.lease, engines, live, metrics);
    let to_actor = commands.clone();
    let work = if config.standby {
        tokio::spawn(async move {
            let active = tokio::select! {
                active = takeover => active?,
                _ = stopping.wait_for(|stop| *stop) => return Ok(()),
            };
            vitals.activate(to_actor);
            // The health status changes before calls are accepted, so that it is correct at the first accepted call.
            health.serving().await;
            key.open();
            active.work(inbox).await
        })
    } else {
        let active = takeover.await?;
        vitals.activate(to_actor);
        health.serving().await;
        tokio::spawn(active.work(inbox))
    };
    let task = tokio::spawn(serve::run(listener, api, work, commands, stop.clone(), stopped));
    Ok(Running { local_addr, metrics: endpoint, scaler, secure, stop, task, ended: false })
}
