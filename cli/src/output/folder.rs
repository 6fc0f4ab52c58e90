//! The output folder: one job's, one process's at a time.

use super::{JOB, RESULT, ResultFile, STORE, atomic};
use crate::error::Error;
use crate::{inputs, load};
use sim_core::base::digest::Digest;
use sim_core::problem::Checked;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

const LOCK: &str = ".lock";

/// An output folder that is ours: it holds this job or nothing, and no other process works in it.
pub struct Folder {
    path: PathBuf,
    /// The job as it stands in the folder; the same job as ours, perhaps under another name.
    job_toml: Option<String>,
    /// The folder was made for this run.
    made: bool,
    _lock: File,
}

impl Folder {
    /// Where a job goes unless told otherwise: `runs/NAME-DIGEST`.
    pub fn default_path(name: &str, digest: &Digest) -> PathBuf {
        Path::new("runs").join(format!("{name}-{}", digest.short()))
    }

    /// Takes a folder for a job, making it if there is none.
    pub fn open(path: &Path, digest: &Digest) -> Result<Self, Error> {
        if path.exists() && !path.is_dir() {
            return Err(Error::write(path, io::ErrorKind::NotADirectory.into()));
        }
        let job_toml = own_job(path, digest)?;
        if path.is_dir() {
            check_owner(path, digest)?;
        }
        refuse_inputs(path)?;
        let made = !path.exists();
        fs::create_dir_all(path).map_err(|e| Error::write(path, e))?;
        let lock_path = path.join(LOCK);
        let lock =
            File::options().create(true).append(true).open(&lock_path).map_err(|e| Error::write(&lock_path, e))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(Error::Busy { folder: path.to_owned() }),
            Err(TryLockError::Error(e)) => return Err(Error::write(&lock_path, e)),
        }
        // Another process may have written it before it gave the lock up.
        let job_toml = if job_toml.is_none() { own_job(path, digest)? } else { job_toml };
        Ok(Self { path: path.to_owned(), job_toml, made, _lock: lock })
    }

    /// Its path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the folder has its job.toml: it is never written again.
    pub fn has_job(&self) -> bool {
        self.job_toml.is_some()
    }

    /// Whether the result is there: it is written last.
    pub fn is_done(&self) -> bool {
        self.path.join(RESULT).is_file()
    }

    /// Removes what a run of a job has left that can't be prepared, so that the corrected job can take its place.
    pub fn discard(self) {
        let store = |ending: &str| format!("{STORE}{ending}");
        for name in [JOB.to_owned(), store(""), store("-wal"), store("-shm"), LOCK.to_owned()] {
            // A file that is not there, or stays, does no harm.
            let _ = fs::remove_file(self.path.join(name));
        }
        if self.made {
            let _ = fs::remove_dir(&self.path);
        }
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

fn existing_job(path: &Path) -> Result<Option<(Checked, String)>, Error> {
    let file = path.join(JOB);
    if file.exists() { load::resolved(&file, Checked::from_toml).map(Some) } else { Ok(None) }
}

/// The text of the folder's job.toml if there is one: of this job, as a run writes it. What a user wrote is refused.
fn own_job(path: &Path, digest: &Digest) -> Result<Option<String>, Error> {
    let file = path.join(JOB);
    // A file that the user gave need not be a resolved job: that it can't be read says less than that it would be lost.
    let found = match (existing_job(path), inputs::replaced_by(&file)) {
        (Err(Error::Invalid { .. }), Some(input)) => return Err(Error::ReplacesInput { path: file, input }),
        (found, _) => found?,
    };
    let Some((job, text)) = found else { return Ok(None) };
    if job.digest() != *digest {
        let (name, digest) = (job.spec().name.clone(), job.digest());
        return Err(Error::OtherJob { folder: path.to_owned(), name, digest });
    }
    // Another version may have written out a finished job otherwise.
    if text != job.to_toml() && !is_result_of(path, digest) {
        return Err(match inputs::replaced_by(&file) {
            Some(input) => Error::ReplacesInput { path: file, input },
            None => Error::ForeignJob { path: file },
        });
    }
    Ok(Some(text))
}

/// Whether the folder holds a result of this job.
fn is_result_of(path: &Path, digest: &Digest) -> bool {
    let result = fs::read(path.join(RESULT)).ok().and_then(|bytes| serde_json::from_slice::<ResultFile>(&bytes).ok());
    result.is_some_and(|result| result.job_digest == *digest)
}

/// Refuses a folder with inputs of this command in it, which a run's files could replace. The folder's own job.toml stays
/// as it is.
fn refuse_inputs(folder: &Path) -> Result<(), Error> {
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(&next).into_iter().flatten().flatten() {
            let path = entry.path();
            if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                open.push(path);
            } else if path != folder.join(JOB) {
                inputs::refuse(&path)?;
            }
        }
    }
    Ok(())
}

/// Refuses a folder that has files of others: no job, or a job alone among files that no run of it left there.
fn check_owner(path: &Path, digest: &Digest) -> Result<(), Error> {
    let has_job = path.join(JOB).exists();
    // A run makes its lock first; copies of its folder may lack it.
    if has_job && (path.join(LOCK).exists() || is_result_of(path, digest)) {
        return Ok(());
    }
    for entry in fs::read_dir(path).map_err(|e| Error::read(path, e))? {
        let entry = entry.map_err(|e| Error::read(path, e))?;
        let name = entry.file_name();
        let own_job = has_job && name == JOB;
        if !own_job && !name.to_string_lossy().starts_with('.') {
            inputs::refuse(&entry.path())?;
            return Err(Error::NotOurs { folder: path.to_owned() });
        }
    }
    Ok(())
}
