//! Registry of the input files that this process has read. Output never replaces one of them.
//!
//! Readers call [`record`]. Writers call [`refuse`] before they write. Commands also call it before they compute.

use crate::error::Error;
use std::fs::{self, File, Metadata};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

static READ: Mutex<Vec<Input>> = Mutex::new(Vec::new());

struct Input {
    /// Path as the user gave it.
    path: PathBuf,
    identity: Identity,
    /// Open file: if the user removes the file, the system can't reuse its inode.
    _open: Option<File>,
}

/// Identity of a file. It is the same for all paths to the file: links, other spellings, linked folders.
#[derive(PartialEq, Eq)]
struct Identity {
    #[cfg(unix)]
    device_and_inode: (u64, u64),
    #[cfg(not(unix))]
    canonical: PathBuf,
}

impl Identity {
    #[cfg(unix)]
    fn of(_: &Path, found: &Metadata) -> Option<Self> {
        use std::os::unix::fs::MetadataExt as _;
        Some(Self { device_and_inode: (found.dev(), found.ino()) })
    }

    #[cfg(not(unix))]
    fn of(path: &Path, _: &Metadata) -> Option<Self> {
        fs::canonicalize(path).ok().map(|canonical| Self { canonical })
    }
}

/// Returns the identity of the regular file at a path; `None` for a missing file, and for folders, terminals and pipes,
/// which output does not replace.
fn identity(path: &Path) -> Option<Identity> {
    let found = fs::metadata(path).ok().filter(Metadata::is_file)?;
    Identity::of(path, &found)
}

/// Records an input file.
pub fn record(path: &Path) {
    if let Some(identity) = identity(path) {
        let mut read = READ.lock().unwrap_or_else(PoisonError::into_inner);
        read.push(Input { path: path.to_owned(), identity, _open: File::open(path).ok() });
    }
}

/// Fails if the file at a path was recorded under any name.
pub fn refuse(path: &Path) -> Result<(), Error> {
    match replaced_by(path) {
        Some(input) => Err(Error::ReplacesInput { path: path.to_owned(), input }),
        None => Ok(()),
    }
}

/// Fails if one of these files of a folder was recorded.
pub fn refuse_all<'a>(folder: &Path, names: impl IntoIterator<Item = &'a str>) -> Result<(), Error> {
    names.into_iter().try_for_each(|name| refuse(&folder.join(name)))
}

/// Returns the path under which the file at a path was recorded; `None` if it was not.
pub fn replaced_by(path: &Path) -> Option<PathBuf> {
    let identity = identity(path)?;
    let read = READ.lock().unwrap_or_else(PoisonError::into_inner);
    read.iter().find(|input| input.identity == identity).map(|input| input.path.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recorded_file_is_refused_under_all_its_names() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("input"), "x").unwrap();
        fs::write(at("other"), "x").unwrap();
        fs::create_dir(at("sub")).unwrap();
        record(&at("input"));
        record(&at("missing"));
        record(&at("sub"));
        fs::hard_link(at("input"), at("hard")).unwrap();
        assert!(
            refuse(&at("sub/../input")).is_err() && refuse(&at("./input")).is_err() && refuse(&at("hard")).is_err()
        );
        assert!(refuse(&at("other")).is_ok() && refuse(&at("missing")).is_ok() && refuse(&at("sub")).is_ok());
        assert!(refuse_all(folder.path(), ["other", "hard"]).is_err());
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(at("input"), at("link")).unwrap();
            std::os::unix::fs::symlink(folder.path(), at("linked-folder")).unwrap();
            assert!(refuse(&at("link")).is_err() && refuse(&at("linked-folder/input")).is_err());
        }
    }

    #[test]
    fn device_is_never_refused() {
        record(Path::new("/dev/null"));
        assert!(refuse(Path::new("/dev/null")).is_ok());
    }
}
