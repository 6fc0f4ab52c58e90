//! File of the fidelity table.

use crate::error::Error;
use crate::output::atomic::write_file;
use sim_core::engines::fidelity::{FidelityRow, FidelityTable};
use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use study::fidelity::table::{Unfit, merge};

/// Returns the error for a comparison that gives no rows of the table.
pub fn refused(why: Unfit) -> Error {
    Error::Usage { message: format!("--table can't be written: {why}") }
}

/// Replaces the rows of one robot in a table's file. Creates the file if it does not exist.
pub fn keep(path: &Path, rows: Vec<FidelityRow>) -> Result<(), Error> {
    let mut known = match fs::read_to_string(path) {
        Ok(text) => FidelityTable::from_toml(&text)
            .map_err(|source| Error::Invalid { file: path.display().to_string(), source })?,
        Err(e) if e.kind() == ErrorKind::NotFound => FidelityTable::default(),
        Err(e) => return Err(Error::read(path, e)),
    };
    merge(&mut known, rows);
    write_file(path, known.to_toml().as_bytes())
}
