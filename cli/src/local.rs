//! Coordinator and worker of `evogait run`, inside this process and connected over loopback.

use crate::client::Url;
use crate::error::Error;
use std::path::Path;
use std::time::Duration;
use tokio::sync::watch;
use tokio::task::JoinHandle;

/// Coordinator with its store in a file, and one worker.
pub struct Local {
    coordinator: coordinator::Running,
    /// True after the coordinator has failed: `stop` must not stop it again.
    coordinator_failed: bool,
    url: Url,
    stop_worker: watch::Sender<bool>,
    worker: JoinHandle<Result<(), worker::Error>>,
}

impl Local {
    /// Starts both. The worker runs `slots` evaluations at once.
    pub async fn start(store: &Path, slots: u32) -> Result<Self, Error> {
        let store = coordinator::StoreUrl::Sqlite(store.to_owned());
        let coordinator = coordinator::serve(coordinator::Config::embedded(store)).await.map_err(failed)?;
        let url = Url::of_socket(coordinator.local_addr());
        let (stop_worker, mut stopped) = watch::channel(false);
        // No grace time: a stopping worker returns its leases at once.
        let grace = Duration::ZERO;
        let config = worker::Config { grace, ..worker::Config::new(url.to_string(), slots as usize) };
        let worker = tokio::spawn(worker::run(config, async move {
            // An error means that the sender was dropped: the worker stops, too.
            let _ = stopped.wait_for(|stop| *stop).await;
        }));
        Ok(Self { coordinator, coordinator_failed: false, url, stop_worker, worker })
    }

    /// Address of the coordinator.
    pub fn url(&self) -> &Url {
        &self.url
    }

    /// Returns the error if the coordinator or the worker ends before `stop`.
    pub async fn broken(&mut self) -> Error {
        tokio::select! {
            error = self.coordinator.failed() => {
                self.coordinator_failed = true;
                failed(error)
            }
            ended = &mut self.worker => Error::LocalWorker {
                reason: match ended {
                    Ok(Ok(())) => "it stopped without a request".to_owned(),
                    Ok(Err(error)) => error.to_string(),
                    Err(panic) => panic.to_string(),
                },
            },
        }
    }

    /// Stops both. Committed results stay in the store.
    pub async fn stop(self) -> Result<(), Error> {
        // The send fails only if the worker has already ended.
        let _ = self.stop_worker.send(true);
        if self.coordinator_failed {
            // The worker would try for seconds to deliver its results to the failed coordinator.
            self.worker.abort();
        }
        if !self.worker.is_finished() {
            // The worker's error is ignored: a later run computes undelivered results again.
            let _ = self.worker.await;
        }
        if self.coordinator_failed { Ok(()) } else { self.coordinator.shutdown().await.map_err(failed) }
    }
}

fn failed(error: coordinator::Error) -> Error {
    Error::LocalCoordinator { reason: error.to_string() }
}
