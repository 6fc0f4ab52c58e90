//! Path of a SQLite file, checked and made absolute before it is passed to the driver.
//!
//! SQLite does not treat `:memory:`, an empty name and `file:…` as file names, and its messages for file errors are
//! "disk I/O error" or "unable to open database file". An absolute path always names a file.

use super::StoreError;
use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf, absolute};

/// Checks the path of a store and returns it as an absolute path. The folder must exist and be writable; the file may
/// be missing.
pub(super) fn check(path: &Path) -> Result<PathBuf, StoreError> {
    let unusable = |reason: String| StoreError::Open { store: path.display().to_string(), reason };
    let full = absolute(path).map_err(|e| unusable(plain(&e)))?;
    if full.to_str().is_none_or(|text| text.contains('\0')) {
        return Err(unusable("its path must be UTF-8 text without NUL characters".to_owned()));
    }
    let file = target(&full);
    let folder = file.parent().unwrap_or(Path::new("/"));
    if !folder.is_dir() {
        return Err(unusable(match file == full {
            true => format!("there is no folder {}", named_folder(path).display()),
            false => format!("it is a link to {}, in a folder that does not exist", file.display()),
        }));
    }
    let failed = |error: io::Error, what: &str| match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => StoreError::Full { store: path.display().to_string() },
        _ => unusable(format!("{what} can't be written ({}): choose another place", plain(&error))),
    };
    match fs::metadata(&file) {
        Ok(found) if found.is_dir() => return Err(unusable("it is a folder".to_owned())),
        Ok(found) if !found.is_file() => {
            return Err(unusable("it is a device, pipe or socket: jobs need a file on a disk".to_owned()));
        }
        Ok(_) => File::options().write(true).open(&file).map(drop).map_err(|e| failed(e, "the file"))?,
        Err(_) if full.as_os_str().as_encoded_bytes().ends_with(b"/") => {
            return Err(unusable("it ends in a slash: name a file, not a folder".to_owned()));
        }
        Err(_) => {}
    }
    // The write-ahead log is created in the same folder.
    writable(folder).map_err(|e| failed(e, &format!("its folder {}", folder.display())))?;
    Ok(full)
}

/// Returns the folder as given by the user.
fn named_folder(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Returns the target of a link, which may be missing, or the path itself if it is not a link.
fn target(path: &Path) -> PathBuf {
    match fs::canonicalize(path) {
        Ok(file) if path.is_symlink() => file,
        Ok(_) => path.to_owned(),
        Err(_) => match (fs::read_link(path), path.parent()) {
            (Ok(to), Some(folder)) => folder.join(to),
            _ => path.to_owned(),
        },
    }
}

/// Checks that files can be created in a folder, by creating and removing one: permissions alone are not reliable.
fn writable(folder: &Path) -> io::Result<()> {
    let probe = folder.join(format!(".evogait-store-{}.tmp", std::process::id()));
    match File::options().write(true).create_new(true).open(&probe) {
        // The file is left over from an earlier process, or another store is being opened by this one.
        Err(e) if e.kind() == ErrorKind::AlreadyExists => Ok(()),
        made => made.and_then(|_| fs::remove_file(&probe)),
    }
}

/// Returns the message of an I/O error without "(os error 2)".
fn plain(error: &io::Error) -> String {
    let text = error.to_string();
    text.find(" (os error").map_or(text.clone(), |end| text[..end].to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::SqliteStore;
    use std::os::unix::fs::symlink;

    fn refused(path: &Path) -> String {
        check(path).unwrap_err().to_string()
    }

    #[tokio::test]
    async fn special_names_of_sqlite_are_files() {
        let folder = tempfile::tempdir().unwrap();
        for name in [":memory:", "file:a.db", "file:b.db?mode=memory", "c.db?mode=memory", "d#e%20.db", " "] {
            let path = folder.path().join(name);
            let store = SqliteStore::open(&path).await.unwrap();
            crate::store::Store::close(&store).await.unwrap();
            assert!(path.metadata().unwrap().len() > 0, "{name}");
        }
        assert_eq!(check(Path::new(":memory:")).unwrap(), std::env::current_dir().unwrap().join(":memory:"));
    }

    #[test]
    fn places_without_a_file_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        assert!(refused(folder.path()).contains("it is a folder"));
        assert!(refused(Path::new("/dev/null")).contains("it is a device, pipe or socket"));
        assert!(std::process::Command::new("mkfifo").arg(at("pipe")).status().unwrap().success());
        assert!(refused(&at("pipe")).contains("it is a device, pipe or socket"));
        symlink(at("none/s.db"), at("broken")).unwrap();
        assert!(refused(&at("broken")).contains("none/s.db, in a folder that does not exist"));
        assert!(refused(&at("none/s.db")).contains("there is no folder"));
        assert!(refused(&at("new.db/")).contains("ends in a slash"));
        std::fs::write(at("file"), "").unwrap();
        assert!(refused(&at("file/s.db")).contains("there is no folder"));
        symlink(at("s.db"), at("fresh")).unwrap();
        assert_eq!(check(&at("fresh")).unwrap(), at("fresh"));
    }

    #[test]
    fn unwritable_place_is_named() {
        for path in ["/proc/s.db", "/proc/self/s.db"] {
            let said = refused(Path::new(path));
            assert!(said.contains("can't be written") && said.contains("choose another place"), "{said}");
        }
        let said = refused(Path::new("/proc/version"));
        assert!(said.contains("can't be written"), "{said}");
    }
}
