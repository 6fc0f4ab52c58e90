//! Jobs by id, with the bytes that tasks of their rounds share. Opening a job compiles its robot, so it is done beside the
//! connection, which needs its heartbeats meanwhile.

use proto::v1::Assign;
use sim_core::procedure::Bench;
use std::collections::VecDeque;
use std::sync::Arc;
use tokio::task::JoinSet;

/// Jobs that are kept: some more than a coordinator has active ones.
const KEPT: usize = 1024;
/// Shared bytes that are kept of a job: those of its newest rounds.
const KEPT_SHARED: usize = 4;

/// A job was sent before and is not kept any more. Connecting again brings it.
#[derive(Debug)]
pub(crate) struct Forgotten;

/// The jobs used last, and those that are being opened.
#[derive(Default)]
pub(crate) struct Jobs {
    kept: VecDeque<Kept>,
    opening: JoinSet<(String, Result<Bench, String>)>,
}

struct Kept {
    id: String,
    /// `None` while it is being opened.
    bench: Option<Arc<Bench>>,
    /// Digest and bytes, the newest first.
    shared: VecDeque<(Vec<u8>, Arc<[u8]>)>,
}

impl Jobs {
    /// Takes out of an assignment what it brings for later ones: a job's text, which it begins to open, and shared bytes.
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

    /// The job with this id, if it is open.
    pub fn get(&self, id: &str) -> Option<Arc<Bench>> {
        self.kept.iter().find(|kept| kept.id == id)?.bench.clone()
    }

    /// The bytes with this digest that tasks of a job share, if they are kept.
    pub fn shared(&self, id: &str, digest: &[u8]) -> Option<Arc<[u8]>> {
        let kept = self.kept.iter().find(|kept| kept.id == id)?;
        kept.shared.iter().find(|(own, _)| own == digest).map(|(_, bytes)| bytes.clone())
    }

    /// Returns the next job that was opened, or the reason why this build can't open it; `None` if none is being
    /// opened. Cancel-safe.
    /// called again.
    pub async fn next(&mut self) -> Option<(String, Result<Arc<Bench>, String>)> {
        // A panic is caught inside, and these tasks are never aborted.
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
        Err(_) => Err("it panicked".to_owned()),
    }
}
