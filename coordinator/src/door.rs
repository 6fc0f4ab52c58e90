//! The listening socket: how many connections there may be, and how long one may stay that nobody vouches for.
//!
//! A connection is a stranger's until a call on it was admitted. It covers the TLS handshake, too: whoever says nothing
//! is gone after [`STRANGER_WITHIN`], whichever part is missing.

use crate::limits::{
    MAX_CONNECTIONS, MAX_CONNECTIONS_OF_ADDRESS, MAX_SCALER_CONNECTIONS, MAX_STRANGERS, MAX_STRANGERS_OF_ADDRESS,
    STRANGER_WITHIN,
};
use crate::seldom::Seldom;
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

/// After a failed accept, such as for want of file descriptors, wait this long.
const REST: Duration = Duration::from_millis(100);

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Count {
    all: usize,
    strangers: usize,
}

#[derive(Debug, Default)]
struct Counts {
    total: Count,
    by_address: HashMap<IpAddr, Count>,
    /// The total, for whoever watches.
    told: Gauge,
}

/// A limit and its name.
type Limit = (usize, &'static str);

/// Who may come in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Admission {
    all: Limit,
    of_address: Limit,
    /// Of those on which no call was admitted, in all and from one address; `None` where whoever calls is welcome.
    strangers: Option<(Limit, Limit)>,
    /// How long a stranger may stay.
    patience: Duration,
}

impl Admission {
    /// To the services of clients and workers. `tokens`: whether calls need them.
    pub fn of_service(tokens: bool) -> Self {
        let strangers = ((MAX_STRANGERS, "MAX_STRANGERS"), (MAX_STRANGERS_OF_ADDRESS, "MAX_STRANGERS_OF_ADDRESS"));
        Self {
            all: (MAX_CONNECTIONS, "MAX_CONNECTIONS"),
            of_address: (MAX_CONNECTIONS_OF_ADDRESS, "MAX_CONNECTIONS_OF_ADDRESS"),
            strangers: tokens.then_some(strangers),
            patience: STRANGER_WITHIN,
        }
    }

    /// To where KEDA is answered.
    pub fn of_scaler() -> Self {
        let most = (MAX_SCALER_CONNECTIONS, "MAX_SCALER_CONNECTIONS");
        Self { all: most, of_address: most, strangers: None, patience: STRANGER_WITHIN }
    }
}

/// What counts as one address: of IPv6 a network of 64 bits, since that is what one machine is given.
fn network(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(v6) => IpAddr::V6(Ipv6Addr::from_bits(v6.to_bits() >> 64 << 64)),
        v4 => v4,
    }
}

impl Counts {
    /// Counts a stranger in, or says which limit is reached. The machine itself always finds a place among the strangers: it
    /// asks how the coordinator is.
    fn enter(&mut self, address: IpAddr, admission: &Admission) -> Result<(), &'static str> {
        let of_address = self.by_address.get(&address).copied().unwrap_or_default();
        let below = |count: usize, (most, name): Limit| if count < most { Ok(()) } else { Err(name) };
        below(self.total.all, admission.all)?;
        below(of_address.all, admission.of_address)?;
        if let Some((in_all, of_one)) = admission.strangers {
            if !address.is_loopback() {
                below(self.total.strangers, in_all)?;
            }
            below(of_address.strangers, of_one)?;
        }
        for count in [&mut self.total, self.by_address.entry(address).or_default()] {
            count.all += 1;
            count.strangers += 1;
        }
        self.told.inc();
        Ok(())
    }

    fn known(&mut self, address: IpAddr) {
        self.total.strangers -= 1;
        if let Some(count) = self.by_address.get_mut(&address) {
            count.strangers -= 1;
        }
    }

    fn leave(&mut self, address: IpAddr, known: bool) {
        let strangers = usize::from(!known);
        self.total.all -= 1;
        self.total.strangers -= strangers;
        self.told.dec();
        if let Some(count) = self.by_address.get_mut(&address) {
            count.all -= 1;
            count.strangers -= strangers;
            if count.all == 0 {
                self.by_address.remove(&address);
            }
        }
    }
}

/// The stream of connections that are let in.
pub(crate) struct Door {
    listener: TcpListener,
    counts: Arc<Mutex<Counts>>,
    admission: Admission,
    rest: Option<Pin<Box<Sleep>>>,
    told: Seldom,
}

impl Door {
    /// `connections` counts who is in.
    pub fn new(listener: TcpListener, admission: Admission, connections: Gauge) -> Self {
        let counts = Arc::new(Mutex::new(Counts { told: connections, ..Counts::default() }));
        let told = Seldom::default();
        Self { listener, counts, admission, rest: None, told }
    }

    fn admit(&self, io: TcpStream, peer: SocketAddr) -> Option<Guest> {
        let entered = lock(&self.counts).enter(network(peer.ip()), &self.admission);
        if let Err(limit) = entered {
            if let Some(others) = self.told.now() {
                tracing::warn!(%peer, limit, others, "a connection was refused: there are too many");
            }
            return None;
        }
        // Without it calls are slower, that is all.
        let _ = io.set_nodelay(true);
        let visit = Arc::new(VisitState { peer, counts: self.counts.clone(), known: AtomicBool::new(false) });
        Some(Guest { io, visit: Visit(visit), patience: Some(Box::pin(tokio::time::sleep(self.admission.patience))) })
    }
}

