//! A job, from its file to all inputs of an evaluation.

mod budget;
mod finish;
mod plan;
mod preparation;
mod scene;
mod simulate;
mod spec;
mod standing;

pub use finish::{Finish, FinishKind, FinishSpec};
pub use plan::{GaitSet, PLAN, PlanSpec};
pub use preparation::{Job, Preparation, Unfit, Unprepared};
pub use simulate::{ReplanSpec, SIMULATE, SimulateSpec, TargetTable, VarySpec, Way};
pub use spec::{JobSpec, Reference};

use crate::base::digest::Digest;
use crate::base::error::{Faults, Invalid, name, whole_in_range};
use crate::base::registry::Chosen as Registration;
use crate::base::score::Direction;
use crate::base::settings::Settings;
use crate::base::{limits, toml_file};
use crate::control::{Controller, GaitsSpec, space_of, validate_gaits, whole_steps};
use crate::engines::fidelity::FidelityTable;
use crate::engines::{Chosen, Why, auto};
use crate::engines::{Quiet, engine, engine_digest, engines_digest};
use crate::genotype::{Genotype, Space};
use crate::model::environment::Environment;
use crate::model::{Robot, RobotSpec, catalogue};
use crate::objective::{Coverage, Distance, FitnessSpec, ObjectiveKind};
use crate::physics::{Engine, Physics};
use crate::physics::{EngineKind, PhysicsSpec};
use crate::plan::validate_planner;
use crate::plan::{PlannerSettings, PlannerSpec, Reuse};
use crate::search::{self, OptimiserSpec, Search};
use std::sync::Arc;

/// A resolved and validated job with its robot compiled: everything that is known without a simulation. Making and
/// cloning it takes little time. [`Checked::prepare`] and [`Checked::with`] turn it into a [`Job`].
#[derive(Clone, Debug)]
pub struct Checked(Arc<Resolved>);

#[derive(Debug)]
struct Resolved {
    spec: JobSpec,
    robot_spec: RobotSpec,
    environment: Environment,
    robot: Robot,
    engine: Chosen,
    physics: Physics,
    /// The gaits of the file. A motion without gaits counts as one gait of the motion's duration.
    gaits: GaitsSpec,
    space: Space,
    fitness: FitnessSpec,
    /// The gaits that the file gives, if any.
    given: Option<Genotype>,
    finish: Option<Finish>,
    /// The same job on the reference setting, without a finish of its own. For a job that simulates, the job that
    /// replans.
    reference: Option<Checked>,
}

impl Checked {
    /// Reads a self-contained job: its robot and environment are written out or built in. Settings that are not given
    /// get their defaults, and [`Checked::to_toml`] writes all of them.
    pub fn from_toml(text: &str) -> Result<Self, Invalid> {
        let most = limits::MAX_TOML_LENGTH as u64;
        whole_in_range("length of the job's text", text.len() as u64, (0, most), "bytes")?;
        Self::new(toml_file::read(text)?)
    }

