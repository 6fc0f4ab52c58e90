//! The coordinator's metrics and health, asked of the actor when they are read.

use crate::actor::Command;
use crate::limits::CENSUS_WITHIN;
use crate::metrics::Metrics;
use crate::scheduler::{Census, Demand};
use std::sync::{Arc, OnceLock};
use telemetry::Vitals;
use telemetry::endpoint::Answer;
use tokio::sync::{mpsc, oneshot};

/// The coordinator's answers at `/metrics` and `/healthz`.
pub(crate) struct Pulse {
    metrics: Arc<Metrics>,
    /// There once this coordinator has the store.
    commands: OnceLock<mpsc::Sender<Command>>,
}

impl Pulse {
    /// Of a coordinator that does not have the store yet.
    pub fn new(metrics: Arc<Metrics>) -> Self {
        Self { metrics, commands: OnceLock::new() }
    }

    /// It has the store now.
    pub fn activate(&self, commands: mpsc::Sender<Command>) {
        self.metrics.activate();
        // Only the first counts.
        let _ = self.commands.set(commands);
    }

    /// How many slots the jobs could use; `None` where this coordinator does not serve.
    pub async fn demand(&self) -> Option<Demand> {
        Self::ask(self.commands.get()?, |reply| Command::Demand { reply }).await
    }

    async fn census(commands: &mpsc::Sender<Command>) -> Option<Census> {
        Self::ask(commands, |reply| Command::Census { reply }).await
    }

    /// Asks the actor; `None` if it does not answer in time.
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

impl Vitals for Pulse {
    fn metrics(&self) -> Answer<'_, String> {
        Box::pin(async move {
            if let Some(commands) = self.commands.get() {
                self.metrics.queued(commands.max_capacity() - commands.capacity());
                // Where the actor does not answer, the gauges stay as they were and the queue grows.
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
                None => Err(format!("the actor has not answered for {} s", CENSUS_WITHIN.as_secs())),
            }
        })
    }
}