impl Stream for Door {
    /// Never an error: a listener that can't accept right now is asked again later.
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
                        tracing::error!(%error, others, "can't accept connections: is the limit of open files too low?");
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

/// A connection as the calls on it see it.
#[derive(Clone, Debug)]
pub(crate) struct Visit(Arc<VisitState>);

impl Visit {
    /// That of a request.
    pub fn of(extensions: &http::Extensions) -> Option<&Self> {
        extensions.get::<Self>().or_else(|| extensions.get::<TlsConnectInfo<Self>>().map(TlsConnectInfo::get_ref))
    }

    /// The other side's address.
    pub fn peer(&self) -> SocketAddr {
        self.0.peer
    }

    /// A call was admitted: the connection may stay.
    pub fn is_known(&self) {
        if !self.0.known.load(Ordering::Relaxed) {
            let mut counts = lock(&self.0.counts);
            if !self.0.known.swap(true, Ordering::Relaxed) {
                counts.known(network(self.0.peer.ip()));
            }
        }
    }
}

/// Tells whoever asks tonic for the other side's address.
pub(crate) fn introduce<B>(mut request: http::Request<B>) -> http::Request<B> {
    let peer = Visit::of(request.extensions()).map(Visit::peer);
    request.extensions_mut().insert(TcpConnectInfo { local_addr: None, remote_addr: peer });
    request
}

/// Whoever calls is known: for services without tokens.
pub(crate) fn know<B>(request: http::Request<B>) -> http::Request<B> {
    if let Some(visit) = Visit::of(request.extensions()) {
        visit.is_known();
    }
    request
}

/// A connection that was let in.
pub(crate) struct Guest {
    io: TcpStream,
    visit: Visit,
    /// Until when a stranger may stay.
    patience: Option<Pin<Box<Sleep>>>,
}

impl Drop for Guest {
    fn drop(&mut self) {
        let state = &self.visit.0;
        let mut counts = lock(&state.counts);
        // From now on nothing more is counted for it, though calls on it may still be ending.
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
    fn one_address_can_not_take_all_connections_nor_strangers_the_places_of_the_known() {
        let mut counts = Counts::default();
        let guarded = Admission::of_service(true);
        for _ in 0..MAX_STRANGERS_OF_ADDRESS {
            assert_eq!(counts.enter(A, &guarded), Ok(()));
        }
        assert_eq!(counts.enter(A, &guarded), Err("MAX_STRANGERS_OF_ADDRESS"));
        counts.known(A);
        assert_eq!(counts.enter(A, &guarded), Ok(()), "the known leave their place to the next");
        for n in 0.. {
            if let Err(limit) = counts.enter(other(n), &guarded) {
                assert_eq!((limit, counts.total.strangers), ("MAX_STRANGERS", MAX_STRANGERS));
                break;
            }
        }
        assert_eq!(counts.enter(LOCAL, &guarded), Ok(()), "the machine itself can still ask how it is");
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
    fn a_machine_with_many_addresses_counts_as_one() {
        let same = |a: &str, b: &str| network(a.parse().unwrap()) == network(b.parse().unwrap());
        assert!(same("2001:db8::1", "2001:db8::ffff:0:0:1") && !same("2001:db8::1", "2001:db8:0:1::1"));
        assert!(same("::ffff:10.0.0.1", "10.0.0.1") && !same("10.0.0.1", "10.0.0.2"));
    }

    #[test]
    fn who_leaves_is_counted_no_more() {
        let mut counts = Counts::default();
        for _ in 0..3 {
            counts.enter(A, &Admission::of_service(true)).unwrap();
        }
        counts.known(A);
        counts.leave(A, true);
        assert_eq!((counts.total, counts.told.get()), (Count { all: 2, strangers: 2 }, 2));
        counts.leave(A, false);
        counts.leave(A, false);
        assert_eq!((counts.total, counts.told.get()), (Count::default(), 0));
        assert!(counts.by_address.is_empty(), "addresses that went take no memory");
    }

    /// A connection and the guest it became.
    async fn visit(patience: Duration) -> (Door, TcpStream, Guest) {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let admission = Admission { patience, ..Admission::of_service(true) };
        let mut door = Door::new(listener, admission, Gauge::default());
        let (client, guest) = tokio::join!(TcpStream::connect(address), door.next());
        let guest = guest.unwrap().unwrap();
        (door, client.unwrap(), guest)
    }

    #[tokio::test]
    async fn a_stranger_that_says_nothing_is_gone_in_time_and_the_known_stay() {
        let patience = Duration::from_millis(50);
        let (door, _client, mut guest) = visit(patience).await;
        let start = Instant::now();
        assert_eq!(guest.read_u8().await.unwrap_err().kind(), io::ErrorKind::TimedOut);
        assert!(start.elapsed() >= patience / 2);
        drop(guest);
        assert_eq!(lock(&door.counts).total, Count::default());

        let (door, _client, mut guest) = visit(patience).await;
        guest.visit.is_known();
        guest.visit.is_known();
        assert_eq!(lock(&door.counts).total, Count { all: 1, strangers: 0 });
        assert!(tokio::time::timeout(4 * patience, guest.read_u8()).await.is_err(), "it waits on");
        let visit = guest.visit.clone();
        drop(guest);
        visit.is_known();
        assert_eq!(lock(&door.counts).total, Count::default());
    }
}
