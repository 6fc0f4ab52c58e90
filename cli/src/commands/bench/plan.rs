//! `evogait bench plan`.

use crate::arguments::BenchPlan;
use crate::error::Error;

/// Measures and tells.
pub fn run(_args: BenchPlan, _quiet: bool) -> Result<(), Error> {
    Err(Error::Usage { message: "bench plan is not there yet".to_owned() })
}
