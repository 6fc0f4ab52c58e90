//! Jobs by id, with the bytes shared by the tasks of their rounds. Opening a job compiles its robot, so another thread
//! opens it: the session must keep sending heartbeats.

use proto::v1::Assign;
use sim_core::procedure::Bench;
use std::collections::VecDeque;
use std::sync::Arc;
use tokio::task::JoinSet;

/// Number of jobs kept: more than a coordinator has active jobs.
const KEPT: usize = 1024;
/// Number of shared byte strings kept per job: those of its newest rounds.
const KEPT_SHARED: usize = 4;

/// Error: the job or its text is not kept any more. The coordinator sends it again after a reconnect.
#[derive(Debug)]
pub(crate) struct Forgotten;

/// Recently used jobs, and jobs being opened.
#[derive(Default)]
pub(crate) struct Jobs {
    kept: VecDeque<Kept>,
    opening: JoinSet<(String, Result<Bench, String>)>,
}

struct Kept {
    id: String,
    /// `None` while the job is being opened.
    bench: Option<Arc<Bench>>,
    /// Digests and shared bytes, newest first.
    shared: VecDeque<(Vec<u8>, Arc<[u8]>)>,
}

impl Jobs {
    /// Moves the job's text and the shared bytes out of an assignment, keeps them for later assignments, and starts to
    /// open a new job.
    pub fn receive(&mut self, assign: &mut Assign) -> Result<(), Forgotten> {
        let (text, shared) = (std::mem::take(&mut assign.job_toml), std::mem::take(&mut assign.shared));
        let mut kept = match self.kept.iter().position(|kept| kept.id == assign.job_id) {
            Some(at) => self.kept.remove(at).ok_or(Forgotten)?,
            None if text.is_empty() => return Err(Forgotten),
            None => {
                let id = assign.job_id.clone();
                self.opening.spawn_blocking(move || (id, open(&text)));
                Kept { id: assign.job_id.clone(), bench: None, shared: VecDeque::new() }
            }
        };
        if !shared.is_empty() {
            kept.shared.retain(|(digest, _)| *digest != assign.shared_digest);
            kept.shared.push_front((assign.shared_digest.clone(), shared.into()));
            kept.shared.truncate(KEPT_SHARED);
        }
        self.kept.push_front(kept);
        self.kept.truncate(KEPT);
        Ok(())
    }

    /// Returns the job with this id, if it is open.
    pub fn get(&self, id: &str) -> Option<Arc<Bench>> {
        self.kept.iter().find(|kept| kept.id == id)?.bench.clone()
    }

    /// Returns the shared bytes of a job by digest, if they are kept.
    pub fn shared(&self, id: &str, digest: &[u8]) -> Option<Arc<[u8]>> {
        let kept = self.kept.iter().find(|kept| kept.id == id)?;
        kept.shared.iter().find(|(own, _)| own == digest).map(|(_, bytes)| bytes.clone())
    }

    /// Returns the next opened job, or the reason why this build can't open it; `None` if no job is being opened.
    /// Cancel-safe.
    pub async fn next(&mut self) -> Option<(String, Result<Arc<Bench>, String>)> {
        // No error can occur: `open` catches panics, and these tasks are never aborted.
        let (id, opened) = self.opening.join_next().await?.ok()?;
        let opened = opened.map(Arc::new);
        if let Some(at) = self.kept.iter().position(|kept| kept.id == id) {
            match &opened {
                Ok(bench) => self.kept[at].bench = Some(bench.clone()),
                Err(_) => drop(self.kept.remove(at)),
            }
        }
        Some((id, opened))
    }
}

fn open(text: &str) -> Result<Bench, String> {
    match std::panic::catch_unwind(|| Bench::open(text)) {
        Ok(opened) => opened.map_err(|error| error.to_string()),
        Err(_) => Err("opening it caused a panic".to_owned()),
    }
}
