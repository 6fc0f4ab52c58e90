//! Comparison of engine settings with a reference on the same gaits.

use super::{Fidelity, arrival, compare, disturbed};
use crate::clock::Spent;
use crate::setting::PhysicsSetting;
use crate::speed::{rollouts, simulated_per_cpu, turns};
use crate::statistics::Estimate;
use crate::threads::in_order;
use serde::Serialize;
use sim_core::engines::engine;
use sim_core::model::{Place, State};
use sim_core::physics::{Engine, Motion, Physics, Request, Rollout};
use sim_core::problem::Job;

/// Settings that a study compares.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// Setting that all others are compared with.
    pub reference: PhysicsSetting,
    /// Reference with half its substep, and reference with half its step.
    pub halved: [PhysicsSetting; 2],
    /// Settings to compare with the reference.
    pub settings: Vec<PhysicsSetting>,
}

/// Results of a comparison on gaits of one kind.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Set {
    /// Kind of the gaits: "random" or "evolved".
    pub gaits: &'static str,
    /// Speed of the reference, simulated s per CPU s.
    pub reference_speed: Estimate,
    /// Results of each setting compared with the reference.
    pub settings: Vec<ComparisonRow>,
    /// Results of the reference with half its step or substep, compared with the reference.
    pub halved: Vec<Halved>,
    /// Results of the reference from disturbed starts, compared with the reference.
    pub ceiling: Ceiling,
}

/// Results of one setting compared with the reference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ComparisonRow {
    /// Engine setting.
    pub setting: PhysicsSetting,
    /// Its speed and fidelity.
    #[serde(flatten)]
    pub against: Against,
}

/// Speed, and fidelity to the reference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Against {
    /// Speed, simulated s per CPU s.
    #[serde(rename = "simulated_per_cpu")]
    pub speed: Estimate,
    /// Agreement with the reference; `null` if no gait completed with both settings.
    pub fidelity: Option<Fidelity>,
}

/// Results of the reference from starts with joint angles disturbed by 1e-6 rad, compared with the reference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ceiling {
    /// Speed and fidelity from the disturbed starts.
    #[serde(flatten)]
    pub against: Against,
}

/// Results of the reference with half its step or substep, compared with the reference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Halved {
    /// Engine setting.
    pub setting: PhysicsSetting,
    /// True if halving changes the results no more than the disturbed starts do: the lower end of the interval of the
    /// median position error is at most the upper end of the ceiling's interval.
    pub within_ceiling: bool,
    /// Its speed and fidelity.
    #[serde(flatten)]
    pub against: Against,
}

impl Halved {
    fn new(setting: PhysicsSetting, against: Against, ceiling: &Ceiling) -> Self {
        let within_ceiling = match (&against.fidelity, &ceiling.against.fidelity) {
            (Some(halved), Some(ceiling)) => halved.position.median.low <= ceiling.position.median.high,
            _ => false,
        };
        Self { setting, within_ceiling, against }
    }
}

/// Engine, physics and start with which every gait is simulated.
struct Variant {
    engine: &'static dyn Engine,
    physics: Physics,
    disturbed: bool,
}

/// Final place of a gait simulated with a variant, and the time spent.
struct Run {
    end: Option<Place>,
    /// Simulated time, s.
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
            settings.map(|(setting, variant)| ComparisonRow { setting: *setting, against: against(variant) }).collect();
        Set { gaits: name, reference_speed: speed(0), settings, halved, ceiling }
    }

    /// Returns the variants in this order: reference, reference from disturbed starts, reference with half its substep
    /// and step, settings.
    fn variants(&self, job: &Job) -> Vec<Variant> {
        let variant = |s: &PhysicsSetting, disturbed| Variant {
            engine: engine(s.engine),
            physics: s.apply(job.physics()),
            disturbed,
        };
        let mut variants = vec![variant(&self.reference, false), variant(&self.reference, true)];
        variants.extend(self.halved.iter().chain(&self.settings).map(|s| variant(s, false)));
        variants
    }
}

/// Simulates every gait with every variant. The variants take turns, so that a change of the machine's load affects all
/// alike. Results are ordered by variant, then by gait.
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

/// Simulates some gaits with one variant, each from the start or, if the variant asks for it, from a disturbed start.
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
