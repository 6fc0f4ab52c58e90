//! The candidates of a job: number and duration of their gaits, their space, and the gaits that the file gives.

use super::parts::Parts;
use super::{JobSpec, SimulateSpec, budget, plan, simulate};
use crate::base::error::{Faults, Invalid, whole_in_range};
use crate::base::limits;
use crate::control::{GaitsSpec, space_of, whole_steps};
use crate::genotype::{Genotype, Space};
use crate::model::environment::Environment;
use crate::physics::Physics;

/// Candidates of a job.
pub(super) struct Candidates {
    pub gaits: GaitsSpec,
    pub space: Space,
    /// The gaits that the file gives, if any.
    pub given: Option<Genotype>,
}

impl Candidates {
    /// Resolves the candidates, and checks the tables that depend on them. Writes `planner.stop_at_goal` into `spec`.
    pub fn resolve(spec: &mut JobSpec, parts: &Parts) -> Result<Self, Invalid> {
        let Parts { robot, environment, physics, finish, .. } = parts;
        let mut faults = Faults::default();
        let gaits = gaits_of(spec, physics);
        faults.take(whole_steps("gaits.duration", &gaits, physics.steps_per_second));
        if let Some(finish) = finish {
            faults.take(whole_steps("finish.steps_per_second", &gaits, finish.steps_per_second));
        }
        let space = faults.take(space_of(&gaits, robot));
        match &spec.simulate {
            Some(simulate) => faults.take(simulate.fits(robot, environment, gaits.count)),
            None => {
                faults.take(resolve_stop_at_goal(spec, environment));
                faults.take(budget::validate(spec, &gaits, environment, physics))
            }
        };
        if spec.optimiser.is_some() && space.is_some() {
            faults.take(gaits.controller.0.rules(robot, gaits.overlap));
        }
        let given = space.as_ref().and_then(|space| {
            check_optimiser(spec, space, &mut faults);
            given_gaits(spec, parts, &gaits, space, &mut faults)
        });
        faults.end()?;
        let Some(space) = space else { unreachable!("a missing space has left a fault") };
        Ok(Self { gaits, space, given })
    }
}

/// Returns the gaits of the file. A motion without gaits counts as one gait of the motion's duration.
fn gaits_of(spec: &JobSpec, physics: &Physics) -> GaitsSpec {
    spec.gaits.clone().unwrap_or_else(|| {
        let duration = spec.simulate.as_ref().and_then(SimulateSpec::duration).unwrap_or_default();
        GaitsSpec::of_motion(simulate::whole_time(duration, physics.steps_per_second))
    })
}

/// Checks that the optimiser can search this space, with generations of an allowed size.
fn check_optimiser(spec: &JobSpec, space: &Space, faults: &mut Faults) {
    let Some(optimiser) = &spec.optimiser else { return };
    let parameters = space.longest() as u64 * u64::from(optimiser.population());
    let most = limits::MAX_GENERATION_PARAMETERS as u64;
    let field = "parameters of a generation (candidates × length of the genome)";
    faults.take(whole_in_range(field, parameters, (1, most), ""));
    faults.take(optimiser.takes(space));
}

/// Returns the gaits that `[plan]` or `[simulate]` gives as a candidate of the space.
fn given_gaits(
    spec: &JobSpec,
    parts: &Parts,
    gaits: &GaitsSpec,
    space: &Space,
    faults: &mut Faults,
) -> Option<Genotype> {
    let sets = [
        ("plan.gaits", spec.plan.as_ref().map(|plan| &plan.gaits)),
        ("simulate.gaits", spec.simulate.as_ref().and_then(|simulate| simulate.gaits.as_ref())),
    ];
    let mut given = None;
    for (field, set) in sets.iter().filter_map(|(field, set)| Some((field, (*set)?))) {
        let set = faults.take(plan::written_out(field, set));
        given = set.and_then(|set| faults.take(set.genotype(field, &parts.robot, gaits, space)));
    }
    given
}

/// Resolves `planner.stop_at_goal`. Only jobs that plan write the value false out.
fn resolve_stop_at_goal(spec: &mut JobSpec, environment: &Environment) -> Result<(), Invalid> {
    let (plans, goal) = (spec.plan.is_some(), environment.goal.is_some());
    let stop = spec.planner.stop_at_goal.unwrap_or(plans && goal);
    if stop && !goal {
        let reason = format!(
            "environment \"{}\" has no goal: add `goal = {{ x = …, y = … }}` to it, or set this key to false",
            environment.name
        );
        return Err(Invalid::Conflict { field: "planner.stop_at_goal".into(), reason });
    }
    spec.planner.stop_at_goal = (stop || plans).then_some(stop);
    Ok(())
}
