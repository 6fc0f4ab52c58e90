//! `evogait simulate`: writes a job that simulates a motion, and runs it.

use super::run::carry_out;
use super::source_run::{SourceRun, read};
use crate::arguments::{GivenBy, Simulate, SimulateWhat};
use crate::error::Error;
use crate::load;
use sim_core::base::limits::MAX_NAME_LENGTH;
use sim_core::job::{JobSpec, Reference};
use sim_core::model::RobotSpec;
use sim_core::physics::{EngineChoice, Physics, PhysicsSpec};
use sim_core::plan::PlannerSpec;
use sim_core::problem::{Checked, ReplanSpec, SIMULATE, SimulateSpec};

/// Creates the job and runs it like `evogait run`.
pub fn run(args: Simulate, quiet: bool) -> Result<(), Error> {
    let (mut spec, label) = match &args.of {
        GivenBy::Run(of) => of_run(&args, read(of)?)?,
        GivenBy::Robot(robot) => of_robot(&args, robot)?,
    };
    spec.seed = args.seed.unwrap_or(spec.seed);
    if let Some(simulate) = &mut spec.simulate {
        simulate.repeats = args.repeats;
        simulate.vary = args.vary.clone();
        simulate.ways = args.way.map(|way| vec![way]);
    }
    let job = Checked::new(spec).map_err(|source| Error::Invalid { file: label, source })?;
    carry_out(&job, args.to, quiet)
}

/// Returns the job for a motion of a run's gaits or robot, and its name in messages.
fn of_run(args: &Simulate, given: SourceRun) -> Result<(JobSpec, String), Error> {
    let mut spec = given.job.spec().clone();
    environment(args, &mut spec)?;
    let planner = PlannerSpec { repeats: 1, max_rollouts: None, stop_at_goal: None, ..spec.planner.clone() };
    let (searched, called) = (spec.physics.clone(), &given.called);
    let fine = args.fine || args.replan.is_some();
    if fine {
        spec.physics = finer(&spec.physics);
    }
    let mut simulate = SimulateSpec::default();
    let what = match &args.what {
        SimulateWhat::Gait(gait) => {
            (simulate.steps, simulate.gaits) = (Some(vec![*gait]), Some(given.set()));
            format!("gait-{gait}")
        }
        SimulateWhat::Plan => {
            // In another environment the first plan is made by the job itself.
            if args.environment.is_none() {
                let (steps, places) = given.plan()?;
                (simulate.steps, simulate.places) = (Some(steps), Some(places));
            } else if args.replan.is_none() {
                return Err(elsewhere(args, &given));
            }
            simulate.gaits = Some(given.set());
            "plan".to_owned()
        }
        SimulateWhat::Targets(path) => {
            simulate.targets = Some(Reference::Inline(Box::new(crate::target_table::read(path, given.job.robot())?)));
            "targets".to_owned()
        }
        SimulateWhat::Stand(seconds) => {
            simulate.stand = Some(*seconds);
            "stand".to_owned()
        }
    };
    if let Some(deviation) = args.replan {
        let default = ReplanSpec::default();
        simulate.replan =
            Some(ReplanSpec { deviation: deviation.unwrap_or(default.deviation), physics: Some(searched), ..default });
        simulate.gaits = Some(given.set());
    }
    spec.planner = if simulate.replan.is_some() { planner } else { PlannerSpec::default() };
    if simulate.gaits.is_none() {
        spec.gaits = None;
    }
    spec.description = format!("Simulates {what} of {} ({}).", spec.name, given.job.digest().short());
    spec.name = format!("{}-{what}", spec.name).chars().take(MAX_NAME_LENGTH).collect();
    let label = format!("{what} of {called}");
    Ok((simulating(spec, simulate), label))
}

/// Returns the error for a plan that is requested in an environment that it was not made for.
fn elsewhere(args: &Simulate, given: &SourceRun) -> Error {
    let environment = args.environment.as_deref().unwrap_or_default();
    let message = format!(
        "--plan: the plan of {} is for environment \"{}\", not for \"{environment}\": plan there (`evogait plan RUN --environment \
         {environment}`) and simulate that run, or add --replan",
        given.called,
        given.job.environment().name
    );
    Error::Usage { message }
}

/// Returns the job for a motion of a robot without a run, and its name in messages.
fn of_robot(args: &Simulate, robot: &str) -> Result<(JobSpec, String), Error> {
    let file = load::robot(robot, None)?;
    let compiled = sim_core::model::Robot::compile(&file.spec);
    let compiled = compiled.map_err(|source| Error::Invalid { file: file.label.clone(), source })?;
    let mut simulate = SimulateSpec::default();
    let what = match &args.what {
        SimulateWhat::Targets(path) => {
            simulate.targets = Some(Reference::Inline(Box::new(crate::target_table::read(path, &compiled)?)));
            "targets"
        }
        SimulateWhat::Stand(seconds) => {
            simulate.stand = Some(*seconds);
            "stand"
        }
        SimulateWhat::Gait(_) | SimulateWhat::Plan => {
            let message = "--gait and --plan need a run: `evogait simulate RUN --gait 1`".to_owned();
            return Err(Error::Usage { message });
        }
    };
    if args.replan.is_some() {
        return Err(Error::Usage {
            message: "--replan plans with the gaits of a run: give a run instead of --robot".into(),
        });
    }
    let mut spec = with_robot(file.spec, what, simulate);
    environment(args, &mut spec)?;
    if args.fine {
        spec.physics = finer(&spec.physics);
    }
    Ok((spec, format!("{what} of {}", file.label)))
}

/// Returns the job that simulates a motion of a robot in the empty environment.
pub(super) fn with_robot(robot: RobotSpec, what: &str, simulate: SimulateSpec) -> JobSpec {
    let spec = JobSpec {
        name: format!("{}-{what}", robot.name).chars().take(MAX_NAME_LENGTH).collect(),
        description: String::new(),
        seed: 1,
        variant: None,
        procedure: None,
        gaits: None,
        planner: PlannerSpec::default(),
        fitness: None,
        optimiser: None,
        plan: None,
        simulate: None,
        physics: PhysicsSpec::default(),
        finish: None,
        environment: Reference::Named("empty".to_owned()),
        robot: Reference::Inline(Box::new(robot)),
    };
    simulating(spec, simulate)
}

fn simulating(spec: JobSpec, simulate: SimulateSpec) -> JobSpec {
    JobSpec {
        procedure: Some(SIMULATE.to_owned()),
        simulate: Some(simulate),
        plan: None,
        fitness: None,
        optimiser: None,
        finish: None,
        ..spec
    }
}

fn environment(args: &Simulate, spec: &mut JobSpec) -> Result<(), Error> {
    if let Some(name) = &args.environment {
        let (environment, _) = load::environment(name)?;
        spec.environment = Reference::Inline(Box::new(environment));
    }
    Ok(())
}

/// Returns the reference setting of the same scale: rapier with smaller steps.
pub(super) fn finer(physics: &PhysicsSpec) -> PhysicsSpec {
    let reference = Physics::reference_of(physics.scale);
    PhysicsSpec {
        engine: EngineChoice::Rapier,
        steps_per_second: Some(reference.steps_per_second),
        substeps: Some(reference.substeps),
        ..physics.clone()
    }
}
