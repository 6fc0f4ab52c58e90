//! Output folder: it belongs to one job, and to one process at a time.

use super::{JOB, RESULT, ResultFile, STORE, atomic};
use crate::error::Error;
use crate::{inputs, load};
use sim_core::base::digest::Digest;
use sim_core::problem::Checked;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

const LOCK: &str = ".lock";

/// Locked output folder: it holds this job or nothing, and no other process uses it.
pub struct Folder {
    path: PathBuf,
    /// Text of the job in the folder. It is the same job, but may have another name.
    job_toml: Option<String>,
    /// True if this run created the folder.
    made: bool,
    _lock: File,
}

impl Folder {
    /// Returns the default folder of a job: `runs/NAME-DIGEST`.
    pub fn default_path(name: &str, digest: &Digest) -> PathBuf {
        Path::new("runs").join(format!("{name}-{}", digest.short()))
    }

    /// Opens and locks a folder for a job; creates it if needed.
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
        // Another process may have written the job before it released the lock.
        let job_toml = if job_toml.is_none() { own_job(path, digest)? } else { job_toml };
        Ok(Self { path: path.to_owned(), job_toml, made, _lock: lock })
    }

    /// Path of the folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns true if the folder already has its job.toml, which must not be written again.
    pub fn has_job(&self) -> bool {
        self.job_toml.is_some()
    }

    /// Returns true if the folder has a result, which is written last.
    pub fn is_done(&self) -> bool {
        self.path.join(RESULT).is_file()
    }

    /// Removes the files of a run after its job could not be prepared, so that the corrected job can use the folder.
    pub fn discard(self) {
        let store = |ending: &str| format!("{STORE}{ending}");
        for name in [JOB.to_owned(), store(""), store("-wal"), store("-shm"), LOCK.to_owned()] {
            // Errors are ignored: a missing or remaining file does no harm.
            let _ = fs::remove_file(self.path.join(name));
        }
        if self.made {
            let _ = fs::remove_dir(&self.path);
        }
    }

    /// Returns the text of the folder's job file; writes `text` if there is none. A job file that differs only in name
    /// or description is the same job and stays unchanged.
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

/// Returns the text of the folder's job.toml, if there is one. Fails if it is of another job, or if no run wrote it.
fn own_job(path: &Path, digest: &Digest) -> Result<Option<String>, Error> {
    let file = path.join(JOB);
    // An input file need not be a resolved job. The error about its replacement is more useful than one about its
    // content.
    let found = match (existing_job(path), inputs::replaced_by(&file)) {
        (Err(Error::Invalid { .. }), Some(input)) => return Err(Error::ReplacesInput { path: file, input }),
        (found, _) => found?,
    };
    let Some((job, text)) = found else { return Ok(None) };
    if job.digest() != *digest {
        let (name, digest) = (job.spec().name.clone(), job.digest());
        return Err(Error::OtherJob { folder: path.to_owned(), name, digest });
    }
    // Another version may have formatted the job of a finished run differently.
    if text != job.to_toml() && !is_result_of(path, digest) {
        return Err(match inputs::replaced_by(&file) {
            Some(input) => Error::ReplacesInput { path: file, input },
            None => Error::ForeignJob { path: file },
        });
    }
    Ok(Some(text))
}

/// Returns true if the folder holds a result of this job.
fn is_result_of(path: &Path, digest: &Digest) -> bool {
    let result = fs::read(path.join(RESULT)).ok().and_then(|bytes| serde_json::from_slice::<ResultFile>(&bytes).ok());
    result.is_some_and(|result| result.job_digest == *digest)
}

/// Fails if the folder contains inputs of this command, because files of the run could replace them. The folder's own
/// job.toml is allowed: a run does not change it.
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

/// Fails if the folder has files that no run of this job wrote. Files of a run are recognised by the lock or the result
/// beside the job file; without these, only the job file and hidden files are allowed.
fn check_owner(path: &Path, digest: &Digest) -> Result<(), Error> {
    let has_job = path.join(JOB).exists();
    // A run creates its lock first. A copy of a folder may lack the lock, so a result is accepted, too.
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
