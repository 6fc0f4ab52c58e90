//! `evogait bench dispatch`.

use crate::arguments::BenchDispatch;
use crate::error::Error;

/// Measures and tells.
pub fn run(_args: BenchDispatch, _quiet: bool) -> Result<(), Error> {
    Err(Error::Usage { message: "bench dispatch is not there yet".to_owned() })
}
