//! `evogait bench`: what things cost on this machine, a file each.

mod dispatch;
mod evaluate;
mod fidelity;
mod gaits;
mod plan;
mod reuse;
mod rollout;
mod subject;

use crate::arguments::Bench;
use crate::clock::Spent;
use crate::error::Error;
use sim_core::measure::statistics::{Estimate, bootstrap};
use sim_core::random::{Purpose, Stream};

/// Measures what was asked for.
pub fn run(what: Bench, quiet: bool) -> Result<(), Error> {
    match what {
        Bench::Rollout(args) => rollout::run(args, quiet),
        Bench::Evaluate(args) => evaluate::run(args, quiet),
        Bench::Fidelity(args) => fidelity::run(args, quiet),
        Bench::Plan(args) => plan::run(args, quiet),
        Bench::Dispatch(args) => dispatch::run(args, quiet),
        Bench::Reuse(args) => reuse::run(args, quiet),
    }
}

/// Simulated s a CPU s over gaits, given as (simulated s, time it took), with its 95 % interval.
fn speed(gaits: &[(f64, Spent)]) -> Estimate {
    let ratio = |members: &[usize]| {
        let sum = |of: &dyn Fn(&(f64, Spent)) -> f64| members.iter().map(|&i| of(&gaits[i])).sum::<f64>();
        let (simulated, cpu) = (sum(&|g| g.0), sum(&|g| g.1.cpu));
        (cpu > 0.0).then(|| simulated / cpu)
    };
    let mut stream = Stream::new(0, Purpose::Bootstrap, 0, 0, 0);
    let unknown = Estimate { value: 0.0, low: 0.0, high: 0.0 };
    bootstrap(gaits.len() as u32, &mut stream, ratio).unwrap_or(unknown)
}
