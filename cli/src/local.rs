//! Coordinator and workers inside this process, over a loopback connection: what `evogait run` starts.

use crate::client::Url;
use crate::error::Error;
use std::path::Path;
use std::time::Duration;
use tokio::sync::watch;
use tokio::task::JoinHandle;

/// A coordinator with its store in a file, and one worker.
pub struct Local {
    coordinator: coordinator::Running,
    /// It ended by itself: then there is nothing left to stop.
    coordinator_failed: bool,
    url: Url,
    stop_worker: watch::Sender<bool>,
    worker: JoinHandle<Result<(), worker::Error>>,
}

impl Local {
    /// Starts both; the worker runs `slots` evaluations at once.
    pub async fn start(store: &Path, slots: u32) -> Result<Self, Error> {
        let store = coordinator::StoreUrl::Sqlite(store.to_owned());
        let coordinator = coordinator::serve(coordinator::Config::embedded(store)).await.map_err(failed)?;
        let url = Url::of_socket(coordinator.local_addr());
        let (stop_worker, mut stopped) = watch::channel(false);
        // Whoever stops it wants it to stop: what runs is given back at once.
        let grace = Duration::ZERO;
        let config = worker::Config { grace, ..worker::Config::new(url.to_string(), slots as usize) };
        let worker = tokio::spawn(worker::run(config, async move {
            // An error means that the sender is gone: then stop, too.
            let _ = stopped.wait_for(|stop| *stop).await;
        }));
        Ok(Self { coordinator, coordinator_failed: false, url, stop_worker, worker })
    }

    /// Where the coordinator listens.
    pub fn url(&self) -> &Url {
        &self.url
    }

    /// Returns only if one of them ends by itself, which it should not.
    pub async fn broken(&mut self) -> Error {
        tokio::select! {
            error = self.coordinator.failed() => {
                self.coordinator_failed = true;
                failed(error)
            }
            ended = &mut self.worker => Error::LocalWorker {
                reason: match ended {
                    Ok(Ok(())) => "it stopped by itself".to_owned(),
                    Ok(Err(error)) => error.to_string(),
                    Err(panic) => panic.to_string(),
                },
            },
        }
    }

    /// Stops both; what is committed stays in the store.
    pub async fn stop(self) -> Result<(), Error> {
        // Without a receiver the worker has ended already.
        let _ = self.stop_worker.send(true);
        if self.coordinator_failed {
            // Nobody is left to take what the worker would deliver: it would try for seconds.
            self.worker.abort();
        }
        if !self.worker.is_finished() {
            // How it ended no longer matters: whatever it had not delivered is computed again.
            let _ = self.worker.await;
        }
        if self.coordinator_failed { Ok(()) } else { self.coordinator.shutdown().await.map_err(failed) }
    }
}

fn failed(error: coordinator::Error) -> Error {
    Error::LocalCoordinator { reason: error.to_string() }
}
