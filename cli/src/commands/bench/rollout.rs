//! `evogait bench rollout`.

use crate::arguments::BenchRollout;
use crate::error::Error;

/// Measures and tells.
pub fn run(_args: BenchRollout, _quiet: bool) -> Result<(), Error> {
    Err(Error::Usage { message: "bench rollout is not there yet".to_owned() })
}
