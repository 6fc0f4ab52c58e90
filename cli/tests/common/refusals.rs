//! Errors of `evogait validate` for jobs, robots and environments, each with the change that causes it.
#![allow(dead_code)] // each test file uses only a part

use crate::common::{listing, run};
use std::fs;
use tempfile::TempDir;

/// Robot of two modules with one joint each.
pub const MODULES: &str = r#"
name = "worm"
pivot = "a"
failed = []
variants = {}
module = [
    { name = "a", kind = "cosmo" },
    { name = "b", kind = "cosmo", attach = { to = "a", port = "front" } },
]
"#;

/// Robot of two bodies with a hinge.
pub const BODIES: &str = r#"
name = "rod"
pivot = "base"
failed = []
variants = {}
module = []

[[body]]
name = "base"
mass = 1.0
center_of_mass = [0.0, 0.0, 0.0]
inertia = [0.1, 0.1, 0.1, 0.0, 0.0, 0.0]
box = [{ center = [0.0, 0.0, 0.0], rotation = [0.0, 0.0, 0.0, 1.0], half = [0.4, 0.2, 0.2] }]

[[body]]
name = "arm"
mass = 0.5
center_of_mass = [0.55, 0.0, 0.0]
inertia = [0.05, 0.05, 0.05, 0.0, 0.0, 0.0]
capsule = [{ from = [0.3, 0.0, 0.0], to = [0.8, 0.0, 0.0], radius = 0.1 }]

[body.hinge]
name = "joint"
parent = "base"
anchor = [0.4, 0.0, 0.0]
axis = [0.0, 0.0, 1.0]
limits = [-1.0, 1.0]
speed = 5.0
torque = 10.0
"#;

/// Environment with an obstacle and a goal.
pub const YARD: &str = r#"
name = "yard"
size = [20.0, 10.0]
start = { x = -5.0, y = 0.0, yaw = 0.0 }
goal = { x = 5.0, y = 0.0 }

[[obstacle]]
center = [0.0, 0.0]
size = [2.0, 2.0]
base = 0.0
top = 1.0
yaw = 0.5
"#;

/// Job that evolves.
pub const EVOLVE: &str = r#"
name = "small"
robot = "robot.toml"
environment = "yard.toml"
gaits.count = 2
gaits.duration = 3.0
fitness.kind = "coverage"
optimiser.kind = "pso"
"#;

/// Changes lines of a job, which are all `key = value`. A change is a line, which replaces the line with its key or is
/// added; or `without KEY`, which removes a key or a table.
pub fn changed(job: &str, changes: &[&str]) -> String {
    let mut lines: Vec<&str> = job.trim().lines().collect();
    for change in changes {
        let before = lines.len();
        if let Some(removed) = change.strip_prefix("without ") {
            let within = |line: &str| line.strip_prefix(removed).is_some_and(|rest| rest.starts_with([' ', '.']));
            lines.retain(|line| !within(line));
            assert!(lines.len() < before, "the job has no {removed}");
        } else {
            let (key, _) = change.split_once(" = ").expect("a change is `key = value` or `without KEY`");
            lines.retain(|line| line.split_once(" = ").is_none_or(|(own, _)| own != key));
            lines.push(change);
        }
    }
    lines.join("\n")
}

/// Returns the errors of a job for each set of [changed] lines, after a line with the job's procedure and the changes.
/// `files` are further files of its folder.
pub fn of_lines(job: &str, files: &[(&str, &str)], cases: &[&[&str]]) -> Vec<String> {
    let procedure = job.lines().find(|line| line.starts_with("procedure"));
    let refused = |case: &&[&str]| {
        let cause: Vec<&str> = procedure.iter().chain(case.iter()).copied().collect();
        let job = changed(job, case);
        let files = [files, &[("job.toml", job.as_str())]].concat();
        titled(&cause.join(", "), &refusal(&["validate", "job.toml"], &files))
    };
    cases.iter().map(refused).collect()
}

/// Returns the errors of a job that evolves, with a text of one line in one of its files replaced, after the new line.
pub fn of_texts(file: &str, text: &str, cases: &[(&str, &str)]) -> Vec<String> {
    let refused = |(from, to): &(&str, &str)| {
        let changed = text.replacen(from, to, 1);
        let (_, line) = text.lines().zip(changed.lines()).find(|(old, new)| old != new).expect("the text must change");
        titled(line.trim().trim_end_matches(','), &refusal(&["validate", "job.toml"], &[(file, &changed)]))
    };
    cases.iter().map(refused).collect()
}

/// Returns an error after a line with its cause.
pub fn titled(cause: &str, error: &str) -> String {
    format!("{cause}\n{error}")
}

/// Runs a command that must fail and leave the folder unchanged; returns its error. The folder has the files of a job
/// that evolves; `files` replace them or are added.
pub fn refusal(arguments: &[&str], files: &[(&str, &str)]) -> String {
    let folder = folder(files);
    let before = listing(folder.path());
    let seen = run(folder.path(), arguments);
    assert_eq!((seen.code, seen.out.as_str()), (1, ""), "{arguments:?} {files:?}: {}", seen.err);
    assert_eq!(listing(folder.path()), before, "{arguments:?} {files:?}");
    seen.err
}

/// Fails the test if the job with these files is refused. So each error of a changed job has the change as its only
/// cause.
pub fn must_be_valid(files: &[(&str, &str)]) {
    run(folder(files).path(), &["validate", "job.toml", "--no-estimate"]).success();
}

/// Creates a temporary folder with the files of a job that evolves. `files` replace them or are added.
pub fn folder(files: &[(&str, &str)]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let own = [("job.toml", EVOLVE), ("robot.toml", MODULES), ("yard.toml", YARD)];
    for (name, content) in own.iter().chain(files) {
        fs::write(folder.path().join(name), content).unwrap();
    }
    folder
}
