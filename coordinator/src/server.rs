//! Starting and stopping a coordinator.

use crate::access::{self, Access};
use crate::actor::{Actor, Clock, Command, LiveEvent};
use crate::api::scaler::{ScalerEndpoint, ScalerError};
use crate::api::{Api, Gates};
use crate::door::{self, Door};
use crate::journal::Journal;
use crate::limits::{
    DEFAULT_LEASE, DEFAULT_TAKEOVER, HANDSHAKE_WITHIN, LIVE_EVENTS, MAX_CALLS_OF_CONNECTION, MAX_CLIENT_REQUEST,
    MAX_HEADERS, MAX_LEASE, MAX_TAKEOVER, MIN_LEASE, MIN_TAKEOVER, STOP_WITHIN,
};
use crate::metrics::{Metrics, Pulse};
use crate::record::JobRecord;
use crate::scheduler::{Resumed, Scheduler, Settings};
use crate::standby::{self, Gate};
use crate::store::{self, BadStoreUrl, Loaded, Store, StoreError, StoreUrl, StoredJob};
use proto::credentials::{Authority, Identity};
use proto::limits::MAX_MESSAGE;
use proto::v1::job_service_server::JobServiceServer;
use proto::v1::worker_service_server::WorkerServiceServer;
use sim_core::finish::Plan;
use sim_core::job::Job;
use std::collections::HashMap;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::{broadcast, mpsc, watch};
use tokio::task::{JoinHandle, JoinSet};
use tonic::server::NamedService;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::{Server, ServerTlsConfig};
use tonic_health::ServingStatus;
use tonic_health::server::HealthReporter;
use tower::util::MapRequestLayer;

/// How often an idle connection is checked, and how long the other side has to answer.
const KEEPALIVE: Duration = Duration::from_secs(10);

/// What reflection tells, and what `access::rules` has to name.
pub(crate) const DESCRIPTORS: [&[u8]; 2] = [proto::DESCRIPTORS, tonic_health::pb::FILE_DESCRIPTOR_SET];

/// How connections are encrypted.
#[derive(Clone, Debug)]
pub struct Tls {
    /// The coordinator's certificate and key.
    pub identity: Identity,
    /// Whoever connects has to show a certificate that one of these signed, if any are given.
    pub clients: Option<Authority>,
}

/// How a coordinator runs.
#[derive(Clone, Debug)]
pub struct Config {
    /// Where to listen; port 0 lets the system choose.
    pub listen: SocketAddr,
    /// Where jobs live.
    pub store: StoreUrl,
    /// Without a sign of life for this long a worker's work goes to others: 0.1 s to 1 h.
    pub lease: Duration,
    /// Waits while another coordinator is at work on the same store, and takes over when that one ends.
    pub standby: bool,
    /// Out of touch with a store that several coordinators can reach for this long, this one stops and another one may take
    /// over: 0.5 s to 10 min.
    pub takeover: Duration,
    /// Encrypts connections.
    pub tls: Option<Tls>,
    /// Asks for tokens. Without them everybody who can connect may do everything.
    pub access: Option<Arc<Access>>,
    /// Allows to listen beyond loopback without encryption or without tokens.
    pub insecure_bind: bool,
    /// Where metrics are served, if at all.
    pub metrics: Option<telemetry::Bind>,
    /// Where KEDA is answered, if at all.
    pub keda: Option<telemetry::Bind>,
}

impl Config {
    /// For a coordinator inside another process: a free port of the loopback interface.
    pub fn embedded(store: StoreUrl) -> Self {
        Self {
            listen: SocketAddr::from(([127, 0, 0, 1], 0)),
            store,
            lease: DEFAULT_LEASE,
            standby: false,
            takeover: DEFAULT_TAKEOVER,
            tls: None,
            access: None,
            insecure_bind: false,
            metrics: None,
            keda: None,
        }
    }
}

