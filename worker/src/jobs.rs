//! Jobs that were read, by id. Reading one compiles its robot and lets it settle, so it is done beside the connection, which
//! needs its heartbeats meanwhile.

use sim_core::problem::Job;
use std::collections::{BTreeSet, VecDeque};
use std::sync::Arc;
use tokio::task::JoinSet;

/// How many are kept: some more than a coordinator has active ones.
const KEPT: usize = 1024;

/// The jobs used last, and those that are being read.
#[derive(Default)]
pub(crate) struct Jobs {
    kept: VecDeque<(String, Arc<Job>)>,
    ids: BTreeSet<String>,
    reading: JoinSet<(String, Result<Job, String>)>,
}

impl Jobs {
    /// The job with this id, if it was read.
    pub fn get(&mut self, id: &str) -> Option<Arc<Job>> {
        let at = self.kept.iter().position(|(known, _)| known == id)?;
        let found = self.kept.remove(at)?;
        let job = found.1.clone();
        self.kept.push_front(found);
        Some(job)
    }

    /// Whether it is being read.
    pub fn is_read(&self, id: &str) -> bool {
        self.ids.contains(id)
    }

    /// Starts to read a job from its TOML.
    pub fn read(&mut self, id: String, text: String) {
        if self.ids.insert(id.clone()) {
            self.reading.spawn_blocking(move || {
                let read = std::panic::catch_unwind(|| Job::from_toml(&text));
                let read = read.map_err(|_| "it panicked".to_owned()).and_then(|read| read.map_err(|e| e.to_string()));
                (id, read)
            });
        }
    }

    /// The next job whose reading ends, or why this build can't read it; `None` if none is being read. May be dropped and
    /// called again.
    pub async fn next(&mut self) -> Option<(String, Result<Arc<Job>, String>)> {
        // A panic is caught inside, and nobody aborts these tasks.
        let (id, read) = self.reading.join_next().await?.ok()?;
        self.ids.remove(&id);
        let read = read.map(Arc::new);
        if let Ok(job) = &read {
            self.kept.push_front((id.clone(), job.clone()));
            self.kept.truncate(KEPT);
        }
        Some((id, read))
    }
}
