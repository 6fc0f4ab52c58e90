//! A job, from its file to all inputs of an evaluation.

mod budget;
mod candidates;
mod finish;
mod parts;
mod plan;
mod preparation;
mod scene;
mod simulate;
mod spec;
mod standing;
mod tables;

pub use finish::{Finish, FinishKind, FinishSpec};
pub use plan::{GaitSet, PLAN, PlanSpec};
pub use preparation::{Job, Preparation, Unfit, Unprepared};
pub use simulate::{ReplanSpec, SIMULATE, SimulateSpec, TargetTable, VarySpec, Way};
pub use spec::{JobSpec, Reference};
pub use tables::JobKind;

use crate::base::digest::Digest;
use crate::base::error::{Faults, Invalid, whole_in_range};
use crate::base::registry::Chosen as Registration;
use crate::base::score::Direction;
use crate::base::settings::Settings;
use crate::base::{limits, toml_file};
use crate::control::{Controller, GaitsSpec};
use crate::engines::{Chosen, Quiet, engine, engine_digest, engines_digest};
use crate::genotype::{Genotype, Space};
use crate::model::environment::Environment;
use crate::model::{Robot, RobotSpec};
use crate::objective::{Coverage, Distance, FitnessSpec, ObjectiveKind};
use crate::physics::{Engine, EngineKind, Physics, PhysicsSpec};
use crate::plan::{PlannerSettings, Reuse};
use crate::search::{self, OptimiserSpec, Search};
use candidates::Candidates;
use parts::Parts;
use std::sync::Arc;
use tables::check_tables;

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
        check_tables(&mut spec, &mut faults);
        let parts = Parts::resolve(&mut spec, faults)?;
        let Candidates { gaits, space, given } = Candidates::resolve(&mut spec, &parts)?;
        let fitness = spec.fitness.take().unwrap_or_else(|| default_fitness(&parts.environment));
        fitness.validate(&parts.environment)?;

        write_out(&mut spec, &parts, &fitness);
        let Parts { robot_spec, robot, environment, engine, physics, finish } = parts;
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
            engine,
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
    /// If the job does not [evolve](Self::kind).
    pub fn optimiser_spec(&self) -> &OptimiserSpec {
        self.0.spec.optimiser.as_ref().expect("a job that evolves has an optimiser")
    }

    /// Creates a search at generation 0.
    ///
    /// # Panics
    /// If the job does not [evolve](Self::kind).
    pub fn optimiser(&self) -> Box<dyn Search> {
        let rules = self.controller().rules(self.robot(), self.0.gaits.overlap).expect("the rules were checked");
        search::build_with(self.optimiser_spec(), self.0.space.clone(), rules, self.direction(), self.0.spec.seed)
    }
}

/// Writes every setting of the resolved job out into its tables.
fn write_out(spec: &mut JobSpec, parts: &Parts, fitness: &FitnessSpec) {
    spec.variant = None;
    spec.physics = parts.physics.written_out(parts.engine.engine, &spec.physics);
    spec.robot = Reference::Inline(Box::new(parts.robot_spec.clone()));
    spec.environment = Reference::Inline(Box::new(parts.environment.clone()));
    spec.fitness = spec.simulate.is_none().then(|| fitness.clone());
    spec.finish = (JobKind::of(spec) == JobKind::Evolve).then(|| Finish::written_out(parts.finish.as_ref()));
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

/// Returns the default objective: the distance to the goal, or coverage if there is no goal.
fn default_fitness(environment: &Environment) -> FitnessSpec {
    let kind: Registration<dyn ObjectiveKind> =
        if environment.goal.is_some() { Registration(&Distance) } else { Registration(&Coverage) };
    FitnessSpec { kind, settings: Settings::defaults(kind.0.settings()) }
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
