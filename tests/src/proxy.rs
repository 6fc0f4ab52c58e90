//! TCP proxy between two processes that can disturb the connection.
//!
//! TCP does not lose, duplicate or reorder data. A bad network is therefore one that is slow, blocks one direction or
//! both, or ends connections. Blocked data arrives once the direction is open again, as after TCP's own
//! retransmissions.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::watch;

/// Direction of data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the client that dialed the proxy to the upstream server.
    Up,
    /// From the upstream server to the client.
    Down,
}

/// State of the simulated network.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NetworkState {
    /// Data from the client is held back.
    pub up_blocked: bool,
    /// Data to the client is held back.
    pub down_blocked: bool,
    /// Delay of each piece of data in either direction.
    pub delay: Duration,
    /// Bytes per second of each connection in either direction; 0: unlimited.
    pub bytes_per_second: u32,
    /// Number of times that all connections were cut.
    cuts: u64,
    /// Number of lost connections: the ones accepted before this count transmit nothing.
    lost_before: u64,
}

impl NetworkState {
    fn is_blocked(&self, direction: Direction, connection: u64) -> bool {
        let blocked = match direction {
            Direction::Up => self.up_blocked,
            Direction::Down => self.down_blocked,
        };
        blocked || connection < self.lost_before
    }
}

/// TCP proxy. Runs on its own thread, so that a test may block.
pub struct Proxy {
    address: SocketAddr,
    weather: watch::Sender<NetworkState>,
    /// Number of accepted connections.
    accepted: Arc<AtomicU64>,
    /// Shut down in the background on drop, because a test may drop the proxy inside its own runtime.
    runtime: Option<Runtime>,
}

impl Proxy {
    /// Starts an undisturbed proxy to an address.
    pub fn to(upstream: &str) -> Self {
        let upstream: Arc<str> = upstream.trim_start_matches("http://").into();
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build().expect("the runtime starts");
        let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a free port");
        listener.set_nonblocking(true).expect("the socket can be made non-blocking");
        let address = listener.local_addr().expect("a bound socket has an address");
        let (weather, watching) = watch::channel(NetworkState::default());
        let accepted = Arc::<AtomicU64>::default();
        let counter = accepted.clone();
        runtime.spawn(async move {
            let listener = TcpListener::from_std(listener).expect("the listener can be registered with tokio");
            while let Ok((near, _)) = listener.accept().await {
                let connection = counter.fetch_add(1, Ordering::Relaxed);
                tokio::spawn(serve(connection, near, upstream.clone(), watching.clone()));
            }
        });
        Self { address, weather, accepted, runtime: Some(runtime) }
    }

    /// Returns the URL to dial.
    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Returns the port to dial, on loopback.
    pub fn port(&self) -> u16 {
        self.address.port()
    }

    /// Blocks a direction, or opens it and delivers the data that was held back.
    pub fn block(&self, direction: Direction, blocked: bool) {
        self.weather.send_modify(|weather| match direction {
            Direction::Up => weather.up_blocked = blocked,
            Direction::Down => weather.down_blocked = blocked,
        });
    }

    /// Delays all data and limits the rate.
    pub fn slow(&self, delay: Duration, bytes_per_second: u32) {
        self.weather.send_modify(|weather| (weather.delay, weather.bytes_per_second) = (delay, bytes_per_second));
    }

    /// Silently stops all data on existing connections, without closing them. New connections are unaffected.
    pub fn lose(&self) {
        let accepted = self.accepted.load(Ordering::Relaxed);
        self.weather.send_modify(|weather| weather.lost_before = accepted);
    }

    /// Ends all existing connections.
    pub fn cut(&self) {
        self.weather.send_modify(|weather| weather.cuts += 1);
    }

    /// Ends all disturbances. Existing connections continue, except lost ones.
    pub fn heal(&self) {
        self.weather.send_modify(|weather| {
            *weather = NetworkState { cuts: weather.cuts, lost_before: weather.lost_before, ..NetworkState::default() };
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

/// Serves one connection until a side ends it or it is cut.
async fn serve(connection: u64, near: TcpStream, upstream: Arc<str>, weather: watch::Receiver<NetworkState>) {
    let cuts = weather.borrow().cuts;
    let Ok(far) = TcpStream::connect(&*upstream).await else { return };
    // Without it a small message would wait for the acknowledgement of the one before.
    let (Ok(()), Ok(())) = (near.set_nodelay(true), far.set_nodelay(true)) else { return };
    let ((near_read, near_write), (far_read, far_write)) = (near.into_split(), far.into_split());
    let mut cut = weather.clone();
    tokio::select! {
        // Cuts are checked first: otherwise blocked data could pass if the connection is cut and the block ends at
        // once.
        biased;
        _ = cut.wait_for(|weather| weather.cuts != cuts) => {}
        () = pass(near_read, far_write, weather.clone(), Direction::Up, connection) => {}
        () = pass(far_read, near_write, weather, Direction::Down, connection) => {}
    }
}

async fn pass(
    mut from: OwnedReadHalf,
    mut to: OwnedWriteHalf,
    mut weather: watch::Receiver<NetworkState>,
    direction: Direction,
    connection: u64,
) {
    let mut buffer = [0; 16 * 1024];
    while let Ok(count @ 1..) = from.read(&mut buffer).await {
        let NetworkState { delay, bytes_per_second, .. } = *weather.borrow();
        let rate = Duration::from_secs(count as u64).checked_div(bytes_per_second).unwrap_or_default();
        if delay + rate > Duration::ZERO {
            tokio::time::sleep(delay + rate).await;
        }
        // An error means that the proxy was dropped.
        if weather.wait_for(|weather| !weather.is_blocked(direction, connection)).await.is_err()
            || to.write_all(&buffer[..count]).await.is_err()
        {
            return;
        }
    }
}
