//! Speed of engine settings: simulated time per CPU time over the same gaits.

use crate::clock::{Spent, timed};
use crate::setting::PhysicsSetting;
use crate::statistics::{Estimate, bootstrap};
use serde::Serialize;
use sim_core::base::random::{Purpose, Stream};
use sim_core::engines::engine;
use sim_core::model::Robot;
use sim_core::model::environment::Block;
use sim_core::physics::{Engine, Motion, Outcome, Physics, Request, Rollout};
use sim_core::problem::Job;
use std::ops::Range;

/// Minimum number of gaits in a batch for an engine with lanes. Smaller batches give no representative speed.
const BATCH: usize = 64;

/// Speed of one setting over all gaits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SpeedRow {
    /// Engine setting.
    pub setting: PhysicsSetting,
    /// Simulated s per CPU s, with its 95 % bootstrap interval over the gaits.
    pub simulated_per_cpu: Estimate,
    /// Simulated s per s of wall time.
    pub simulated_per_wall: f64,
    /// CPU time per step, µs.
    pub step_us: f64,
    /// Number of rollouts that did not complete.
    pub unstable: u32,
}

/// Simulates every gait with every setting on flat ground, on the calling thread. `each` is called after every gait.
pub fn measure(job: &Job, settings: &[PhysicsSetting], gaits: &[Motion], each: &dyn Fn()) -> Vec<SpeedRow> {
    let physics: Vec<(&dyn Engine, Physics)> =
        settings.iter().map(|s| (engine(s.engine), s.apply(job.physics()))).collect();
    let mut spent: Vec<Vec<(f64, Spent)>> = vec![Vec::new(); settings.len()];
    let mut unstable = vec![0; settings.len()];
    for turn in turns(gaits.len(), physics.iter().any(|(engine, _)| engine.lanes() > 1)) {
        let requests: Vec<Request<'_>> =
            gaits[turn.clone()].iter().map(|motion| Request { start: job.start(), motion }).collect();
        for (i, (engine, physics)) in physics.iter().enumerate() {
            for (rollout, time) in rollouts(*engine, job.robot(), physics, &[], &requests) {
                spent[i].push((rollout.simulated_ms as f64 / 1000.0, time));
                unstable[i] += u32::from(rollout.outcome != Outcome::Completed);
            }
        }
        turn.for_each(|_| each());
    }
    let row = |(i, setting): (usize, &PhysicsSetting)| {
        let simulated: f64 = spent[i].iter().map(|(simulated, _)| simulated).sum();
        let mut total = Spent::default();
        spent[i].iter().for_each(|(_, time)| total += *time);
        SpeedRow {
            setting: *setting,
            simulated_per_cpu: simulated_per_cpu(&spent[i]),
            simulated_per_wall: simulated / total.wall,
            step_us: 1e6 * total.cpu / (simulated * f64::from(setting.steps_per_second)),
            unstable: unstable[i],
        }
    };
    settings.iter().enumerate().map(row).collect()
}

/// Splits gaits into ranges. All settings simulate one range before the next range begins, so that a change of the
/// machine's load affects all settings alike. Without lanes, a range holds one gait. With lanes, it holds at least 64
/// gaits, or all if there are fewer.
pub fn turns(gaits: usize, lanes: bool) -> Vec<Range<usize>> {
    if !lanes {
        return (0..gaits).map(|i| i..i + 1).collect();
    }
    let turns = (gaits / BATCH).max(1);
    (0..turns).map(|i| i * BATCH..if i + 1 == turns { gaits } else { (i + 1) * BATCH }).collect()
}

/// Simulates requests and measures the time of each. An engine with lanes simulates all requests in one batch; each
/// request is then assigned an equal share of the time.
pub fn rollouts(
    engine: &dyn Engine,
    robot: &Robot,
    physics: &Physics,
    terrain: &[Block],
    requests: &[Request<'_>],
) -> Vec<(Rollout, Spent)> {
    let together = if engine.lanes() > 1 { requests.len().max(1) } else { 1 };
    let run = |batch: &[Request<'_>]| {
        let (rollouts, spent) = timed(|| engine.run(robot, physics, terrain, batch));
        let share = spent.share(rollouts.len());
        rollouts.into_iter().map(move |rollout| (rollout, share)).collect::<Vec<_>>()
    };
    requests.chunks(together).flat_map(run).collect()
}

/// Returns simulated s per CPU s over gaits, with its 95 % bootstrap interval; 0 without gaits. Each gait is given as
/// (simulated s, time spent).
pub fn simulated_per_cpu(gaits: &[(f64, Spent)]) -> Estimate {
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
    fn engines_with_lanes_get_batches_of_64_gaits() {
        let lengths = |gaits, lanes| turns(gaits, lanes).into_iter().map(|turn| turn.len()).collect::<Vec<_>>();
        assert_eq!(lengths(3, false), [1, 1, 1]);
        assert_eq!(lengths(10, true), [10]);
        assert_eq!(lengths(100, true), [100]);
        assert_eq!(lengths(130, true), [64, 66]);
        assert_eq!(turns(130, true).into_iter().flatten().collect::<Vec<_>>(), (0..130).collect::<Vec<_>>());
    }

    #[test]
    fn speed_of_equal_gaits_has_zero_width_interval() {
        let gait = (3.0, Spent { wall: 1.0, cpu: 0.5 });
        assert_eq!(simulated_per_cpu(&[gait; 5]), Estimate { value: 6.0, low: 6.0, high: 6.0 });
        assert_eq!(simulated_per_cpu(&[]).value, 0.0);
    }
}
