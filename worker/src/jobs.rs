//! Jobs that were read, by id: reading one compiles its robot.

use sim_core::job::Job;
use std::collections::VecDeque;
use std::sync::Arc;

/// How many are kept.
const KEPT: usize = 64;

/// The jobs used last.
#[derive(Default)]
pub(crate) struct Jobs(VecDeque<(String, Arc<Job>)>);

impl Jobs {
    /// The job with this id. `text` is its TOML where it came along, empty otherwise.
    pub async fn get(&mut self, id: &str, text: String) -> Result<Arc<Job>, Unavailable> {
        if let Some(at) = self.0.iter().position(|(known, _)| known == id) {
            let found = self.0.remove(at).ok_or(Unavailable::Unknown)?;
            let job = found.1.clone();
            self.0.push_front(found);
            return Ok(job);
        }
        if text.is_empty() {
            return Err(Unavailable::Unknown);
        }
        let read = tokio::task::spawn_blocking(move || Job::from_toml(&text)).await;
        let job = match read {
            Ok(Ok(job)) => Arc::new(job),
            Ok(Err(error)) => return Err(Unavailable::Unreadable(error.to_string())),
            Err(panic) => return Err(Unavailable::Unreadable(panic.to_string())),
        };
        self.0.push_front((id.to_owned(), job.clone()));
        self.0.truncate(KEPT);
        Ok(job)
    }
}

/// Why a job can't be had.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Unavailable {
    /// Its text did not come along and it is not, or no longer, known. Connecting again brings it.
    #[error("the job's text did not come along")]
    Unknown,
    /// This build can't read it.
    #[error("this worker can't read the job: {0}")]
    Unreadable(String),
}
