//! Listening socket with limits on connections and on the time that a connection may stay unauthenticated.
//!
//! A connection is unauthenticated until a call on it is permitted. The time limit covers the TLS handshake, too: an
//! idle connection is closed after [`AUTHENTICATE_WITHIN`], in any phase.

use crate::limits::{
    AUTHENTICATE_WITHIN, MAX_CONNECTIONS, MAX_CONNECTIONS_OF_ADDRESS, MAX_SCALER_CONNECTIONS, MAX_UNAUTHENTICATED,
    MAX_UNAUTHENTICATED_OF_ADDRESS,
};
use crate::log_limit::LogLimit;
use prometheus_client::metrics::gauge::Gauge;
use std::collections::HashMap;
use std::io;
use std::net::{IpAddr, Ipv6Addr, SocketAddr};
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::Sleep;
use tokio_stream::Stream;
use tonic::transport::server::{Connected, TcpConnectInfo, TlsConnectInfo};

/// Pause after a failed accept, such as one for lack of file descriptors.
const REST: Duration = Duration::from_millis(100);

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Count {
    all: usize,
    unauthenticated: usize,
}

#[derive(Debug, Default)]
struct Counts {
    total: Count,
    by_address: HashMap<IpAddr, Count>,
    /// Total, as a metric.
    told: Gauge,
}

/// Limit with its name.
type Limit = (usize, &'static str);

/// Limits on connections to one listener.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Admission {
    all: Limit,
    of_address: Limit,
    /// Limits on unauthenticated connections, in total and per address; `None` if calls need no token.
    unauthenticated: Option<(Limit, Limit)>,
    /// Time that a connection may stay unauthenticated.
    patience: Duration,
}

impl Admission {
    /// Limits for the services of clients and workers. `tokens` is true if calls require tokens.
    pub fn of_service(tokens: bool) -> Self {
        let unauthenticated = (
            (MAX_UNAUTHENTICATED, "MAX_UNAUTHENTICATED"),
            (MAX_UNAUTHENTICATED_OF_ADDRESS, "MAX_UNAUTHENTICATED_OF_ADDRESS"),
        );
        Self {
            all: (MAX_CONNECTIONS, "MAX_CONNECTIONS"),
            of_address: (MAX_CONNECTIONS_OF_ADDRESS, "MAX_CONNECTIONS_OF_ADDRESS"),
            unauthenticated: tokens.then_some(unauthenticated),
            patience: AUTHENTICATE_WITHIN,
        }
    }

    /// Limits for the external scaler for KEDA.
    pub fn of_scaler() -> Self {
        let most = (MAX_SCALER_CONNECTIONS, "MAX_SCALER_CONNECTIONS");
        Self { all: most, of_address: most, unauthenticated: None, patience: AUTHENTICATE_WITHIN }
    }
}

/// Returns the network that counts as one address: for IPv6 the /64 prefix, since one machine usually has a whole /64
/// network.
fn network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) => IpAddr::V6(Ipv6Addr::from_bits(v6.to_bits() >> 64 << 64)),
        v4 => v4,
    }
}

impl Counts {
    /// Counts a new connection, or returns the name of the limit that is reached. The total limit on unauthenticated
    /// connections does not apply to loopback: local health checks must get through.
    fn enter(&mut self, address: IpAddr, admission: &Admission) -> Result<(), &'static str> {
        let of_address = self.by_address.get(&address).copied().unwrap_or_default();
        let below = |count: usize, (most, name): Limit| if count < most { Ok(()) } else { Err(name) };
        below(self.total.all, admission.all)?;
        below(of_address.all, admission.of_address)?;
        if let Some((in_all, of_one)) = admission.unauthenticated {
            if !address.is_loopback() {
                below(self.total.unauthenticated, in_all)?;
            }
            below(of_address.unauthenticated, of_one)?;
        }
        for count in [&mut self.total, self.by_address.entry(address).or_default()] {
            count.all += 1;
            count.unauthenticated += 1;
        }
        self.told.inc();
        Ok(())
    }

    fn known(&mut self, address: IpAddr) {
        self.total.unauthenticated -= 1;
        if let Some(count) = self.by_address.get_mut(&address) {
            count.unauthenticated -= 1;
        }
    }

    fn leave(&mut self, address: IpAddr, known: bool) {
        let unauthenticated = usize::from(!known);
        self.total.all -= 1;
        self.total.unauthenticated -= unauthenticated;
        self.told.dec();
        if let Some(count) = self.by_address.get_mut(&address) {
            count.all -= 1;
            count.unauthenticated -= unauthenticated;
            if count.all == 0 {
                self.by_address.remove(&address);
            }
        }
    }
}

