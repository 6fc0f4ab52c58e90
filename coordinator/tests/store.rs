//! Tests of the errors for a --store that can't keep jobs: the coordinator must not start.

use std::path::Path;
use std::process::{Command, Output};

fn coordinator(folder: &Path, store: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_coordinator"));
    command.args(["--listen", "127.0.0.1:0", "--store", store]).current_dir(folder);
    command.output().expect("the coordinator starts")
}

/// Runs a coordinator that must refuse its store and leave the folder empty. Returns its message.
fn refused(store: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let Output { status, stdout, stderr } = coordinator(folder.path(), store);
    let said = String::from_utf8(stderr).unwrap();
    assert_eq!((status.code(), stdout.as_slice()), (Some(1), &b""[..]), "{store}: {said}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "{store}: {said}");
    said
}

#[test]
fn store_that_is_not_a_file_is_refused() {
    for store in
        ["sqlite::memory:", "sqlite::memory:?cache=shared", "sqlite:file::memory:", "sqlite:file:a.db?mode=memory"]
    {
        let said = refused(store);
        assert!(said.contains(store) && said.contains("jobs that are not in a file are lost"), "{said}");
    }
    assert!(refused("sqlite:a.db?mode=memory").contains("has a '?'"));
    assert!(refused("sqlite:").contains("is not a store URL"));
    assert!(refused("sqlite:.").contains("it is a folder"));
    assert!(refused("sqlite:none/a.db").contains("there is no folder none"));
    assert!(refused("sqlite:/dev/null").contains("it is a device, pipe or socket"));
}

#[test]
fn unwritable_store_is_named() {
    for store in ["sqlite:/proc/a.db", "sqlite:/proc/version", "sqlite:/sys/a.db"] {
        let said = refused(store);
        assert!(said.contains("can't be written") && said.contains("choose another place"), "{store}: {said}");
    }
}
