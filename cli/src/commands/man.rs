//! `evogait man`: man pages.

use crate::arguments::definition;
use crate::console;
use crate::error::Error;
use clap_mangen::{Man, generate_to};
use std::fs;
use std::path::Path;

/// Prints the page of `evogait`, or writes the pages of all commands to a folder.
pub fn run(out: Option<&Path>, quiet: bool) -> Result<(), Error> {
    let Some(folder) = out else {
        let mut page = Vec::new();
        Man::new(definition()).render(&mut page).expect("writing to memory never fails");
        return console::say(&String::from_utf8_lossy(&page));
    };
    fs::create_dir_all(folder).map_err(|e| Error::write(folder, e))?;
    generate_to(definition(), folder).map_err(|e| Error::write(folder, e))?;
    if !quiet {
        console::note(&format!("man pages are in {}", folder.display()));
    }
    Ok(())
}
