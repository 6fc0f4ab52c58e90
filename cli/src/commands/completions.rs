//! `evogait completions`: completion scripts for shells.

use crate::arguments::definition;
use crate::console;
use crate::error::Error;
use clap_complete::{Shell, generate};

/// Prints the completion script of a shell.
pub fn run(shell: Shell) -> Result<(), Error> {
    let mut script = Vec::new();
    generate(shell, &mut definition(), "evogait", &mut script);
    console::say(&String::from_utf8_lossy(&script))
}