/// Stream of accepted connections.
pub(crate) struct Listener {
    listener: TcpListener,
    counts: Arc<Mutex<Counts>>,
    admission: Admission,
    rest: Option<Pin<Box<Sleep>>>,
    told: LogLimit,
}

impl Listener {
    /// Creates the stream. `connections` is the gauge of open connections.
    pub fn new(listener: TcpListener, admission: Admission, connections: Gauge) -> Self {
        let counts = Arc::new(Mutex::new(Counts { told: connections, ..Counts::default() }));
        let told = LogLimit::default();
        Self { listener, counts, admission, rest: None, told }
    }

    fn admit(&self, io: TcpStream, peer: SocketAddr) -> Option<Guest> {
        let entered = lock(&self.counts).enter(network(peer.ip()), &self.admission);
        if let Err(limit) = entered {
            if let Some(others) = self.told.now() {
                tracing::warn!(%peer, limit, others, "connection refused: a limit is reached");
            }
            return None;
        }
        // Without this option calls are slower, but they work.
        let _ = io.set_nodelay(true);
        let visit = Arc::new(VisitState { peer, counts: self.counts.clone(), known: AtomicBool::new(false) });
        Some(Guest { io, visit: Visit(visit), patience: Some(Box::pin(tokio::time::sleep(self.admission.patience))) })
    }
}

impl Stream for Listener {
    /// Never an error: a failed accept is repeated after a pause.
    type Item = Result<Guest, io::Error>;

    fn poll_next(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        loop {
            if let Some(rest) = &mut self.rest {
                std::task::ready!(rest.as_mut().poll(cx));
                self.rest = None;
            }
            match std::task::ready!(self.listener.poll_accept(cx)) {
                Ok((io, peer)) => {
                    if let Some(guest) = self.admit(io, peer) {
                        return Poll::Ready(Some(Ok(guest)));
                    }
                }
                Err(error) => {
                    if let Some(others) = self.told.now() {
                        tracing::error!(%error, others, "can't accept connections: check the limit on open files");
                    }
                    self.rest = Some(Box::pin(tokio::time::sleep(REST)));
                }
            }
        }
    }
}

#[derive(Debug)]
struct VisitState {
    peer: SocketAddr,
    counts: Arc<Mutex<Counts>>,
    known: AtomicBool,
}

/// Connection, as seen by the calls on it.
#[derive(Clone, Debug)]
pub(crate) struct Visit(Arc<VisitState>);

impl Visit {
    /// Returns the connection of a request.
    pub fn of(extensions: &http::Extensions) -> Option<&Self> {
        extensions.get::<Self>().or_else(|| extensions.get::<TlsConnectInfo<Self>>().map(TlsConnectInfo::get_ref))
    }

    /// Address of the peer.
    pub fn peer(&self) -> SocketAddr {
        self.0.peer
    }

    /// Marks the connection as authenticated: a call on it was permitted.
    pub fn is_known(&self) {
        if !self.0.known.load(Ordering::Relaxed) {
            let mut counts = lock(&self.0.counts);
            if !self.0.known.swap(true, Ordering::Relaxed) {
                counts.known(network(self.0.peer.ip()));
            }
        }
    }
}

/// Adds the peer's address to a request, for tonic's `remote_addr`.
pub(crate) fn introduce<B>(mut request: http::Request<B>) -> http::Request<B> {
    let peer = Visit::of(request.extensions()).map(Visit::peer);
    request.extensions_mut().insert(TcpConnectInfo { local_addr: None, remote_addr: peer });
    request
}

/// Marks the connection of each request as authenticated, for services without tokens.
pub(crate) fn know<B>(request: http::Request<B>) -> http::Request<B> {
    if let Some(visit) = Visit::of(request.extensions()) {
        visit.is_known();
    }
    request
}

/// Accepted connection.
pub(crate) struct Guest {
    io: TcpStream,
    visit: Visit,
    /// Timer for an unauthenticated connection.
    patience: Option<Pin<Box<Sleep>>>,
}

impl Drop for Guest {
    fn drop(&mut self) {
        let state = &self.visit.0;
        let mut counts = lock(&state.counts);
        // From here on the connection is not counted again, though calls on it may still be ending.
        let known = state.known.swap(true, Ordering::Relaxed);
        counts.leave(network(state.peer.ip()), known);
    }
}

impl Connected for Guest {
    type ConnectInfo = Visit;

    fn connect_info(&self) -> Visit {
        self.visit.clone()
    }
}

impl AsyncRead for Guest {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        if let Some(patience) = &mut self.patience
            && patience.as_mut().poll(cx).is_ready()
        {
            if !self.visit.0.known.load(Ordering::Relaxed) {
                return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
            }
            self.patience = None;
        }
        Pin::new(&mut self.io).poll_read(cx, buffer)
    }
}

