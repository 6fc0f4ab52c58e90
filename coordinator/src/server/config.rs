//! How a coordinator runs, and why one does not.

use crate::access::Access;
use crate::api::scaler::ScalerError;
use crate::limits::{DEFAULT_LEASE, DEFAULT_TAKEOVER, MAX_LEASE, MAX_TAKEOVER, MIN_LEASE, MIN_TAKEOVER};
use crate::store::{BadStoreUrl, StoreError, StoreUrl};
use proto::credentials::{Authority, Identity};
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

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

    /// Refuses what must not start.
    pub(super) fn check(&self) -> Result<(), Error> {
        let addr = self.listen;
        if !addr.ip().is_loopback() && !self.insecure_bind {
            let missing = match (&self.tls, &self.access) {
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
        if !(MIN_LEASE..=MAX_LEASE).contains(&self.lease) {
            return Err(Error::Lease { lease: self.lease });
        }
        if !(MIN_TAKEOVER..=MAX_TAKEOVER).contains(&self.takeover) {
            return Err(Error::Takeover { takeover: self.takeover });
        }
        if self.standby && !matches!(self.store, StoreUrl::Postgres(_)) {
            return Err(Error::NothingToShare { store: self.store.clone() });
        }
        Ok(())
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
