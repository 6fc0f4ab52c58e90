//! Takeover: waits until this coordinator is active, and resumes the jobs of the store.

use super::Error;
use crate::actor::{Actor, Clock, Command};
use crate::journal::Journal;
use crate::live::Live;
use crate::metrics::Metrics;
use crate::record::JobRecord;
use crate::scheduler::{Resumed, Scheduler, Settings, on_resume, on_unusable};
use crate::standby;
use crate::store::{Loaded, Store, StoreError, StoredJob};
use sim_core::base::digest::Digest;
use sim_core::problem::Checked;
use sim_core::procedure;
use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::task::JoinSet;

/// Engines of this build, by name.
type Engines = Arc<[(&'static str, Digest)]>;

/// Active coordinator.
pub(super) struct ActiveCoordinator {
    actor: Actor,
    /// Renews the lock on the store. Ends when the lock is lost.
    touch: JoinSet<StoreError>,
}

/// Waits until this coordinator is active, and resumes the jobs.
pub(super) async fn take_over(
    store: Arc<dyn Store>,
    standby: bool,
    lease: Duration,
    engines: Engines,
    live: Live,
    metrics: Arc<Metrics>,
) -> Result<ActiveCoordinator, Error> {
    let loaded = standby::turn(&*store, standby).await?;
    // Renewed before the jobs are resumed, which takes a while.
    let mut touch = JoinSet::new();
    touch.spawn(standby::stay_in_touch(store.clone(), loaded.epoch));
    Ok(ActiveCoordinator { actor: take_up(store, loaded, lease, engines, live, metrics).await?, touch })
}

impl ActiveCoordinator {
    /// Works until a stop command, or until the store fails or is taken over.
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

/// Builds the scheduler from the jobs in the store.
async fn take_up(
    store: Arc<dyn Store>,
    loaded: Loaded,
    lease: Duration,
    engines: Engines,
    live: Live,
    metrics: Arc<Metrics>,
) -> Result<Actor, Error> {
    metrics.epoch.set(loaded.epoch as i64);
    tracing::info!(epoch = loaded.epoch, jobs = loaded.active.len(), "store opened: jobs are resumed");
    let clock = Clock::start();
    let settings = Settings::new(loaded.epoch, lease);
    let mut scheduler = Scheduler::new(settings, loaded.key, loaded.next_job, loaded.ended.into_iter().collect())
        .with_quarantined(loaded.quarantined)
        .with_engines(engines);
    for stored in loaded.active {
        let id = stored.record.id.clone();
        let read = tokio::task::spawn_blocking(move || read_again(stored)).await;
        let problem = match read.map_err(|e| Error::Server(e.to_string()))? {
            Ok(resumed) => on_resume(&mut scheduler, clock.now(), resumed).err().map(|e| e.to_string()),
            Err(unusable) => {
                let (record, reason) = *unusable;
                on_unusable(&mut scheduler, clock.now(), record, reason.clone());
                Some(reason)
            }
        };
        match problem {
            None => tracing::info!(job = %id, epoch = loaded.epoch, "job resumed"),
            Some(reason) => tracing::error!(job = %id, reason, epoch = loaded.epoch, "job can't be resumed"),
        }
    }
    Ok(Actor {
        scheduler,
        store,
        epoch: loaded.epoch,
        lease,
        heartbeat: settings.heartbeat(),
        clock,
        live,
        sessions: HashMap::new(),
        journal: Journal::new(loaded.epoch, metrics.clone()),
        metrics,
    })
}

/// Reads a stored job, or returns the reason why it can't be resumed. Nothing is simulated.
fn read_again(stored: StoredJob) -> Result<Resumed, Box<(JobRecord, String)>> {
    let StoredJob { record, toml, state, results } = stored;
    let unusable = |record, reason| Err(Box::new((record, reason)));
    let job = match Checked::from_toml(&toml) {
        Ok(job) => job,
        Err(error) => return unusable(record, format!("this version of evogait can't read it: {error}")),
    };
    // The engine may be of another build: then workers of that build continue the job.
    let digest = job.digest_on(record.engine_digest);
    if digest != record.job_digest {
        let reason = format!(
            "it was submitted to evogait {}, which interprets it differently (job digest then {}, now {}): submit it again",
            record.version,
            record.job_digest.short(),
            digest.short()
        );
        return unusable(record, reason);
    }
    match procedure::load(&job, &state.procedure) {
        Ok(procedure) => Ok(Resumed { record, toml, procedure, last: state.last, results }),
        Err(error) => unusable(record, error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::RunState;
    use crate::store::tests::record;

    const OLD: Digest = Digest([7; 32]);

    /// Returns a job that was submitted to a build with this engine.
    fn stored(job: &Checked, engine: Digest) -> StoredJob {
        let digest = job.digest_on(engine);
        let record = JobRecord { version: "0.0.9".to_owned(), job_digest: digest, engine_digest: engine, ..record(1) };
        let procedure = procedure::start(job).expect("the procedure starts").save();
        let state = RunState { procedure, last: None };
        StoredJob { record, toml: job.to_toml().into(), state, results: Vec::new() }
    }

    #[test]
    fn stored_job_with_changed_digest_is_not_resumed() {
        let text = "name = \"t\"\nrobot = \"quadropod\"\nenvironment = \"empty\"\n[gaits]\ncount = 1\nduration = 1.0\n\
                    [planner]\niterations = 2\n[fitness]\nkind = \"coverage\"\n\
                    [optimiser]\nkind = \"pso\"\nparticles = 5\ngenerations = 2\n[finish]\nkind = \"none\"\n";
        let job = Checked::from_toml(text).expect("a valid job");
        let own = job.engine_digest();
        let engine = |stored| match read_again(stored) {
            Ok(resumed) => resumed.record.engine_digest,
            Err(unusable) => panic!("the job can't be resumed: {}", unusable.1),
        };
        assert_eq!(engine(stored(&job, own)), own);
        assert_eq!(engine(stored(&job, OLD)), OLD, "it waits for workers of another build");

        let reason = |stored| read_again(stored).err().expect("the job can't be resumed").1;
        let as_if = |toml: String| StoredJob { toml: toml.into(), ..stored(&job, OLD) };
        let said = reason(as_if(job.to_toml().replace("particles = 5", "particles = 6")));
        assert!(
            said.contains("evogait 0.0.9, which interprets it differently") && said.contains("submit it again"),
            "{said}"
        );
        let said = reason(as_if(format!("later = 1\n{}", job.to_toml())));
        assert!(said.contains("can't read it") && said.contains("later"), "{said}");
    }
}