/// Why a coordinator does not start, or stopped.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Somebody else listens there. Retryable once that has ended.
    #[error("{addr} is taken by another program: stop it, or choose another --listen address")]
    PortTaken {
        /// Where.
        addr: SocketAddr,
    },
    /// The address is reachable from other machines.
    #[error(
        "{addr} can be reached from other machines, and {missing}: `evogait certs init` makes what is needed; or listen on \
         127.0.0.1, or add --insecure-bind if everybody on that network may run jobs here"
    )]
    NotLoopback {
        /// Where.
        addr: SocketAddr,
        /// What is not there.
        missing: &'static str,
    },
    /// Certificates that the transport can't use.
    #[error("connections can't be encrypted with these certificates: {reason}")]
    Tls {
        /// What it says.
        reason: String,
    },
    /// The system refuses to listen there.
    #[error("can't listen on {addr}: {source}")]
    Bind {
        /// Where.
        addr: SocketAddr,
        /// What the system says.
        source: io::Error,
    },
    /// A lease out of range.
    #[error(
        "a lease of {} s is out of range: {} s to {} s are allowed",
        .lease.as_secs_f64(), MIN_LEASE.as_secs_f64(), MAX_LEASE.as_secs_f64()
    )]
    Lease {
        /// What was asked for.
        lease: Duration,
    },
    /// Metrics can't be served as asked.
    #[error(transparent)]
    Metrics(#[from] telemetry::BindError),
    /// A time to a takeover out of range.
    #[error(
        "a takeover after {} s is out of range: {} s to {} s are allowed",
        .takeover.as_secs_f64(), MIN_TAKEOVER.as_secs_f64(), MAX_TAKEOVER.as_secs_f64()
    )]
    Takeover {
        /// What was asked for.
        takeover: Duration,
    },
    /// A standby on a store that only one coordinator can open.
    #[error(
        "--standby needs a store that several coordinators can reach: --store postgres://USER@HOST/DATABASE, not {store}"
    )]
    NothingToShare {
        /// The store.
        store: StoreUrl,
    },
    /// A text that names no store.
    #[error(transparent)]
    StoreUrl(#[from] BadStoreUrl),
    /// KEDA can't be answered as asked.
    #[error(transparent)]
    Scaler(#[from] ScalerError),
    /// The store. See there whether it is retryable.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The server ended by itself.
    #[error("the server failed: {0}")]
    Server(String),
}

/// A coordinator that runs. Dropping it does not stop it in an orderly way: call [`Running::shutdown`].
#[derive(Debug)]
pub struct Running {
    local_addr: SocketAddr,
    metrics: Option<telemetry::Endpoint>,
    secure: bool,
    scaler: Option<ScalerEndpoint>,
    stop: watch::Sender<bool>,
    task: JoinHandle<Result<(), Error>>,
    /// Whether `task` was seen to end.
    ended: bool,
}

impl Running {
    /// Where it listens, with the port that was chosen.
    pub fn local_addr(&self) -> SocketAddr {
        self.local_addr
    }

    /// Where metrics are served, with the port that was chosen.
    pub fn metrics_addr(&self) -> Option<SocketAddr> {
        self.metrics.as_ref().map(telemetry::Endpoint::addr)
    }

    /// Where KEDA is answered, with the port that was chosen.
    pub fn keda_addr(&self) -> Option<SocketAddr> {
        self.scaler.as_ref().map(ScalerEndpoint::addr)
    }

    /// Where clients and workers connect to.
    pub fn url(&self) -> String {
        format!("{}://{}", if self.secure { "https" } else { "http" }, self.local_addr)
    }

    /// Waits until it ends by itself, which only a failure makes it do. May be dropped and called again.
    pub async fn failed(&mut self) -> Error {
        if self.ended {
            return Error::Server("it ended before".to_owned());
        }
        let end = (&mut self.task).await;
        self.ended = true;
        match end {
            Ok(Err(error)) => error,
            Ok(Ok(())) => Error::Server("it ended without being told to".to_owned()),
            Err(error) => Error::Server(error.to_string()),
        }
    }

    /// Ends all calls, commits what is under way and stops.
    pub async fn shutdown(self) -> Result<(), Error> {
        self.stop.send_replace(true);
        if self.ended {
            return Ok(()); // `failed` told already how
        }
        self.task.await.unwrap_or_else(|error| Err(Error::Server(error.to_string())))
    }
}

/// Starts a coordinator: binds, opens the store, takes up its jobs. As a standby it takes them up when it is its turn.
pub async fn serve(config: Config) -> Result<Running, Error> {
    let addr = config.listen;
    if !addr.ip().is_loopback() && !config.insecure_bind {
        let missing = match (&config.tls, &config.access) {
            (None, None) => {
                Some("connections are neither encrypted (--tls-cert, --tls-key) nor authenticated (--tokens)")
            }
            (None, Some(_)) => Some("connections are not encrypted (--tls-cert, --tls-key)"),
            (Some(_), None) => Some("callers are not authenticated (--tokens)"),
            (Some(_), Some(_)) => None,
        };
        if let Some(missing) = missing {
            return Err(Error::NotLoopback { addr, missing });
        }
    }
    if !(MIN_LEASE..=MAX_LEASE).contains(&config.lease) {
        return Err(Error::Lease { lease: config.lease });
    }
    if !(MIN_TAKEOVER..=MAX_TAKEOVER).contains(&config.takeover) {
        return Err(Error::Takeover { takeover: config.takeover });
    }
    if config.standby && !matches!(config.store, StoreUrl::Postgres(_)) {
        return Err(Error::NothingToShare { store: config.store });
    }
    let listener = TcpListener::bind(addr).await.map_err(|source| match source.kind() {
        io::ErrorKind::AddrInUse => Error::PortTaken { addr },
        _ => Error::Bind { addr, source },
    })?;
    let local_addr = listener.local_addr().map_err(|source| Error::Bind { addr, source })?;
    let metrics = Arc::new(Metrics::new());
    let pulse = Arc::new(Pulse::new(metrics.clone()));
    let endpoint = match config.metrics {
        Some(bind) => Some(telemetry::Endpoint::start(bind, pulse.clone()).await?),
        None => None,
    };
    let scaler = match config.keda {
        Some(bind) => Some(ScalerEndpoint::start(bind, pulse.clone()).await?),
        None => None,
    };
    let store = store::open(&config.store, config.takeover).await?;
    let engines = tokio::task::spawn_blocking(sim_core::engine_digests).await;
    let engines: Arc<[_]> = engines.map_err(|e| Error::Server(e.to_string()))?.into();
    metrics.engines(&engines);

    let events = broadcast::channel(LIVE_EVENTS).0;
    let (commands, inbox) = mpsc::channel(1024);
    let (stop, mut stopping) = watch::channel(false);
    let stopped = stopping.clone();
    let (key, gate) = Gate::new(!config.standby);
    let api = Api {
        store: store.clone(),
        commands: commands.clone(),
        events: events.clone(),
        stopping: stopping.clone(),
        engines,
        gates: Gates::default(),
    };
    let secure = config.tls.is_some();
    let doors = Doors { listener, tls: config.tls, access: config.access, gate };
    let lead = lead(store, config.standby, config.lease, events, metrics);
    let to_actor = commands.clone();
    let work = if config.standby {
        tokio::spawn(async move {
            let lead = tokio::select! {
                lead = lead => lead?,
                _ = stopping.wait_for(|stop| *stop) => return Ok(()),
            };
            pulse.activate(to_actor);
            key.open();
            lead.work(inbox).await
        })
    } else {
        let lead = lead.await?;
        pulse.activate(to_actor);
        tokio::spawn(lead.work(inbox))
    };
    let task = tokio::spawn(run(doors, api, work, commands, stop.clone(), stopped));
    Ok(Running { local_addr, metrics: endpoint, scaler, secure, stop, task, ended: false })
}

/// A coordinator whose turn it is.
struct Lead {
    actor: Actor,
    /// Ends when the store is lost.
    touch: JoinSet<StoreError>,
}

/// Waits for its turn and takes up what there is to do.
async fn lead(
    store: Arc<dyn Store>,
    standby: bool,
    lease: Duration,
    events: broadcast::Sender<LiveEvent>,
    metrics: Arc<Metrics>,
) -> Result<Lead, Error> {
    let loaded = standby::turn(&*store, standby).await?;
    // Before the jobs are taken up, which takes a while.
    let mut touch = JoinSet::new();
    touch.spawn(standby::stay_in_touch(store.clone(), loaded.epoch));
    Ok(Lead { actor: take_up(store, loaded, lease, events, metrics).await?, touch })
}

impl Lead {
    /// Works until told to stop, or until the store fails or is another's.
    async fn work(mut self, inbox: mpsc::Receiver<Command>) -> Result<(), Error> {
        let (store, epoch) = (self.actor.store.clone(), self.actor.epoch);
        tokio::select! {
            ended = self.actor.run(inbox) => ended?,
            Some(lost) = self.touch.join_next() => {
                return Err(lost.map_or_else(|e| Error::Server(e.to_string()), Error::Store));
            }
        }
        self.touch.shutdown().await;
        Ok(store.release(epoch).await?)
    }
}

/// Builds the scheduler from what is in the store.
async fn take_up(
    store: Arc<dyn Store>,
    loaded: Loaded,
    lease: Duration,
    events: broadcast::Sender<LiveEvent>,
    metrics: Arc<Metrics>,
) -> Result<Actor, Error> {
    metrics.epoch.set(loaded.epoch as i64);
    tracing::info!(epoch = loaded.epoch, jobs = loaded.active.len(), "the store is taken up");
    let clock = Clock::start();
    let settings = Settings::new(loaded.epoch, lease);
    let mut scheduler = Scheduler::new(settings, loaded.next_job, loaded.ended.into_iter().collect())
        .with_quarantined(loaded.quarantined);
    for stored in loaded.active {
        let id = stored.record.id.clone();
        let read = tokio::task::spawn_blocking(move || read_again(stored)).await;
        let problem = match read.map_err(|e| Error::Server(e.to_string()))? {
            Ok(resumed) => scheduler.resume(clock.now(), resumed).err().map(|e| e.to_string()),
            Err(unusable) => {
                let (record, reason) = *unusable;
                scheduler.give_up(clock.now(), record, reason.clone());
                Some(reason)
            }
        };
        match problem {
            None => tracing::info!(job = %id, epoch = loaded.epoch, "job goes on"),
            Some(reason) => tracing::error!(job = %id, reason, epoch = loaded.epoch, "job can't go on"),
        }
    }
    Ok(Actor {
        scheduler,
        store,
        epoch: loaded.epoch,
        lease,
        heartbeat: settings.heartbeat(),
        clock,
        events,
        sessions: HashMap::new(),
        journal: Journal::new(loaded.epoch, metrics.clone()),
        metrics,
    })
}

/// Where strangers come in, and what is asked of them.
struct Doors {
    listener: TcpListener,
    tls: Option<Tls>,
    access: Option<Arc<Access>>,
    /// Whether it is this coordinator's turn.
    gate: Gate,
}

/// Serves until told to stop, or until the work fails.
async fn run(
    doors: Doors,
    api: Api,
    mut work: JoinHandle<Result<(), Error>>,
    commands: mpsc::Sender<Command>,
    stop: watch::Sender<bool>,
    mut stopping: watch::Receiver<bool>,
) -> Result<(), Error> {
    let store = api.store.clone();
    let (health, health_service) = tonic_health::server::health_reporter();
    let Doors { listener, tls, access, gate } = doors;
    let tell = tokio::spawn(tell_health(health, gate.clone(), stopping.clone()));
    let mut reflection = tonic_reflection::server::Builder::configure();
    for descriptors in DESCRIPTORS {
        reflection = reflection.register_encoded_file_descriptor_set(descriptors);
    }
    let reflection = reflection.build_v1().map_err(|e| Error::Server(e.to_string()))?;
    let jobs = JobServiceServer::new(api.clone())
        .max_decoding_message_size(MAX_CLIENT_REQUEST)
        .max_encoding_message_size(MAX_MESSAGE);
    let workers =
        WorkerServiceServer::new(api).max_decoding_message_size(MAX_MESSAGE).max_encoding_message_size(MAX_MESSAGE);
    let mut told = stopping.clone();
    let door = Door::new(listener, access.is_some());
    let mut server = Server::builder()
        .http2_keepalive_interval(Some(KEEPALIVE))
        .http2_keepalive_timeout(Some(KEEPALIVE))
        .max_concurrent_streams(Some(MAX_CALLS_OF_CONNECTION))
        .http2_max_header_list_size(Some(MAX_HEADERS));
    if let Some(tls) = tls {
        server = server.tls_config(tls_config(tls)).map_err(unusable)?;
    }
    let server = server
        .layer(MapRequestLayer::new(door::introduce))
        .layer(telemetry::calls::layer())
        .layer(access::layer(access))
        .add_service(health_service)
        .add_service(reflection)
        .add_service(InterceptedService::new(jobs, gate.clone()))
        .add_service(InterceptedService::new(workers, gate))
        .serve_with_incoming_shutdown(door, async move {
            // An error means that nobody can tell any more.
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
    let outcome = match work_ended {
        Some(ended) => ended,
        None => {
            // If the actor has gone, or was never there, it needs no telling.
            let _ = commands.send(Command::Stop).await;
            work.await
        }
    };
    tell.abort();
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

/// Tells who asks for the health of the services: they are there while calls are let through.
async fn tell_health(health: HealthReporter, mut gate: Gate, mut stopping: watch::Receiver<bool>) {
    let set = async |status| {
        // The empty name stands for all of them.
        for name in ["", JobServiceServer::<Api>::NAME, WorkerServiceServer::<Api>::NAME] {
            health.set_service_status(name, status).await;
        }
    };
    set(ServingStatus::NotServing).await;
    tokio::select! {
        () = gate.opened() => {}
        _ = stopping.wait_for(|stop| *stop) => return,
    }
    set(ServingStatus::Serving).await;
    let _ = stopping.wait_for(|stop| *stop).await;
    set(ServingStatus::NotServing).await;
}

/// Reads a stored job again, or says why it can't go on.
fn read_again(stored: StoredJob) -> Result<Resumed, Box<(JobRecord, String)>> {
    let StoredJob { record, toml, search, results, last_scores } = stored;
    match Job::from_toml(&toml) {
        Ok(job) if job.digest() == record.job_digest => {
            let (at_once, optimiser, finish) = (job.candidates_at_once(), job.optimiser(), Plan::of(&job));
            Ok(Resumed { record, toml, at_once, optimiser, finish, search, results, last_scores })
        }
        Ok(job) => {
            let reason = format!(
                "it was submitted to another version of evogait, which reads it differently (job digest then {}, now \
                 {}): submit it again",
                record.job_digest.short(),
                job.digest().short()
            );
            Err(Box::new((record, reason)))
        }
        Err(error) => Err(Box::new((record, format!("this version of evogait can't read it: {error}")))),
    }
}
