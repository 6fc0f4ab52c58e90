//! Metrics and health of the coordinator, queried from the actor when they are read.

use crate::actor::Command;
use crate::limits::CENSUS_WITHIN;
use crate::metrics::Metrics;
use crate::scheduler::{Census, Demand};
use std::sync::{Arc, OnceLock};
use telemetry::Vitals;
use telemetry::endpoint::Answer;
use tokio::sync::{mpsc, oneshot};

/// Source of `/metrics` and `/healthz`.
pub(crate) struct CoordinatorVitals {
    metrics: Arc<Metrics>,
    /// Set once this coordinator is active.
    commands: OnceLock<mpsc::Sender<Command>>,
}

impl CoordinatorVitals {
    /// Creates the source for a coordinator that is not active yet.
    pub fn new(metrics: Arc<Metrics>) -> Self {
        Self { metrics, commands: OnceLock::new() }
    }

    /// Marks the coordinator as active.
    pub fn activate(&self, commands: mpsc::Sender<Command>) {
        self.metrics.activate();
        // Only the first call has an effect.
        let _ = self.commands.set(commands);
    }

    /// Returns the number of slots that the jobs could use; `None` if this coordinator is not active or does not answer
    /// in time.
    pub async fn demand(&self) -> Option<Demand> {
        Self::ask(self.commands.get()?, |reply| Command::Demand { reply }).await
    }

    async fn census(commands: &mpsc::Sender<Command>) -> Option<Census> {
        Self::ask(commands, |reply| Command::Census { reply }).await
    }

    /// Queries the actor; `None` if it does not reply within [`CENSUS_WITHIN`].
    async fn ask<T>(
        commands: &mpsc::Sender<Command>,
        command: impl FnOnce(oneshot::Sender<T>) -> Command,
    ) -> Option<T> {
        let (reply, answer) = oneshot::channel();
        let asked = async {
            commands.send(command(reply)).await.ok()?;
            answer.await.ok()
        };
        tokio::time::timeout(CENSUS_WITHIN, asked).await.ok().flatten()
    }
}

impl Vitals for CoordinatorVitals {
    fn metrics(&self) -> Answer<'_, String> {
        Box::pin(async move {
            if let Some(commands) = self.commands.get() {
                self.metrics.queued(commands.max_capacity() - commands.capacity());
                // If the actor does not reply, the gauges stay unchanged.
                if let Some(census) = Self::census(commands).await {
                    self.metrics.tell(&census);
                }
            }
            self.metrics.text()
        })
    }

    fn health(&self) -> Answer<'_, Result<String, String>> {
        Box::pin(async move {
            let Some(commands) = self.commands.get() else { return Ok("standing by".to_owned()) };
            match Self::census(commands).await {
                Some(_) => Ok("active".to_owned()),
                None => Err(format!("the actor did not reply within {} s", CENSUS_WITHIN.as_secs())),
            }
        })
    }
}
