//! Coordinator in a process of its own, so that its CPU time and memory are measured apart from those of the workers.

use super::scrape::{Numbers, scrape};
use crate::client::Url;
use crate::error::Error;
use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// Unit of CPU time in /proc: a hundredth of a second on all Linux systems.
const TICK: Duration = Duration::from_millis(10);

/// Process of the measured coordinator.
pub struct Host {
    child: Child,
    metrics: SocketAddr,
    /// Address on which the coordinator listens.
    pub url: Url,
}

impl Host {
    /// Starts this program again as a coordinator with its store in `folder`.
    pub fn start(folder: &Path) -> Result<Self, Error> {
        let failed = |reason: String| Error::LocalCoordinator { reason };
        let program = std::env::current_exe().map_err(|e| failed(e.to_string()))?;
        let mut command = Command::new(program);
        command
            .args(["bench", "fleet", "quadropod-quick", "--host"])
            .arg(folder)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        let mut child = command.spawn().map_err(|e| failed(e.to_string()))?;
        let mut line = String::new();
        if let Some(stdout) = child.stdout.take() {
            BufReader::new(stdout).read_line(&mut line).map_err(|e| failed(e.to_string()))?;
        }
        let addresses = line.trim().split_once(' ').and_then(|(a, m)| Some((a.parse().ok()?, m.parse().ok()?)));
        let (address, metrics) =
            addresses.ok_or_else(|| failed("the coordinator process did not print its addresses".to_owned()))?;
        Ok(Self { child, metrics, url: Url::of_socket(address) })
    }

    /// Returns the CPU time of the process so far, or zero if the system does not report it.
    pub fn cpu(&self) -> Duration {
        cpu(&self.child.id().to_string())
    }

    /// Returns the peak resident set of the process so far, MiB.
    pub fn peak_mib(&self) -> Option<f64> {
        super::super::dispatch::peak_mib(&self.child.id().to_string())
    }

    /// Reads the coordinator's metrics.
    pub async fn numbers(&self) -> Result<Numbers, Error> {
        scrape(self.metrics).await.map_err(|e| Error::LocalCoordinator { reason: format!("no metrics: {e}") })
    }
}

impl Drop for Host {
    fn drop(&mut self) {
        // Best effort: the process serves only this measurement, and may already have exited.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Returns the CPU time of a process (`self` is this one), or zero if the system does not report it.
pub fn cpu(process: &str) -> Duration {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).unwrap_or_default();
    // Fields after the name, which may contain any character: state, ten numbers, user time, system time.
    let fields = stat.rsplit_once(") ").map_or("", |(_, fields)| fields);
    let ticks = fields.split(' ').skip(11).take(2).filter_map(|ticks| ticks.parse::<u32>().ok());
    TICK * ticks.sum()
}

/// Runs the coordinator until its standard input is closed.
pub async fn serve(folder: PathBuf) -> Result<(), Error> {
    let failed = |e: coordinator::Error| Error::LocalCoordinator { reason: e.to_string() };
    #[cfg(unix)]
    coordinator::open_files::raise();
    let store = coordinator::StoreUrl::Sqlite(folder.join("store.sqlite"));
    let metrics = telemetry::Bind { addr: SocketAddr::from(([127, 0, 0, 1], 0)), beyond_loopback: false };
    let config = coordinator::Config { metrics: Some(metrics), ..coordinator::Config::embedded(store) };
    let mut running = coordinator::serve(config).await.map_err(failed)?;
    if let Some(metrics) = running.metrics_addr() {
        // Best effort: if the reader is gone, the addresses are not needed.
        let _ = writeln!(std::io::stdout(), "{} {metrics}", running.local_addr());
    }
    let orphaned = tokio::task::spawn_blocking(|| std::io::stdin().read_to_end(&mut Vec::new()));
    tokio::select! {
        error = running.failed() => Err(failed(error)),
        _ = orphaned => running.shutdown().await.map_err(failed),
    }
}
