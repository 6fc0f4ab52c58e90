//! A network that can be spoilt: a TCP proxy between two processes.
//!
//! TCP itself neither loses, doubles nor reorders what gets through, so a bad network is one that is slow, stands still in
//! one direction or both, or ends connections. What stood still arrives once the direction is open again, as TCP's own
//! repetitions would bring it.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::watch;

/// Which way bytes go.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From those who dialed the proxy to where it leads.
    Up,
    /// Back.
    Down,
}

/// How it is today.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Weather {
    /// Bytes stand still on their way up.
    pub up_blocked: bool,
    /// Bytes stand still on their way down.
    pub down_blocked: bool,
    /// Added to each piece of data, either way.
    pub delay: Duration,
    /// Bytes a second and connection, either way; 0: as many as there are.
    pub bytes_per_second: u32,
    /// Counts the times that all connections were cut.
    cuts: u64,
    /// Connections made before this many were accepted bring nothing any more.
    lost_before: u64,
}

impl Weather {
    fn is_blocked(&self, direction: Direction, connection: u64) -> bool {
        let blocked = match direction {
            Direction::Up => self.up_blocked,
            Direction::Down => self.down_blocked,
        };
        blocked || connection < self.lost_before
    }
}

/// The proxy. Lives on a thread of its own, so that a test may block.
pub struct Proxy {
    address: SocketAddr,
    weather: watch::Sender<Weather>,
    /// Counts the connections.
    accepted: Arc<AtomicU64>,
    /// Dropped in the background: a test's own runtime may be around it.
    runtime: Option<Runtime>,
}

impl Proxy {
    /// A proxy that leads to an address, in good weather.
    pub fn to(upstream: &str) -> Self {
        let upstream: Arc<str> = upstream.trim_start_matches("http://").into();
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build().expect("a runtime");
        let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a free port");
        listener.set_nonblocking(true).expect("a socket can be set");
        let address = listener.local_addr().expect("it has an address");
        let (weather, watching) = watch::channel(Weather::default());
        let accepted = Arc::<AtomicU64>::default();
        let counter = accepted.clone();
        runtime.spawn(async move {
            let listener = TcpListener::from_std(listener).expect("a listener");
            while let Ok((near, _)) = listener.accept().await {
                let connection = counter.fetch_add(1, Ordering::Relaxed);
                tokio::spawn(serve(connection, near, upstream.clone(), watching.clone()));
            }
        });
        Self { address, weather, accepted, runtime: Some(runtime) }
    }

    /// Where to dial.
    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// The port to dial, on loopback.
    pub fn port(&self) -> u16 {
        self.address.port()
    }

    /// Stops a direction, or lets it go on with all that has waited.
    pub fn block(&self, direction: Direction, blocked: bool) {
        self.weather.send_modify(|weather| match direction {
            Direction::Up => weather.up_blocked = blocked,
            Direction::Down => weather.down_blocked = blocked,
        });
    }

    /// Slows everything down.
    pub fn slow(&self, delay: Duration, bytes_per_second: u32) {
        self.weather.send_modify(|weather| (weather.delay, weather.bytes_per_second) = (delay, bytes_per_second));
    }

    /// Connections that stand bring nothing any more, and nobody is told; new ones are not touched.
    pub fn lose(&self) {
        let accepted = self.accepted.load(Ordering::Relaxed);
        self.weather.send_modify(|weather| weather.lost_before = accepted);
    }

    /// Ends all connections that stand.
    pub fn cut(&self) {
        self.weather.send_modify(|weather| weather.cuts += 1);
    }

    /// Good weather again; connections that stand go on, but for those that are lost.
    pub fn heal(&self) {
        self.weather.send_modify(|weather| {
            *weather = Weather { cuts: weather.cuts, lost_before: weather.lost_before, ..Weather::default() };
        });
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

/// One connection, until a side ends it or it is cut.
async fn serve(connection: u64, near: TcpStream, upstream: Arc<str>, weather: watch::Receiver<Weather>) {
    let cuts = weather.borrow().cuts;
    let Ok(far) = TcpStream::connect(&*upstream).await else { return };
    // Without it a small message would wait for the acknowledgement of the one before.
    let (Ok(()), Ok(())) = (near.set_nodelay(true), far.set_nodelay(true)) else { return };
    let ((near_read, near_write), (far_read, far_write)) = (near.into_split(), far.into_split());
    let mut cut = weather.clone();
    tokio::select! {
        // First: what stands still does not slip through when a connection is cut and the weather gets better at once.
        biased;
        _ = cut.wait_for(|weather| weather.cuts != cuts) => {}
        () = pass(near_read, far_write, weather.clone(), Direction::Up, connection) => {}
        () = pass(far_read, near_write, weather, Direction::Down, connection) => {}
    }
}

async fn pass(
    mut from: OwnedReadHalf,
    mut to: OwnedWriteHalf,
    mut weather: watch::Receiver<Weather>,
    direction: Direction,
    connection: u64,
) {
    let mut buffer = [0; 16 * 1024];
    while let Ok(count @ 1..) = from.read(&mut buffer).await {
        let Weather { delay, bytes_per_second, .. } = *weather.borrow();
        let rate = Duration::from_secs(count as u64).checked_div(bytes_per_second).unwrap_or_default();
        if delay + rate > Duration::ZERO {
            tokio::time::sleep(delay + rate).await;
        }
        // The proxy is gone if nobody makes the weather any more.
        if weather.wait_for(|weather| !weather.is_blocked(direction, connection)).await.is_err()
            || to.write_all(&buffer[..count]).await.is_err()
        {
            return;
        }
    }
}
