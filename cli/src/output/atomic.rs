//! Atomic writing of files: each file is written under a temporary name, flushed to the disk, then renamed.

use crate::error::Error;
use crate::inputs;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// Files of one folder that become visible together, after all of them are on the disk.
pub struct Batch {
    folder: PathBuf,
    /// (temporary path, final path) of each file.
    staged: Vec<(PathBuf, PathBuf)>,
}

impl Batch {
    /// Creates an empty batch for an existing folder.
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), staged: Vec::new() }
    }

    /// Adds a file; `name` may include a subfolder, which is created.
    pub fn add(&mut self, name: &str, content: &[u8]) -> Result<(), Error> {
        let path = self.folder.join(name);
        inputs::refuse(&path)?;
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(|e| Error::write(parent, e))?;
        }
        let temporary = temporary(&path);
        self.staged.push((temporary.clone(), path.clone()));
        write_through(&temporary, content).map_err(|e| Error::write(&path, e))
    }

    /// Makes the files visible, in the order in which they were added.
    pub fn commit(mut self) -> Result<(), Error> {
        for (temporary, path) in &self.staged {
            fs::rename(temporary, path).map_err(|e| Error::write(path, e))?;
        }
        self.staged.clear();
        flush_folder(&self.folder).map_err(|e| Error::write(&self.folder, e))
    }
}

impl Drop for Batch {
    fn drop(&mut self) {
        for (temporary, path) in &self.staged {
            // Best effort: a file that can't be removed is hidden, and the next run replaces it.
            let _ = fs::remove_file(temporary);
            if let Some(parent) = path.parent().filter(|parent| *parent != self.folder) {
                // Succeeds only for an empty folder, which this batch created without use.
                let _ = fs::remove_dir(parent);
            }
        }
    }
}

/// Writes one file atomically. A device or pipe is written to, not replaced.
pub fn write_file(path: &Path, content: &[u8]) -> Result<(), Error> {
    let failed = |e| Error::write(path, e);
    inputs::refuse(path)?;
    // For a link, the file behind it is replaced, not the link.
    let path = &fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    match fs::metadata(path) {
        Ok(found) if found.is_dir() => return Err(failed(io::ErrorKind::IsADirectory.into())),
        Ok(found) if !found.is_file() => {
            let mut device = File::options().write(true).open(path).map_err(failed)?;
            return device.write_all(content).and_then(|()| device.flush()).map_err(failed);
        }
        _ => {}
    }
    let temporary = temporary(path);
    let written = write_through(&temporary, content).and_then(|()| fs::rename(&temporary, path));
    if let Err(error) = written {
        let _ = fs::remove_file(&temporary);
        return Err(failed(error));
    }
    Ok(())
}

fn temporary(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.{}.tmp", std::process::id()))
}

fn write_through(path: &Path, content: &[u8]) -> io::Result<()> {
    let mut file = File::create(path)?;
    file.write_all(content)?;
    file.sync_all()
}

/// Flushes a folder on Unix, so that renames survive a power failure.
fn flush_folder(folder: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<_> = entries.collect();
        names.sort();
        names
    }

    #[test]
    fn batch_files_appear_together_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a"), "old").unwrap();
        let mut batch = Batch::new(folder.path());
        batch.add("a", b"new").unwrap();
        batch.add("sub/b", b"b").unwrap();
        assert_eq!(fs::read_to_string(folder.path().join("a")).unwrap(), "old");
        drop(batch);
        assert_eq!(names(folder.path()), ["a"]);

        let mut batch = Batch::new(folder.path());
        batch.add("a", b"new").unwrap();
        batch.add("sub/b", b"b").unwrap();
        batch.commit().unwrap();
        assert_eq!(fs::read_to_string(folder.path().join("a")).unwrap(), "new");
        assert_eq!(names(folder.path()), ["a", "sub"]);
        assert_eq!(names(&folder.path().join("sub")), ["b"]);
    }

    #[test]
    fn failed_write_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("taken");
        fs::create_dir(&path).unwrap();
        assert!(matches!(write_file(&path, b"x"), Err(Error::Write { .. })));
        assert_eq!(names(folder.path()), ["taken"]);
    }
}
