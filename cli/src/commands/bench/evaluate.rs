//! `evogait bench evaluate`.

use crate::arguments::BenchEvaluate;
use crate::error::Error;

/// Measures and tells.
pub fn run(_args: BenchEvaluate, _quiet: bool) -> Result<(), Error> {
    Err(Error::Usage { message: "bench evaluate is not there yet".to_owned() })
}