impl AsyncWrite for Guest {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.io).poll_write(cx, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.io).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.io).poll_shutdown(cx)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.io).poll_write_vectored(cx, slices)
    }

    fn is_write_vectored(&self) -> bool {
        self.io.is_write_vectored()
    }
}

fn lock(counts: &Mutex<Counts>) -> MutexGuard<'_, Counts> {
    counts.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;
    use tokio::io::AsyncReadExt as _;
    use tokio_stream::StreamExt as _;

    const A: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 1));
    const LOCAL: IpAddr = IpAddr::V4(std::net::Ipv4Addr::LOCALHOST);

    fn other(n: u32) -> IpAddr {
        IpAddr::V4(std::net::Ipv4Addr::from_bits(n))
    }

    #[test]
    fn connection_limits_hold_per_address_and_in_total() {
        let mut counts = Counts::default();
        let guarded = Admission::of_service(true);
        for _ in 0..MAX_UNAUTHENTICATED_OF_ADDRESS {
            assert_eq!(counts.enter(A, &guarded), Ok(()));
        }
        assert_eq!(counts.enter(A, &guarded), Err("MAX_UNAUTHENTICATED_OF_ADDRESS"));
        counts.known(A);
        assert_eq!(counts.enter(A, &guarded), Ok(()), "an authenticated connection frees a place");
        for n in 0.. {
            if let Err(limit) = counts.enter(other(n), &guarded) {
                assert_eq!((limit, counts.total.unauthenticated), ("MAX_UNAUTHENTICATED", MAX_UNAUTHENTICATED));
                break;
            }
        }
        assert_eq!(counts.enter(LOCAL, &guarded), Ok(()), "a local health check is still admitted");
        let (mut open, admission) = (Counts::default(), Admission::of_service(false));
        while open.enter(A, &admission).is_ok() {}
        assert_eq!(open.total.all, MAX_CONNECTIONS_OF_ADDRESS);
        for n in 0.. {
            if let Err(limit) = open.enter(other(n), &admission) {
                assert_eq!((limit, open.total.all), ("MAX_CONNECTIONS", MAX_CONNECTIONS));
                break;
            }
        }
    }

    #[test]
    fn ipv6_network_counts_as_one_address() {
        let same = |a: &str, b: &str| network(a.parse().unwrap()) == network(b.parse().unwrap());
        assert!(same("2001:db8::1", "2001:db8::ffff:0:0:1") && !same("2001:db8::1", "2001:db8:0:1::1"));
        assert!(same("::ffff:10.0.0.1", "10.0.0.1") && !same("10.0.0.1", "10.0.0.2"));
    }

    #[test]
    fn closed_connection_is_not_counted() {
        let mut counts = Counts::default();
        for _ in 0..3 {
            counts.enter(A, &Admission::of_service(true)).unwrap();
        }
        counts.known(A);
        counts.leave(A, true);
        assert_eq!((counts.total, counts.told.get()), (Count { all: 2, unauthenticated: 2 }, 2));
        counts.leave(A, false);
        counts.leave(A, false);
        assert_eq!((counts.total, counts.told.get()), (Count::default(), 0));
        assert!(counts.by_address.is_empty(), "addresses without connections are removed");
    }

    /// Opens a connection. Returns the listener, the client's end and the accepted connection.
    async fn visit(patience: Duration) -> (Listener, TcpStream, Guest) {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let admission = Admission { patience, ..Admission::of_service(true) };
        let mut listener = Listener::new(listener, admission, Gauge::default());
        let (client, guest) = tokio::join!(TcpStream::connect(address), listener.next());
        let guest = guest.unwrap().unwrap();
        (listener, client.unwrap(), guest)
    }

    #[tokio::test]
    async fn idle_connection_is_closed_unless_authenticated() {
        let patience = Duration::from_millis(50);
        let (listener, _client, mut guest) = visit(patience).await;
        let start = Instant::now();
        assert_eq!(guest.read_u8().await.unwrap_err().kind(), io::ErrorKind::TimedOut);
        assert!(start.elapsed() >= patience / 2);
        drop(guest);
        assert_eq!(lock(&listener.counts).total, Count::default());

        let (listener, _client, mut guest) = visit(patience).await;
        guest.visit.is_known();
        guest.visit.is_known();
        assert_eq!(lock(&listener.counts).total, Count { all: 1, unauthenticated: 0 });
        assert!(tokio::time::timeout(4 * patience, guest.read_u8()).await.is_err(), "it stays open");
        let visit = guest.visit.clone();
        drop(guest);
        visit.is_known();
        assert_eq!(lock(&listener.counts).total, Count::default());
    }
}
