//! The task that ended a job by failing too often: what it was, and how to see it happen on this machine.

use crate::console::quoted;
use crate::view::question;
use proto::v1::Poisoned;
use std::path::Path;

/// The task, for people.
pub fn what(poisoned: &Poisoned) -> String {
    let asked = question(poisoned.question()).map_or_else(String::new, |q| format!("the question {q} about "));
    format!("{asked}candidate {} of generation {}", poisoned.candidate, poisoned.generation)
}

/// Numbers as `--genome` takes them, each with all its bits.
pub fn genome(poisoned: &Poisoned) -> String {
    poisoned.genome.iter().map(f64::to_string).collect::<Vec<_>>().join(",")
}

/// The command for a job of a coordinator.
pub fn command_there(id: &str) -> String {
    format!("evogait evaluate {}", quoted(id))
}

/// The command for a job file.
pub fn command_here(file: &Path, poisoned: &Poisoned) -> String {
    let asked = question(poisoned.question()).map_or_else(String::new, |q| format!(" --question {q}"));
    format!(
        "evogait evaluate {} --generation {} --candidate {}{asked} --genome={}",
        quoted(file.display()),
        poisoned.generation,
        poisoned.candidate,
        genome(poisoned)
    )
}
