//! Taking over the work: waits for its turn, and takes up the jobs of the store.

use super::Error;
use crate::actor::{Actor, Clock, Command, LiveEvent};
use crate::journal::Journal;
use crate::metrics::Metrics;
use crate::record::JobRecord;
use crate::scheduler::{Resumed, Scheduler, Settings};
use crate::standby;
use crate::store::{Loaded, Store, StoreError, StoredJob};
use sim_core::finish::Plan;
use sim_core::job::Job;
use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{broadcast, mpsc};
use tokio::task::JoinSet;

/// A coordinator whose turn it is.
pub(super) struct Lead {
    actor: Actor,
    /// Ends when the store is lost.
    touch: JoinSet<StoreError>,
}

/// Waits for its turn and takes up what there is to do.
pub(super) async fn lead(
    store: Arc<dyn Store>,
    standby: bool,
    lease: Duration,
    events: broadcast::Sender<LiveEvent>,
    metrics: Arc<Metrics>,
) -> Result<Lead, Error> {
    let loaded = standby::turn(&*store, standby).await?;
    // Before the jobs are taken up, which takes a while.
    let mut touch = JoinSet::new();
    touch.spawn(standby::stay_in_touch(store.clone(), loaded.epoch));
    Ok(Lead { actor: take_up(store, loaded, lease, events, metrics).await?, touch })
}

impl Lead {
    /// Works until told to stop, or until the store fails or is another's.
    pub(super) async fn work(mut self, inbox: mpsc::Receiver<Command>) -> Result<(), Error> {
        let (store, epoch) = (self.actor.store.clone(), self.actor.epoch);
        tokio::select! {
            ended = self.actor.run(inbox) => ended?,
            Some(lost) = self.touch.join_next() => {
                return Err(lost.map_or_else(|e| Error::Server(e.to_string()), Error::Store));
            }
        }
        self.touch.shutdown().await;
        Ok(store.release(epoch).await?)
    }
}

/// Builds the scheduler from what is in the store.
async fn take_up(
    store: Arc<dyn Store>,
    loaded: Loaded,
    lease: Duration,
    events: broadcast::Sender<LiveEvent>,
    metrics: Arc<Metrics>,
) -> Result<Actor, Error> {
    metrics.epoch.set(loaded.epoch as i64);
    tracing::info!(epoch = loaded.epoch, jobs = loaded.active.len(), "the store is taken up");
    let clock = Clock::start();
    let settings = Settings::new(loaded.epoch, lease);
    let mut scheduler = Scheduler::new(settings, loaded.next_job, loaded.ended.into_iter().collect())
        .with_quarantined(loaded.quarantined);
    for stored in loaded.active {
        let id = stored.record.id.clone();
        let read = tokio::task::spawn_blocking(move || read_again(stored)).await;
        let problem = match read.map_err(|e| Error::Server(e.to_string()))? {
            Ok(resumed) => scheduler.resume(clock.now(), resumed).err().map(|e| e.to_string()),
            Err(unusable) => {
                let (record, reason) = *unusable;
                scheduler.give_up(clock.now(), record, reason.clone());
                Some(reason)
            }
        };
        match problem {
            None => tracing::info!(job = %id, epoch = loaded.epoch, "job goes on"),
            Some(reason) => tracing::error!(job = %id, reason, epoch = loaded.epoch, "job can't go on"),
        }
    }
    Ok(Actor {
        scheduler,
        store,
        epoch: loaded.epoch,
        lease,
        heartbeat: settings.heartbeat(),
        clock,
        events,
        sessions: HashMap::new(),
        journal: Journal::new(loaded.epoch, metrics.clone()),
        metrics,
    })
}

/// Reads a stored job again, or says why it can't go on.
fn read_again(stored: StoredJob) -> Result<Resumed, Box<(JobRecord, String)>> {
    let StoredJob { record, toml, search, results, last_scores } = stored;
    match Job::from_toml(&toml) {
        Ok(job) if job.digest() == record.job_digest => {
            let (at_once, optimiser, finish) = (job.candidates_at_once(), job.optimiser(), Plan::of(&job));
            Ok(Resumed { record, toml, at_once, optimiser, finish, search, results, last_scores })
        }
        Ok(job) => {
            let reason = format!(
                "it was submitted to another version of evogait, which reads it differently (job digest then {}, now \
                 {}): submit it again",
                record.job_digest.short(),
                job.digest().short()
            );
            Err(Box::new((record, reason)))
        }
        Err(error) => Err(Box::new((record, format!("this version of evogait can't read it: {error}")))),
    }
}
