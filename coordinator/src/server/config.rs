//! Configuration of a coordinator, and errors of its start.

use crate::access::Access;
use crate::api::scaler::ScalerError;
use crate::limits::{DEFAULT_LEASE, DEFAULT_TAKEOVER, MAX_LEASE, MAX_TAKEOVER, MIN_LEASE, MIN_TAKEOVER};
use crate::store::{BadStoreUrl, StoreError, StoreUrl};
use proto::credentials::{Authority, Identity};
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

/// TLS configuration.
#[derive(Clone, Debug)]
pub struct Tls {
    /// Certificate and key of the coordinator.
    pub identity: Identity,
    /// CAs of client certificates. If set, clients and workers must present a certificate signed by one of them.
    pub clients: Option<Authority>,
}

/// Configuration of a coordinator.
#[derive(Clone, Debug)]
pub struct Config {
    /// Address to listen on; port 0 selects a free port.
    pub listen: SocketAddr,
    /// Store of the jobs.
    pub store: StoreUrl,
    /// Duration of a lease: 0.1 s to 1 h. The tasks of a worker that sends nothing for this long go to other workers.
    pub lease: Duration,
    /// Waits while another coordinator is active on the same store, and takes over when that one ends.
    pub standby: bool,
    /// Takeover time: 0.5 s to 10 min. If this coordinator can't reach a shared store for this long, it stops and
    /// another one may take over.
    pub takeover: Duration,
    /// TLS configuration; `None` for connections without encryption.
    pub tls: Option<Tls>,
    /// Accepted tokens; `None` permits every call of every peer.
    pub access: Option<Arc<Access>>,
    /// Allows listening beyond loopback without encryption or without tokens.
    pub insecure_bind: bool,
    /// Address of the metrics; `None` if they are not served.
    pub metrics: Option<telemetry::Bind>,
    /// Address for KEDA; `None` if it is not served.
    pub keda: Option<telemetry::Bind>,
}

impl Config {
    /// Returns the configuration of a coordinator inside another process: a free port of the loopback interface.
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

    /// Checks the configuration.
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

/// Error that prevents a coordinator's start or ends it.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Another program listens on the address. Can be retried once that program has ended.
    #[error("{addr} is in use by another program: stop that program, or choose another --listen address")]
    PortTaken {
        /// Address to listen on.
        addr: SocketAddr,
    },
    /// The address is reachable from other machines.
    #[error(
        "other machines can reach {addr}, and {missing}: create certificates and tokens with `evogait certs init`, listen on \
         127.0.0.1, or add --insecure-bind if every machine on that network may run jobs here"
    )]
    NotLoopback {
        /// Address to listen on.
        addr: SocketAddr,
        /// Description of the missing protection.
        missing: &'static str,
    },
    /// The certificates can't be used.
    #[error("can't encrypt connections with these certificates: {reason}")]
    Tls {
        /// Message of the TLS library.
        reason: String,
    },
    /// The system refuses the address.
    #[error("can't listen on {addr}: {source}; choose another --listen address")]
    Bind {
        /// Address to listen on.
        addr: SocketAddr,
        /// Error of the system.
        source: io::Error,
    },
    /// The lease is out of range.
    #[error(
        "a lease of {} s is out of range: {} s to {} s are allowed",
        .lease.as_secs_f64(), MIN_LEASE.as_secs_f64(), MAX_LEASE.as_secs_f64()
    )]
    Lease {
        /// Requested duration.
        lease: Duration,
    },
    /// The metrics can't be served.
    #[error(transparent)]
    Metrics(#[from] telemetry::BindError),
    /// The takeover time is out of range.
    #[error(
        "a takeover time of {} s is out of range: {} s to {} s are allowed",
        .takeover.as_secs_f64(), MIN_TAKEOVER.as_secs_f64(), MAX_TAKEOVER.as_secs_f64()
    )]
    Takeover {
        /// Requested duration.
        takeover: Duration,
    },
    /// The standby's store can't be shared.
    #[error(
        "--standby needs a store that several coordinators can reach: --store postgres://USER@HOST/DATABASE, not {store}"
    )]
    NothingToShare {
        /// Store that only one coordinator can open.
        store: StoreUrl,
    },
    /// The text is not a store URL.
    #[error(transparent)]
    StoreUrl(#[from] BadStoreUrl),
    /// KEDA can't be served.
    #[error(transparent)]
    Scaler(#[from] ScalerError),
    /// The store failed. [`StoreError`] documents which errors can be retried.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The server ended by itself.
    #[error("the server failed: {0}")]
    Server(String),
}
