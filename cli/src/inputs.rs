//! Registry of the files that this process read for the user: output never replaces one of them.
//!
//! Readers call [`record`], writers call [`refuse`] before they write, and commands call it once more before they compute.

use crate::error::Error;
use std::fs::{self, File, Metadata};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

static READ: Mutex<Vec<Input>> = Mutex::new(Vec::new());

struct Input {
    /// As the user named it.
    path: PathBuf,
    identity: Identity,
    /// Open, so that the system gives its inode to no other file if the user removes it meanwhile.
    _open: Option<File>,
}

/// Identity of a file, which is the same under all of its names: links, other spellings, folders that are links.
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

/// The regular file behind a path; `None` for folders, terminals and pipes, which nothing replaces, and where there is none.
fn identity(path: &Path) -> Option<Identity> {
    let found = fs::metadata(path).ok().filter(Metadata::is_file)?;
    Identity::of(path, &found)
}

/// Records a file that the user gave to read.
pub fn record(path: &Path) {
    if let Some(identity) = identity(path) {
        let mut read = READ.lock().unwrap_or_else(PoisonError::into_inner);
        read.push(Input { path: path.to_owned(), identity, _open: File::open(path).ok() });
    }
}

/// Refuses a path whose file was recorded, under whatever name.
pub fn refuse(path: &Path) -> Result<(), Error> {
    match replaced_by(path) {
        Some(input) => Err(Error::ReplacesInput { path: path.to_owned(), input }),
        None => Ok(()),
    }
}

/// Refuses these files of a folder if one of them was recorded.
pub fn refuse_all<'a>(folder: &Path, names: impl IntoIterator<Item = &'a str>) -> Result<(), Error> {
    names.into_iter().try_for_each(|name| refuse(&folder.join(name)))
}

/// The name under which the file at a path was recorded; `None` if it was not.
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
    fn pipe_is_no_file_to_replace() {
        record(Path::new("/dev/null"));
        assert!(refuse(Path::new("/dev/null")).is_ok());
    }
}
