//! Helpers that run the built command and check its output.
#![allow(dead_code)] // each test file uses only a part

use std::path::Path;
use std::process::{Command, Output, Stdio};

/// Returns the command, in a folder and without environment variables that change its output.
pub fn evogait(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_evogait"));
    command.args(arguments).current_dir(folder).stdin(Stdio::null());
    for variable in ["EVOGAIT_COORDINATOR", "EVOGAIT_LOG", "COLUMNS", "NO_COLOR"] {
        command.env_remove(variable);
    }
    command
}

/// Exit code and output of a command.
pub struct Seen {
    /// Exit code.
    pub code: i32,
    /// Standard output.
    pub out: String,
    /// Standard error.
    pub err: String,
}

impl Seen {
    /// Converts the output of an ended command. Fails the test if the command panicked.
    pub fn of(output: Output) -> Self {
        let text = |bytes| String::from_utf8(bytes).expect("all output must be UTF-8");
        let seen = Self {
            code: output.status.code().expect("the command must end with an exit code, not by a signal"),
            out: text(output.stdout),
            err: text(output.stderr),
        };
        assert!(!seen.err.contains("panicked"), "{}", seen.err);
        assert_ne!(seen.code, 101, "{}", seen.err);
        seen
    }

    /// Returns standard output; fails the test if the command failed.
    pub fn success(self) -> String {
        assert_eq!(self.code, 0, "{}{}", self.err, self.out);
        self.out
    }

    /// Parses standard output as JSON.
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.out).unwrap_or_else(|e| panic!("{e}: {}{}", self.out, self.err))
    }
}

/// Runs a command to its end.
pub fn run(folder: &Path, arguments: &[&str]) -> Seen {
    Seen::of(evogait(folder, arguments).output().expect("the command must start"))
}

/// Returns the paths of all files and folders below a folder, sorted, including hidden ones.
pub fn listing(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for entry in std::fs::read_dir(&next).unwrap() {
            let path = entry.unwrap().path();
            found.push(path.strip_prefix(folder).unwrap().display().to_string());
            if path.is_dir() {
                open.push(path);
            }
        }
    }
    found.sort();
    found
}

/// Job that takes about one second: gaits of 3 s, 4 iterations, 2 generations of 3 candidates.
pub const SMALL_JOB: &str = r#"
name = "small"
seed = 1
robot = "quadropod"
environment = "empty"

[gaits]
count = 2
duration = 3.0

[planner]
iterations = 4

[fitness]
kind = "coverage"
cell = 0.5

[optimiser]
kind = "pso"
particles = 3
generations = 2

[finish]
archive = 3
"#;
