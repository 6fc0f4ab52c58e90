//! `evogait bench`: measurements on this machine, one file each.

mod dispatch;
mod evaluate;
mod fidelity;
mod fitness;
mod fleet;
mod genotypes;
mod plan;
mod reuse;
mod rollout;
mod soundness;
mod subject;

use crate::arguments::Bench;
use crate::error::Error;

/// Runs one measurement.
pub fn run(what: Bench, quiet: bool) -> Result<(), Error> {
    match what {
        Bench::Rollout(args) => rollout::run(args, quiet),
        Bench::Evaluate(args) => evaluate::run(args, quiet),
        Bench::Fidelity(args) => fidelity::run(args, quiet),
        Bench::Fitness(args) => fitness::run(args, quiet),
        Bench::Plan(args) => plan::run(args, quiet),
        Bench::Dispatch(args) => dispatch::run(args, quiet),
        Bench::Fleet(args) => fleet::run(args, quiet),
        Bench::Reuse(args) => reuse::run(args, quiet),
        Bench::Soundness(args) => soundness::run(args, quiet),
    }
}
