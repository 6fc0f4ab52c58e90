//! Connections of clients and workers to a coordinator. A [`Dial`] combines addresses and credentials; its [`FailoverChannel`] is a
//! channel that switches to the next address when the current one does not serve.
//!
//! A standby answers UNAVAILABLE, and so does a coordinator that is stopping; a crashed one does not answer. The call
//! that finds this fails, and the next call uses the next address: callers retry in any case.

mod address;
mod backoff;
mod failover;
mod reason;

pub use address::{Address, Addresses, BadAddress, MAX_ADDRESSES};
pub use backoff::Backoff;
pub use failover::FailoverChannel;
pub use reason::{BadCertificate, bad_certificate, reason};

use crate::credentials::Credentials;
use http::HeaderValue;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use tonic::transport::{ClientTlsConfig, Endpoint};

/// Time limit for connecting.
const CONNECT_WITHIN: Duration = Duration::from_secs(5);
/// Time between checks of a connection, and time limit for the peer's answer: a half-open connection is detected within
/// twice this time.
const KEEPALIVE: Duration = Duration::from_secs(10);

/// Addresses and credentials of a coordinator. Clones share the current address.
#[derive(Clone, Debug)]
pub struct Dial {
    addresses: Addresses,
    endpoints: Arc<[Endpoint]>,
    token: Option<HeaderValue>,
    /// Index of the address that served last, or that is tried next.
    current: Arc<AtomicUsize>,
}

/// Addresses and credentials that do not fit each other. Not retryable: the user must change something.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DialError {
    /// Token that would be sent unencrypted to another machine.
    #[error(
        "a token is not sent to {url}, which is on another machine and not encrypted: write https:// and give the CA with \
         --ca FILE, or do not give a token"
    )]
    PlainToken {
        /// Its address.
        url: String,
    },
    /// Missing CA for https.
    #[error(
        "{url} requires the CA certificate that signed the coordinator's certificate: give it with --ca FILE (`evogait \
         certs init` creates one)"
    )]
    NoAuthority {
        /// Its address.
        url: String,
    },
    /// Credentials that the TLS library refuses.
    #[error("can't connect to {url} with these certificates: {reason}")]
    Tls {
        /// Its address.
        url: String,
        /// Message of the TLS library.
        reason: String,
    },
}

impl Dial {
    /// Combines addresses and credentials. Does not connect.
    pub fn new(addresses: Addresses, credentials: &Credentials) -> Result<Self, DialError> {
        let endpoints = addresses.all().iter().map(|a| endpoint(a, credentials)).collect::<Result<_, _>>()?;
        let token = credentials.token.as_ref().map(|token| {
            let mut value: HeaderValue =
                format!("Bearer {}", token.reveal()).parse().expect("a token is visible ASCII");
            value.set_sensitive(true);
            value
        });
        Ok(Self { addresses, endpoints, token, current: Arc::new(AtomicUsize::new(0)) })
    }

    /// Sets the time between checks of idle connections, which is also the time limit for the answer. Default: 10 s.
    pub fn keepalive(mut self, period: Duration) -> Self {
        let checked = |e: &Endpoint| e.clone().http2_keep_alive_interval(period).keep_alive_timeout(period);
        self.endpoints = self.endpoints.iter().map(checked).collect();
        self
    }

    /// Returns the addresses.
    pub fn addresses(&self) -> &Addresses {
        &self.addresses
    }

    /// Returns the number of addresses.
    pub fn count(&self) -> usize {
        self.endpoints.len()
    }

    /// Returns the address that the next call uses.
    pub fn current(&self) -> &str {
        &self.addresses.all()[self.current.load(Ordering::Relaxed)].url
    }

    /// Creates a channel with its own connections, opened on first use. All channels of a `Dial` use the same current
    /// address.
    pub fn channel(&self) -> FailoverChannel {
        FailoverChannel::new(self)
    }