    /// Resolves and validates a self-contained job. Simulates nothing.
    pub fn new(mut spec: JobSpec) -> Result<Self, Invalid> {
        let mut faults = Faults::default();
        faults.take(name("name", &spec.name));
        let most = limits::MAX_DESCRIPTION_LENGTH as u64;
        faults.take(whole_in_range("description length", spec.description.len() as u64, (0, most), "bytes"));
        faults.take(whole_in_range("seed", spec.seed, (0, limits::MAX_SEED), ""));
        faults.take(spec.gaits.as_ref().map_or(Ok(()), validate_gaits));
        faults.take(validate_planner(&spec.planner));
        faults.take(tables_of_procedure(&spec));
        if let Some(optimiser) = &spec.optimiser {
            faults.take(optimiser.validate());
        }
        if let Some(plan) = &spec.plan {
            faults.take(plan.validate(spec.planner.iterations));
        }
        if let Some(simulate) = &mut spec.simulate {
            faults.take(simulate.resolve());
        }
        let evolves = JobKind::of(&spec) == JobKind::Evolve;
        let finish = match evolves {
            false => Some(None),
            true => faults.take(spec.finish.clone().unwrap_or_default().resolve(spec.physics.scale)),
        };
        let robot_spec = faults.take(resolve_robot(&spec));
        let environment = faults.take(resolve_environment(&spec.environment));
        let robot = robot_spec.as_ref().and_then(|robot_spec| faults.take(Robot::compile(robot_spec)));
        let chosen = match (&robot, &environment) {
            (Some(robot), Some(environment)) => {
                faults.take(auto::choose(&spec.physics, robot, environment, FidelityTable::shipped()))
            }
            _ => None,
        };
        if let Some(Why::Measured(setting)) = chosen.map(|chosen| chosen.why) {
            spec.physics = auto::with_steps(&spec.physics, setting);
        }
        // Ranges of physics are the same for both engines.
        let engine_kind = chosen.map_or(EngineKind::Rapier, |chosen| chosen.engine);
        let physics = faults.take(Physics::resolve(engine_kind, &spec.physics));
        faults.end()?;
        let (Some(robot_spec), Some(environment), Some(robot), Some(chosen), Some(physics), Some(finish)) =
            (robot_spec, environment, robot, chosen, physics, finish)
        else {
            unreachable!("a missing part has left a fault")
        };

        let mut faults = Faults::default();
        let gaits = spec.gaits.clone().unwrap_or_else(|| {
            let duration = spec.simulate.as_ref().and_then(SimulateSpec::duration).unwrap_or_default();
            GaitsSpec::of_motion(simulate::whole_time(duration, physics.steps_per_second))
        });
        faults.take(whole_steps("gaits.duration", &gaits, physics.steps_per_second));
        if let Some(finish) = &finish {
            faults.take(whole_steps("finish.steps_per_second", &gaits, finish.steps_per_second));
        }
        let space = faults.take(space_of(&gaits, &robot));
        match &spec.simulate {
            Some(simulate) => faults.take(simulate.fits(&robot, &environment, gaits.count)),
            None => {
                faults.take(resolve_stop_at_goal(&mut spec, &environment));
                faults.take(budget::validate(&spec, &gaits, &environment, &physics))
            }
        };
        let mut given = None;
        if let Some(space) = &space {
            if let Some(optimiser) = &spec.optimiser {
                let parameters = space.longest() as u64 * u64::from(optimiser.population());
                let most = limits::MAX_GENERATION_PARAMETERS as u64;
                let field = "parameters of a generation (candidates × length of the genome)";
                faults.take(whole_in_range(field, parameters, (1, most), ""));
                faults.take(optimiser.takes(space));
            }
            let sets = [
                ("plan.gaits", spec.plan.as_ref().map(|plan| &plan.gaits)),
                ("simulate.gaits", spec.simulate.as_ref().and_then(|simulate| simulate.gaits.as_ref())),
            ];
            for (field, set) in sets.iter().filter_map(|(field, set)| Some((field, (*set)?))) {
                let set = faults.take(plan::written_out(field, set));
                given = set.and_then(|set| faults.take(set.genotype(field, &robot, &gaits, space)));
            }
        }
        faults.end()?;
        let Some(space) = space else { unreachable!("a missing space has left a fault") };
        let fitness = spec.fitness.take().unwrap_or_else(|| default_fitness(&environment));
        fitness.validate(&environment)?;

        spec.variant = None;
        spec.physics = physics.written_out(chosen.engine, &spec.physics);
        spec.robot = Reference::Inline(Box::new(robot_spec.clone()));
        spec.environment = Reference::Inline(Box::new(environment.clone()));
        spec.fitness = spec.simulate.is_none().then(|| fitness.clone());
        spec.finish = evolves.then(|| Finish::written_out(finish.as_ref()));
        let mut reference = finish.as_ref().map(|finish| on_reference(&spec, finish)).transpose()?;
        if spec.simulate.is_some() {
            reference = planning(&mut spec)?;
            budget::validate_motion(&spec, &gaits, &physics, reference.as_ref())?;
        }
        let checked = Self(Arc::new(Resolved {
            spec,
            robot_spec,
            environment,
            robot,
            engine: chosen,
            physics,
            gaits,
            space,
            fitness,
            given,
            finish,
            reference,
        }));
        budget::validate_preparation(&checked)?;
        Ok(checked)
    }

