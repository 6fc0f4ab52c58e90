//! Runs the built command and looks at what a user would see.
#![allow(dead_code)] // each test file uses a part of it

use std::path::Path;
use std::process::{Command, Output, Stdio};

/// The command with a clean environment, in a folder.
pub fn evogait(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_evogait"));
    command.args(arguments).current_dir(folder).stdin(Stdio::null());
    for variable in ["EVOGAIT_COORDINATOR", "EVOGAIT_LOG", "COLUMNS", "NO_COLOR"] {
        command.env_remove(variable);
    }
    command
}

/// What came of it, as text. Panics (and so fails the test) if the command did.
pub struct Seen {
    /// The exit code.
    pub code: i32,
    /// Standard output.
    pub out: String,
    /// Standard error.
    pub err: String,
}

impl Seen {
    /// Of a command that has ended.
    pub fn of(output: Output) -> Self {
        let text = |bytes| String::from_utf8(bytes).expect("all output is UTF-8");
        let seen = Self {
            code: output.status.code().expect("the command ends by itself"),
            out: text(output.stdout),
            err: text(output.stderr),
        };
        assert!(!seen.err.contains("panicked"), "{}", seen.err);
        assert_ne!(seen.code, 101, "{}", seen.err);
        seen
    }

    /// Standard output of a command that succeeded.
    pub fn success(self) -> String {
        assert_eq!(self.code, 0, "{}{}", self.err, self.out);
        self.out
    }

    /// Standard output as JSON.
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.out).unwrap_or_else(|e| panic!("{e}: {}{}", self.out, self.err))
    }
}

/// Runs to the end.
pub fn run(folder: &Path, arguments: &[&str]) -> Seen {
    Seen::of(evogait(folder, arguments).output().expect("the command starts"))
}

/// Names of all files and folders below a folder, sorted; hidden ones too.
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

/// A job that takes about a second: three seconds a gait, four iterations, two generations of three.
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