    /// Connects once, to the first address that accepts a connection, to detect early that no address does. The error
    /// is that of the last address.
    pub async fn reach(&self) -> Result<(), tonic::transport::Error> {
        let mut last = Ok(());
        for _ in 0..self.count() {
            let at = self.current.load(Ordering::Relaxed);
            last = self.endpoints[at].connect().await.map(drop);
            if last.is_ok() {
                break;
            }
            self.leave(at);
        }
        last
    }

    /// Switches from the address with this index, which does not serve, to the next, unless another call has done so
    /// before.
    fn leave(&self, at: usize) {
        let next = (at + 1) % self.count();
        // An error means that another call has switched already.
        let _ = self.current.compare_exchange(at, next, Ordering::Relaxed, Ordering::Relaxed);
    }
}

fn endpoint(address: &Address, credentials: &Credentials) -> Result<Endpoint, DialError> {
    let url = || address.url.clone();
    let failed = |e: tonic::transport::Error| DialError::Tls { url: url(), reason: reason(&e) };
    let endpoint = Endpoint::from_shared(url())
        .map_err(failed)?
        .connect_timeout(CONNECT_WITHIN)
        .tcp_nodelay(true)
        .http2_keep_alive_interval(KEEPALIVE)
        .keep_alive_timeout(KEEPALIVE)
        .keep_alive_while_idle(true);
    if !address.tls {
        if credentials.token.is_some() && !address.loopback {
            return Err(DialError::PlainToken { url: url() });
        }
        return Ok(endpoint);
    }
    let Some(ca) = &credentials.ca else {
        return Err(DialError::NoAuthority { url: url() });
    };
    crate::credentials::choose_provider();
    let mut tls = ClientTlsConfig::new().ca_certificate(ca.certificate.clone()).timeout(CONNECT_WITHIN);
    if let Some(identity) = &credentials.identity {
        tls = tls.identity(identity.identity.clone());
    }
    endpoint.tls_config(tls).map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::credentials::Token;

    #[test]
    fn unencrypted_address_of_other_machine_with_token_is_refused() {
        let token = Some(Token::parse("0123456789abcdef", "x").unwrap());
        let credentials = Credentials { token, ..Credentials::default() };
        let dial = |text: &str| Dial::new(text.parse().unwrap(), &credentials).map(|d| d.count());
        assert_eq!(dial("http://127.0.0.1:7077,http://[::1]:7077"), Ok(2));
        let url = "http://10.0.0.1:7077".to_owned();
        assert_eq!(dial("http://127.0.0.1:7077,http://10.0.0.1:7077"), Err(DialError::PlainToken { url }));
        let without = Dial::new("http://10.0.0.1:7077".parse().unwrap(), &Credentials::default());
        assert!(without.is_ok(), "without a token, http to another machine is allowed");
    }

    #[test]
    fn https_without_ca_is_refused() {
        let url = "https://127.0.0.1:7077".to_owned();
        let refused = Dial::new(url.parse().unwrap(), &Credentials::default()).unwrap_err();
        assert_eq!(refused, DialError::NoAuthority { url });
    }

    #[test]
    fn repeated_reports_of_one_address_switch_once() {
        let dial = Dial::new("http://a:1,http://b:1,http://c:1".parse().unwrap(), &Credentials::default()).unwrap();
        let other = dial.clone();
        dial.leave(0);
        other.leave(0);
        assert_eq!((dial.current(), other.current()), ("http://b:1", "http://b:1"));
        dial.leave(1);
        dial.leave(2);
        assert_eq!(other.current(), "http://a:1");
    }

    #[test]
    fn debug_output_of_dial_has_no_token() {
        let token = Some(Token::parse("correct-horse-battery", "x").unwrap());
        let dial = Dial::new("http://localhost:1".parse().unwrap(), &Credentials { token, ..Credentials::default() });
        assert!(!format!("{dial:?}").contains("horse"));
    }
}