    /// Returns the resolved job as a self-contained file with every setting written out.
    /// `Job::from_toml(job.to_toml())` gives a job with the same digest.
    pub fn to_toml(&self) -> String {
        toml::to_string(&self.0.spec).expect("a resolved job can be written as TOML")
    }

    /// Returns the digest of the engine that the job runs on, as built into this program. If the reference setting or
    /// the quiet setting of a start uses the other engine, returns the digest of both. A worker must offer the same.
    pub fn engine_digest(&self) -> Digest {
        let search = self.chosen().engine;
        let uses = |job: &Checked, kind| job.chosen().engine == kind || job.quiet_setting(0.0).engine == kind;
        let [rapier, lockstep] = [EngineKind::Rapier, EngineKind::Lockstep]
            .map(|kind| uses(self, kind) || self.on_reference().is_some_and(|reference| uses(reference, kind)));
        if rapier && lockstep {
            engines_digest(EngineKind::Lockstep, EngineKind::Rapier)
        } else {
            engine_digest(search)
        }
    }

    /// Returns the setting on which the robot is settled if it trembles at `trembling` mu/s on the job's own setting.
    fn quiet_setting(&self, trembling: f32) -> Quiet {
        Quiet::of(&self.0.robot, &self.0.physics, trembling)
    }

    /// Returns the engine that the job runs on, and the reason for the choice. [`Self::on_reference`] has an engine of
    /// its own.
    pub fn chosen(&self) -> Chosen {
        self.0.engine
    }

    /// Returns the number of candidates whose first rollouts fill the engine's lanes on this machine; a smaller batch
    /// takes as long. 1 for an engine without lanes.
    pub fn candidates_at_once(&self) -> u32 {
        (self.engine().lanes() as u32 / self.0.gaits.count).max(1)
    }

    /// Returns the resolved tables of the job.
    pub fn spec(&self) -> &JobSpec {
        &self.0.spec
    }

    /// Returns the resolved robot file.
    pub fn robot_spec(&self) -> &RobotSpec {
        &self.0.robot_spec
    }

    /// Returns the compiled robot.
    pub fn robot(&self) -> &Robot {
        &self.0.robot
    }

    /// Returns the environment.
    pub fn environment(&self) -> &Environment {
        &self.0.environment
    }

    /// Returns the physics with every number resolved.
    pub fn physics(&self) -> &Physics {
        &self.0.physics
    }

    /// Returns the settings of the finish; `None` if the winner is the best of the search.
    pub fn finish(&self) -> Option<&Finish> {
        self.0.finish.as_ref()
    }

    /// Returns the same job on the reference setting of its finish, if it has one. For a job that simulates, returns
    /// the job that replans.
    pub fn on_reference(&self) -> Option<&Checked> {
        self.0.reference.as_ref()
    }

    /// Returns the number of fresh RRT seeds on which candidates are scored again.
    pub fn fresh_seeds(&self) -> u32 {
        Finish::seeds_of(self.finish())
    }

    /// Returns the space of the candidates, which are gait sets.
    pub fn space(&self) -> &Space {
        &self.0.space
    }

