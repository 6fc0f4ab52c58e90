//! Options of `evogait completions` and `evogait man`.

use clap::Args;
use clap_complete::Shell;
use std::path::PathBuf;

/// Options of `evogait completions`.
#[derive(Debug, Args)]
pub struct Completions {
    /// Shell that the script is for
    pub shell: Shell,
}

/// Options of `evogait man`.
#[derive(Debug, Args)]
pub struct Man {
    /// Write a page for each command to this folder [default: print the page of `evogait`]
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}
