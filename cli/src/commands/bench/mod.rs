//! `evogait bench`: what things cost on this machine, a file each.

mod dispatch;
mod evaluate;
mod fidelity;
mod fitness;
mod fleet;
mod gaits;
mod genotypes;
mod plan;
mod reuse;
mod rollout;
mod soundness;
mod subject;

use crate::arguments::Bench;
use crate::error::Error;
use sim_core::base::random::{Purpose, Stream};
use sim_core::model::Robot;
use sim_core::model::environment::Block;
use sim_core::physics::{Engine, Physics, Request, Rollout};
use std::ops::Range;
use study::clock::{Spent, timed};
use study::statistics::{Estimate, bootstrap};

/// Least gaits that an engine with lanes gets at once: speeds of fewer say little.
const BATCH: usize = 64;

/// Measures what was asked for.
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

/// Gaits in the order they are simulated: those of a range with one setting, then with the next. One by one, unless an
/// engine has lanes to fill.
fn turns(gaits: usize, lanes: bool) -> Vec<Range<usize>> {
    if !lanes {
        return (0..gaits).map(|i| i..i + 1).collect();
    }
    let turns = (gaits / BATCH).max(1);
    (0..turns).map(|i| i * BATCH..if i + 1 == turns { gaits } else { (i + 1) * BATCH }).collect()
}

/// Rollouts and what each took. An engine with lanes gets all at once, and each takes an equal share.
fn rollouts(
    engine: &dyn Engine,
    robot: &Robot,
    physics: &Physics,
    terrain: &[Block],
    requests: &[Request<'_>],
) -> Vec<(Rollout, Spent)> {
    let together = if engine.lanes() > 1 { requests.len().max(1) } else { 1 };
    let run = |batch: &[Request<'_>]| {
        let (rollouts, Spent { wall, cpu }) = timed(|| engine.run(robot, physics, terrain, batch));
        let n = rollouts.len() as f64;
        rollouts.into_iter().map(move |rollout| (rollout, Spent { wall: wall / n, cpu: cpu / n })).collect::<Vec<_>>()
    };
    requests.chunks(together).flat_map(run).collect()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn engines_with_lanes_get_whole_batches_and_every_gait_has_its_turn() {
        let lengths = |gaits, lanes| turns(gaits, lanes).into_iter().map(|turn| turn.len()).collect::<Vec<_>>();
        assert_eq!(lengths(3, false), [1, 1, 1]);
        assert_eq!(lengths(10, true), [10]);
        assert_eq!(lengths(100, true), [100]);
        assert_eq!(lengths(130, true), [64, 66]);
        assert_eq!(turns(130, true).into_iter().flatten().collect::<Vec<_>>(), (0..130).collect::<Vec<_>>());
    }
}