    /// Returns the engine.
    pub fn engine(&self) -> &'static dyn Engine {
        engine(self.0.engine.engine)
    }

    /// Returns the controller.
    pub fn controller(&self) -> &'static dyn Controller {
        self.0.gaits.controller.0
    }

    /// Returns the settings of tree growth.
    pub fn planner(&self) -> PlannerSettings {
        let spec = &self.0.spec.planner;
        let goal = self.0.environment.goal.filter(|_| spec.stop_at_goal == Some(true));
        PlannerSettings {
            algorithm: spec.algorithm,
            iterations: spec.iterations,
            metric: spec.metric.metric(spec.yaw_weight, self.0.environment.is_flat()),
            map: self.0.environment.size,
            stop_at: goal.map(|goal| (goal.x, goal.y, goal.radius)),
        }
    }

    /// Returns the settings of transition reuse.
    pub fn reuse(&self) -> Reuse {
        let spec = &self.0.spec.planner;
        Reuse { tolerance: spec.reuse_tolerance, variants: spec.variants }
    }

    /// Returns the direction of better scores: larger or smaller.
    pub fn direction(&self) -> Direction {
        self.0.fitness.kind.0.direction()
    }

    /// Returns name and unit of the score, such as ("coverage", "%").
    pub fn score_label(&self) -> (&'static str, &'static str) {
        self.0.fitness.kind.0.label()
    }

    /// Returns the least and the greatest score that an evaluation can have.
    pub fn score_range(&self) -> (f64, f64) {
        self.0.fitness.kind.0.range()
    }

    /// Returns the job's fitness table, or the default one.
    pub fn fitness_spec(&self) -> &FitnessSpec {
        &self.0.fitness
    }

    /// Returns number, duration and controller of the gaits. A motion without gaits counts as one gait of the motion's
    /// duration.
    pub fn gaits(&self) -> &GaitsSpec {
        &self.0.gaits
    }

    /// Returns the kind of work that the job's procedure does.
    pub fn kind(&self) -> JobKind {
        JobKind::of(&self.0.spec)
    }

    /// Returns the given gaits as a candidate of the job's space. `None` for a job that evolves gaits or moves without
    /// gaits.
    pub fn given_gaits(&self) -> Option<&Genotype> {
        self.0.given.as_ref()
    }

    /// Returns the table of the search.
    ///
    /// # Panics
    /// If the job does not [evolve](Self::does).
    pub fn optimiser_spec(&self) -> &OptimiserSpec {
        self.0.spec.optimiser.as_ref().expect("a job that evolves has an optimiser")
    }

    /// Creates a search at generation 0.
    ///
    /// # Panics
    /// If the job does not [evolve](Self::does).
    pub fn optimiser(&self) -> Box<dyn Search> {
        search::build(self.optimiser_spec(), self.0.space.clone(), self.direction(), self.0.spec.seed)
    }
}

/// Kind of work that a job does, by the tables that it needs. A procedure that another program registers counts as
/// [`JobKind::Evolve`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JobKind {
    /// The search for gaits.
    Evolve,
    /// The growth of trees with given gaits.
    Plan,
    /// The execution of a given motion.
    Simulate,
}

impl JobKind {
    fn of(spec: &JobSpec) -> Self {
        match spec.procedure.as_deref() {
            Some(PLAN) => Self::Plan,
            Some(SIMULATE) => Self::Simulate,
            _ => Self::Evolve,
        }
    }
}

/// Rejects jobs with a table that their procedure does not use, and jobs without a table that it needs.
fn tables_of_procedure(spec: &JobSpec) -> Result<(), Invalid> {
    let does = JobKind::of(spec);
    let [evolves, plans, simulates] = [JobKind::Evolve, JobKind::Plan, JobKind::Simulate].map(|one| does == one);
    let needs_gaits = spec.simulate.as_ref().is_none_or(SimulateSpec::uses_gaits);
    let what = spec.procedure.as_deref().map_or("a job without `procedure`, which evolves,".to_owned(), |name| {
        format!("a job with procedure = \"{name}\"")
    });
    let conflict = |field: &str, reason: String| Err(Invalid::Conflict { field: field.to_owned(), reason });
    // Per table: its name, its presence, and `Some(true)` if it is required, `Some(false)` if forbidden, `None` if
    // optional.
    for (table, there, wanted) in [
        ("gaits", spec.gaits.is_some(), Some(!simulates || needs_gaits)),
        ("fitness", spec.fitness.is_some(), (!plans).then_some(evolves)),
        ("optimiser", spec.optimiser.is_some(), Some(evolves)),
        ("plan", spec.plan.is_some(), Some(plans)),
        ("simulate", spec.simulate.is_some(), Some(simulates)),
        ("finish", spec.finish.is_some(), (!evolves).then_some(false)),
    ] {
        match (there, wanted) {
            (false, Some(true)) => return conflict(table, format!("{what} needs this table: add it")),
            (true, Some(false)) => return conflict(table, format!("{what} has no such table: leave it out")),
            _ => {}
        }
    }
    if !evolves && spec.planner.repeats != 1 {
        let reason = "a job that plans grows one tree per seed: leave this key out and set plan.seeds".to_owned();
        return conflict("planner.repeats", reason);
    }
    let grows = !simulates || spec.simulate.as_ref().is_some_and(|simulate| simulate.replan.is_some());
    if !grows && spec.planner != PlannerSpec::default() {
        let reason = "a job that simulates grows trees only if it replans: leave the table out, or add \
                      [simulate.replan]";
        return conflict("planner", reason.to_owned());
    }
    Ok(())
}

