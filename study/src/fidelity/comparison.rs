//! Engine settings compared with a reference on the same gaits.

use super::{Fidelity, arrival, compare, disturbed};
use crate::clock::Spent;
use crate::setting::Setting;
use crate::speed::{rollouts, simulated_per_cpu, turns};
use crate::statistics::Estimate;
use crate::threads::in_order;
use serde::Serialize;
use sim_core::engines::engine;
use sim_core::model::{Place, State};
use sim_core::physics::{Engine, Motion, Physics, Request, Rollout};
use sim_core::problem::Job;

/// The settings that a study compares.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// The reference.
    pub reference: Setting,
    /// The reference with half its substep, and with half its step.
    pub halved: [Setting; 2],
    /// The settings to judge.
    pub settings: Vec<Setting>,
}

/// All results with one kind of gaits.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Set {
    /// "random" or "evolved".
    pub gaits: &'static str,
    /// Simulated s per CPU s.
    pub reference_speed: Estimate,
    /// The settings against the reference.
    pub settings: Vec<Row>,
    /// Half the reference's step against the reference.
    pub halved: Vec<Halved>,
    /// The reference against itself.
    pub ceiling: Ceiling,
}

/// One setting against the reference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// The setting.
    pub setting: Setting,
    /// Its speed and fidelity.
    #[serde(flatten)]
    pub against: Against,
}

/// Speed, and fidelity to the reference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Against {
    /// Simulated s per CPU s.
    #[serde(rename = "simulated_per_cpu")]
    pub speed: Estimate,
    /// `null` if no gait completed with both.
    pub fidelity: Option<Fidelity>,
}

/// The reference against itself, from starts whose joint angles are off by a millionth rad.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ceiling {
    /// Speed and fidelity from these starts.
    #[serde(flatten)]
    pub against: Against,
}

/// Half the reference's step against the reference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Halved {
    /// The setting.
    pub setting: Setting,
    /// True if halving changes no more than the ceiling allows: the interval of the median position error begins no
    /// higher than the ceiling's ends.
    pub within_ceiling: bool,
    /// Its speed and fidelity.
    #[serde(flatten)]
    pub against: Against,
}

impl Halved {
    fn new(setting: Setting, against: Against, ceiling: &Ceiling) -> Self {
        let within_ceiling = match (&against.fidelity, &ceiling.against.fidelity) {
            (Some(halved), Some(ceiling)) => halved.position.median.low <= ceiling.position.median.high,
            _ => false,
        };
        Self { setting, within_ceiling, against }
    }
}

/// One way to simulate every gait.
struct Variant {
    engine: &'static dyn Engine,
    physics: Physics,
    disturbed: bool,
}

/// The end of a gait with a variant, and the time it took.
struct Run {
    end: Option<Place>,
    /// s.
    simulated: f64,
    spent: Spent,
}

impl Comparison {
    /// Compares all settings on gaits of one kind, on `threads` threads (at least 1). `each` is called after every
    /// gait.
    pub fn measure(
        &self,
        job: &Job,
        gaits: (&'static str, &[Motion]),
        threads: usize,
        each: &(dyn Fn() + Sync),
    ) -> Set {
        let (name, gaits) = gaits;
        let runs = simulate(job, &self.variants(job), gaits, threads, each);
        let ends = |variant: usize| runs[variant].iter().map(|run| run.end).collect::<Vec<_>>();
        let speed = |variant: usize| {
            simulated_per_cpu(&runs[variant].iter().map(|run| (run.simulated, run.spent)).collect::<Vec<_>>())
        };
        let reference = ends(0);
        let against = |variant: usize| Against { speed: speed(variant), fidelity: compare(&reference, &ends(variant)) };
        let ceiling = Ceiling { against: against(1) };
        let halved = self.halved.iter().zip(2..);
        let halved = halved.map(|(setting, variant)| Halved::new(*setting, against(variant), &ceiling)).collect();
        let settings = self.settings.iter().zip(2 + self.halved.len()..);
        let settings =
            settings.map(|(setting, variant)| Row { setting: *setting, against: against(variant) }).collect();
        Set { gaits: name, reference_speed: speed(0), settings, halved, ceiling }
    }

    /// The reference, the same from disturbed starts, those with half its step, then the settings.
    fn variants(&self, job: &Job) -> Vec<Variant> {
        let variant =
            |s: &Setting, disturbed| Variant { engine: engine(s.engine), physics: s.apply(job.physics()), disturbed };
        let mut variants = vec![variant(&self.reference, false), variant(&self.reference, true)];
        variants.extend(self.halved.iter().chain(&self.settings).map(|s| variant(s, false)));
        variants
    }
}

/// Simulates every gait with every variant, by turns, so that all variants see the same machine. By variant, then by
/// gait.
fn simulate(
    job: &Job,
    variants: &[Variant],
    gaits: &[Motion],
    threads: usize,
    each: &(dyn Fn() + Sync),
) -> Vec<Vec<Run>> {
    let turns = turns(gaits.len(), variants.iter().any(|v| v.engine.lanes() > 1));
    let (start, from) = job.start_among_terrain();
    let done = in_order(turns.len(), threads, |i| {
        let turn = turns[i].clone();
        let off: Vec<State> = turn.clone().map(|gait| disturbed(&start, gait as u32)).collect();
        let runs = |v: &Variant| all(job, v, &gaits[turn.clone()], (&start, &off, &from));
        let runs: Vec<Vec<Run>> = variants.iter().map(runs).collect();
        turn.clone().for_each(|_| each());
        runs
    });
    let mut runs: Vec<Vec<Run>> = variants.iter().map(|_| Vec::new()).collect();
    for turn in done {
        runs.iter_mut().zip(turn).for_each(|(all, some)| all.extend(some));
    }
    runs
}

/// Simulates some gaits with one variant, each from the start or from its disturbed one.
fn all(
    job: &Job,
    variant: &Variant,
    gaits: &[Motion],
    (start, disturbed, from): (&State, &[State], &Place),
) -> Vec<Run> {
    let start = |i: usize| if variant.disturbed { &disturbed[i] } else { start };
    let requests: Vec<Request<'_>> =
        gaits.iter().enumerate().map(|(i, motion)| Request { start: start(i), motion }).collect();
    let run = |(rollout, spent): (Rollout, Spent)| Run {
        end: arrival(&rollout, from),
        simulated: rollout.simulated_ms as f64 / 1000.0,
        spent,
    };
    let terrain = &job.environment().terrain;
    rollouts(variant.engine, job.robot(), &variant.physics, terrain, &requests).into_iter().map(run).collect()
}
