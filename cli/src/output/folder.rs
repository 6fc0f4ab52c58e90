//! The output folder: one job's, one process's at a time.

use super::{JOB, RESULT, atomic};
use crate::error::Error;
use crate::load;
use sim_core::identity::Digest;
use sim_core::job::Job;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

const LOCK: &str = ".lock";

/// An output folder that is ours: it holds this job or nothing, and no other process works in it.
pub struct Folder {
    path: PathBuf,
    /// The job as it stands in the folder; the same job as ours, perhaps under another name.
    job_toml: Option<String>,
    _lock: File,
}

impl Folder {
    /// Where a job goes unless told otherwise: `runs/NAME-DIGEST`.
    pub fn default_path(name: &str, digest: &Digest) -> PathBuf {
        Path::new("runs").join(format!("{name}-{}", digest.short()))
    }

    /// Takes a folder for a job, making it if there is none.
    pub fn open(path: &Path, digest: &Digest) -> Result<Self, Error> {
        if path.is_dir() {
            check_owner(path)?;
        } else if path.exists() {
            return Err(Error::write(path, io::ErrorKind::NotADirectory.into()));
        }
        fs::create_dir_all(path).map_err(|e| Error::write(path, e))?;
        let lock_path = path.join(LOCK);
        let lock =
            File::options().create(true).append(true).open(&lock_path).map_err(|e| Error::write(&lock_path, e))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(Error::Busy { folder: path.to_owned() }),
            Err(TryLockError::Error(e)) => return Err(Error::write(&lock_path, e)),
        }
        let job_toml = match existing_job(path)? {
            Some((job, _)) if job.digest() != *digest => {
                return Err(Error::OtherJob {
                    folder: path.to_owned(),
                    name: job.spec().name.clone(),
                    digest: job.digest(),
                });
            }
            found => found.map(|(_, text)| text),
        };
        Ok(Self { path: path.to_owned(), job_toml, _lock: lock })
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the result is there: it is written last.
    pub fn is_done(&self) -> bool {
        self.path.join(RESULT).is_file()
    }

    /// The job's text as the folder has it, written there now if it has none. A job file that differs in name or
    /// description only is the same job and keeps its first text.
    pub fn keep_job(&mut self, text: String) -> Result<&str, Error> {
        if self.job_toml.is_none() {
            atomic::write_file(&self.path.join(JOB), text.as_bytes())?;
        }
        Ok(self.job_toml.get_or_insert(text))
    }
}

fn existing_job(path: &Path) -> Result<Option<(Job, String)>, Error> {
    let file = path.join(JOB);
    if file.exists() { load::resolved_job(&file).map(Some) } else { Ok(None) }
}

/// Refuses a folder that has files but no job: it is somebody else's.
fn check_owner(path: &Path) -> Result<(), Error> {
    if path.join(JOB).exists() {
        return Ok(());
    }
    for entry in fs::read_dir(path).map_err(|e| Error::read(path, e))? {
        let entry = entry.map_err(|e| Error::read(path, e))?;
        if !entry.file_name().to_string_lossy().starts_with('.') {
            return Err(Error::NotOurs { folder: path.to_owned() });
        }
    }
    Ok(())
}