/// Makes the job that computes the plans of a job that simulates and replans, and writes its physics into
/// `simulate.replan`. Returns `None` if the job does not replan.
fn planning(spec: &mut JobSpec) -> Result<Option<Checked>, Invalid> {
    let own = spec.physics.clone();
    let Some(SimulateSpec { replan: Some(replan), gaits: Some(gaits), .. }) = &spec.simulate else { return Ok(None) };
    let job = JobSpec {
        procedure: Some(PLAN.to_owned()),
        plan: Some(PlanSpec { seeds: 1, gaits: gaits.clone() }),
        simulate: None,
        physics: replan.physics.clone().unwrap_or(own),
        ..spec.clone()
    };
    let has_goal = matches!(&spec.environment, Reference::Inline(environment) if environment.goal.is_some());
    let unusable = |reason: String| Invalid::Conflict { field: "simulate.replan".into(), reason };
    if !has_goal {
        return Err(unusable(
            "plans lead to a goal, and the environment has none: add `goal = { x = …, y = … }`".into(),
        ));
    }
    let job = Checked::new(job).map_err(|fault| unusable(format!("no plan can be made: {fault}")))?;
    if let Some(replan) = spec.simulate.as_mut().and_then(|simulate| simulate.replan.as_mut()) {
        replan.physics = Some(job.spec().physics.clone());
    }
    Ok(Some(job))
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

/// Returns the default objective: the distance to the goal, or coverage if there is no goal.
fn default_fitness(environment: &Environment) -> FitnessSpec {
    let kind: Registration<dyn ObjectiveKind> =
        if environment.goal.is_some() { Registration(&Distance) } else { Registration(&Coverage) };
    FitnessSpec { kind, settings: Settings::defaults(kind.0.settings()) }
}

fn resolve_robot(spec: &JobSpec) -> Result<RobotSpec, Invalid> {
    let mut robot: RobotSpec = match &spec.robot {
        Reference::Inline(robot) => (**robot).clone(),
        Reference::Named(name) => toml::from_str(shipped("robot", catalogue::robots(), name)?)?,
    };
    if let Some(variant) = &spec.variant {
        robot = robot.variant(variant)?;
    }
    robot.variants.clear();
    Ok(robot)
}

fn resolve_environment(reference: &Reference<Environment>) -> Result<Environment, Invalid> {
    let environment: Environment = match reference {
        Reference::Inline(environment) => (**environment).clone(),
        Reference::Named(name) => toml::from_str(shipped("environment", catalogue::environments(), name)?)?,
    };
    environment.validate()?;
    Ok(environment)
}

fn shipped(field: &str, entries: &'static [catalogue::Entry], name: &str) -> Result<&'static str, Invalid> {
    catalogue::find(entries, name).map(|e| e.toml).ok_or_else(|| Invalid::Unknown {
        field: field.to_owned(),
        value: name.to_owned(),
        known: entries.iter().map(|e| e.name.to_owned()).collect(),
    })
}

/// Makes a job with other physics and without a finish.
fn with_physics(spec: &JobSpec, physics: PhysicsSpec) -> Result<Checked, Invalid> {
    let none = FinishSpec { kind: FinishKind::None, ..FinishSpec::default() };
    let finish = (JobKind::of(spec) == JobKind::Evolve).then_some(none);
    Checked::new(JobSpec { physics, finish, ..spec.clone() })
}

/// Makes the job on the reference setting of its finish.
fn on_reference(spec: &JobSpec, finish: &Finish) -> Result<Checked, Invalid> {
    with_physics(spec, finish.physics(&spec.physics)).map_err(|fault| unusable_reference(finish, &fault))
}

/// Returns the error for a job that can't be used on its reference setting.
fn unusable_reference(finish: &Finish, fault: &Invalid) -> Invalid {
    Invalid::Conflict {
        field: "finish".into(),
        reason: format!(
            "on its reference setting ({} steps a second, {} substeps) the job can't be used: {fault}",
            finish.steps_per_second, finish.substeps
        ),
    }
}
