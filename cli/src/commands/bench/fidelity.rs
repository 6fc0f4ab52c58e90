//! `evogait bench fidelity`.

use crate::arguments::BenchFidelity;
use crate::error::Error;

/// Measures and tells.
pub fn run(_args: BenchFidelity, _quiet: bool) -> Result<(), Error> {
    Err(Error::Usage { message: "bench fidelity is not there yet".to_owned() })
}
