//! Tests of the addresses that the coordinator listens on: host names, and the rules for addresses beyond loopback.

use std::io::{BufRead as _, BufReader};
use std::process::{Command, Stdio};

fn coordinator(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_coordinator"));
    command.args(["--store", "memory:"]).args(arguments);
    command
}

#[test]
fn localhost_is_loopback() {
    let arguments = ["--listen", "localhost:0", "--metrics", "LOCALHOST:0", "--keda", "localhost:0"];
    let mut child = coordinator(&arguments).stdout(Stdio::piped()).spawn().unwrap();
    let lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let said: Vec<String> = lines.take(2).map(Result::unwrap).collect();
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(said[0].starts_with("listening on 127.0.0.1:") && said[1].contains("http://127.0.0.1:"), "{said:?}");
}

#[test]
fn invalid_address_is_wrong_usage() {
    for option in ["--listen", "--metrics", "--keda"] {
        for wrong in ["localhost", "http://localhost:7077", "localhost:99999", "no-such-host.invalid:7077"] {
            let output = coordinator(&[option, wrong]).output().unwrap();
            let said = String::from_utf8(output.stderr).unwrap();
            assert_eq!(output.status.code(), Some(2), "{said}");
            assert!(said.contains("such as 127.0.0.1:7077") || said.contains("has no address"), "{said}");
        }
    }
}

#[test]
fn address_beyond_loopback_requires_encryption() {
    // The address of all interfaces stands for a name that resolves to an external address of this host.
    let output = coordinator(&["--listen", "0.0.0.0:0"]).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success() && said.contains("other machines can reach"), "{said}");
}
