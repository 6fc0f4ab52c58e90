//! A job: one optimisation, from its file to everything an evaluation needs.

mod budget;
mod standing;

use crate::base::digest::Digest;
use crate::base::error::{Faults, Invalid, name, whole_in_range};
use crate::base::score::Direction;
use crate::base::{limits, toml_file};
use crate::control::{Controller, controller};
use crate::control::{bounds_of, validate_gaits, whole_steps};
use crate::engines::known::Known;
use crate::engines::{Chosen, Why, auto};
use crate::engines::{Quiet, Settled, engine, engine_digest, engines_digest, settle_quietly};
use crate::genotype::Bounds;
use crate::job::{JobSpec, Reference};
use crate::model::environment::Environment;
use crate::model::{Place, Robot, RobotSpec, State, catalogue};
use crate::objective::Fitness;
use crate::physics::{Engine, Physics, settle};
use crate::physics::{EngineKind, PhysicsSpec};
use crate::plan::validate_planner;
use crate::plan::{Metric, Planner, Reuse, Setting, standing_at};
use crate::procedure::evolve::finish::{Finish, FinishKind, FinishSpec};
use crate::search::{self, Optimiser};
use serde::Serialize;
use std::sync::Arc;

/// A resolved, validated job with its robot compiled and settled. Cheap to clone.
#[derive(Clone, Debug)]
pub struct Job(Arc<Resolved>);

#[derive(Debug)]
struct Resolved {
    spec: JobSpec,
    robot_spec: RobotSpec,
    environment: Environment,
    robot: Robot,
    engine: Chosen,
    physics: Physics,
    fitness: Fitness,
    bounds: Bounds,
    /// The settled start in the canonical frame.
    start: State,
    /// Height of the terrain that the robot starts on, mu; 0 on flat ground.
    ground: f64,
    /// The setting that it was settled on, if not the job's own.
    quiet: Option<Quiet>,
    finish: Option<Finish>,
    /// The same job on the reference setting, without a finish of its own.
    reference: Option<Job>,
}

impl Job {
    /// Reads a self-contained job: one whose robot and environment are written out or ship with evogait.
    /// Settings that are not given get their defaults, so that [`Job::to_toml`] tells all of them.
    pub fn from_toml(text: &str) -> Result<Job, Invalid> {
        let most = limits::MAX_TOML_LENGTH as u64;
        whole_in_range("length of the job's text", text.len() as u64, (0, most), "bytes")?;
        Self::new(toml_file::read(text)?)
    }

    /// Resolves and validates a job whose robot and environment are written out or ship with evogait.
    pub fn new(spec: JobSpec) -> Result<Job, Invalid> {
        Self::resolve(spec, Unrest::SettleQuietly)
    }

    fn resolve(mut spec: JobSpec, unrest: Unrest) -> Result<Job, Invalid> {
        let mut faults = Faults::default();
        faults.take(name("name", &spec.name));
        let most = limits::MAX_DESCRIPTION_LENGTH as u64;
        faults.take(whole_in_range("description length", spec.description.len() as u64, (0, most), "bytes"));
        faults.take(whole_in_range("seed", spec.seed, (0, limits::MAX_SEED), ""));
        faults.take(validate_gaits(&spec.gaits));
        faults.take(validate_planner(&spec.planner));
        faults.take(spec.optimiser.validate());
        let finish = faults.take(spec.finish.resolve(spec.physics.scale));
        let robot_spec = faults.take(resolve_robot(&spec));
        let environment = faults.take(resolve_environment(&spec.environment));
        let robot = robot_spec.as_ref().and_then(|robot_spec| faults.take(Robot::compile(robot_spec)));
        let chosen = match (&robot, &environment) {
            (Some(robot), Some(environment)) => {
                faults.take(auto::choose(&spec.physics, robot, environment, Known::shipped()))
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
            unreachable!("what is not there left a fault")
        };

        let mut faults = Faults::default();
        faults.take(whole_steps("gaits.duration", &spec.gaits, physics.steps_per_second));
        if let Some(finish) = &finish {
            faults.take(whole_steps("finish.steps_per_second", &spec.gaits, finish.steps_per_second));
        }
        let bounds = faults.take(bounds_of(&spec.gaits, robot.hinges.len()));
        let length = bounds.as_ref().map_or(1, |bounds| bounds.0.len() as u64);
        let parameters = length * u64::from(spec.optimiser.population());
        let most = limits::MAX_GENERATION_PARAMETERS as u64;
        let field = "parameters of a generation (candidates × length of the genome)";
        faults.take(whole_in_range(field, parameters, (1, most), ""));
        faults.take(budget::validate(&spec, &environment, &physics));
        faults.end()?;
        let Some(bounds) = bounds else { unreachable!("bounds that are not there left a fault") };
        let own = || settle(engine(chosen.engine), &robot, &physics).map(|state| Settled { state, quiet: None });
        let settled = match unrest {
            Unrest::SettleQuietly => settle_quietly(chosen.engine, &robot, &physics),
            Unrest::StartAs(settled) => own().or(Ok(settled)),
            Unrest::Refuse => own(),
        };
        let Settled { state: start, quiet } =
            settled.map_err(|e| Invalid::Conflict { field: "robot".into(), reason: e.to_string() })?;
        let ground = standing::ground_of_start(&robot, &environment, &start)?;
        let height = f64::from(start.pivot.translation.z) + ground;
        let fitness = Fitness::new(&spec.fitness, &environment, height)?;

        spec.variant = None;
        spec.physics = physics.written_out(chosen.engine, &spec.physics);
        spec.robot = Reference::Inline(Box::new(robot_spec.clone()));
        spec.environment = Reference::Inline(Box::new(environment.clone()));
        spec.finish = Finish::written_out(finish.as_ref());
        let reference = finish.map(|finish| on_reference(&spec, &finish)).transpose()?;
        Ok(Job(Arc::new(Resolved {
            spec,
            robot_spec,
            environment,
            robot,
            engine: chosen,
            physics,
            fitness,
            bounds,
            start,
            ground,
            quiet,
            finish,
            reference,
        })))
    }

    /// The same job with other physics, its robot settled there, and without a finish.
    pub fn with_physics(&self, physics: PhysicsSpec) -> Result<Job, Invalid> {
        with_physics(self.spec(), physics, Unrest::SettleQuietly)
    }

    /// The same job with other friction and without a finish. A robot that does not come to rest there by itself starts
    /// as this job's does if it is known to tremble; else it is refused, as it always was: results keep their bits.
    pub(crate) fn with_friction(&self, friction: f64, trembles: bool) -> Result<Job, Invalid> {
        let physics = PhysicsSpec { friction: Some(friction), ..self.spec().physics.clone() };
        let start = || Settled { state: self.0.start.clone(), quiet: self.0.quiet };
        with_physics(self.spec(), physics, if trembles { Unrest::StartAs(start()) } else { Unrest::Refuse })
    }

    /// The setting that the robot was settled on; `None` if it is the job's own.
    pub fn quiet(&self) -> Option<&Quiet> {
        self.0.quiet.as_ref()
    }

    /// The resolved job as a file: self-contained, every setting written out. `Job::from_toml(job.to_toml())` gives a
    /// job with the same digest.
    pub fn to_toml(&self) -> String {
        toml::to_string(&self.0.spec).expect("a resolved job can be written as TOML")
    }

    /// The job digest: resolved job, robot, environment, optimiser and engine; not names or descriptions.
    pub fn digest(&self) -> Digest {
        self.digest_on(self.engine_digest())
    }

    /// The digest that the same job has where its engine has another digest, as in another build of evogait.
    pub fn digest_on(&self, engine: Digest) -> Digest {
        #[derive(Serialize)]
        struct Identity<'a> {
            spec: &'a JobSpec,
            engine: Digest,
            #[serde(skip_serializing_if = "Option::is_none")]
            fitness: Option<u32>,
        }
        let mut spec = self.0.spec.clone();
        spec.name.clear();
        spec.description.clear();
        if let (Reference::Inline(robot), Reference::Inline(environment)) = (&mut spec.robot, &mut spec.environment) {
            robot.name.clear();
            robot.description.clear();
            environment.name.clear();
            environment.description.clear();
        }
        Digest::of("evogait job 1", &Identity { spec: &spec, engine, fitness: spec.fitness.revision() })
    }

    /// The digest of the engine that the job runs on, as this build has it; of both, if its reference setting or a settled
    /// start is another engine's. A worker must offer the same.
    pub fn engine_digest(&self) -> Digest {
        let search = self.chosen().engine;
        let uses = |job: &Job, kind| job.chosen().engine == kind || job.quiet().is_some_and(|q| q.engine == kind);
        let [rapier, lockstep] = [EngineKind::Rapier, EngineKind::Lockstep]
            .map(|kind| uses(self, kind) || self.reference().is_some_and(|reference| uses(reference, kind)));
        if rapier && lockstep {
            engines_digest(EngineKind::Lockstep, EngineKind::Rapier)
        } else {
            engine_digest(search)
        }
    }

    /// Which engine the job runs on, and why. [`Self::reference`] has one of its own.
    pub fn chosen(&self) -> Chosen {
        self.0.engine
    }

    /// Candidates whose first rollouts fill the engine's lanes on this machine: fewer in a batch take as long. 1 for an
    /// engine without lanes.
    pub fn candidates_at_once(&self) -> u32 {
        (self.engine().lanes() as u32 / self.0.spec.gaits.count).max(1)
    }

    /// The resolved job as written.
    pub fn spec(&self) -> &JobSpec {
        &self.0.spec
    }

    /// The resolved robot file.
    pub fn robot_spec(&self) -> &RobotSpec {
        &self.0.robot_spec
    }

    /// The compiled robot.
    pub fn robot(&self) -> &Robot {
        &self.0.robot
    }

    /// The environment.
    pub fn environment(&self) -> &Environment {
        &self.0.environment
    }

    /// The physics, every number resolved.
    pub fn physics(&self) -> &Physics {
        &self.0.physics
    }

    /// How the published winner is chosen; `None` if it is the best of the search.
    pub fn finish(&self) -> Option<&Finish> {
        self.0.finish.as_ref()
    }

    /// The same job on the reference setting of its finish, if it has one.
    pub fn reference(&self) -> Option<&Job> {
        self.0.reference.as_ref()
    }

    /// Fresh RRT seeds on which candidates are scored again.
    pub fn fresh_seeds(&self) -> u32 {
        Finish::seeds_of(self.finish())
    }

    /// The fitness.
    pub fn fitness(&self) -> &Fitness {
        &self.0.fitness
    }

    /// The box of genomes.
    pub fn bounds(&self) -> &Bounds {
        &self.0.bounds
    }

    /// The engine.
    pub fn engine(&self) -> &'static dyn Engine {
        engine(self.0.engine.engine)
    }

    /// The controller.
    pub fn controller(&self) -> &'static dyn Controller {
        controller(self.0.spec.gaits.controller)
    }

    /// The settled start in the canonical frame.
    pub fn start(&self) -> &State {
        &self.0.start
    }

    /// The settled start as rollouts begin from it: in the canonical frame, with [`Place::ORIGIN`]; among terrain in the map,
    /// with where that is.
    pub fn start_among_terrain(&self) -> (State, Place) {
        match self.environment().is_flat() {
            true => (self.start().clone(), Place::ORIGIN),
            false => (standing_at(self.start(), &self.root()), self.root()),
        }
    }

    /// Where the pivot starts on the map.
    pub fn root(&self) -> Place {
        let start = &self.0.environment.start;
        Place { x: start.x, y: start.y, z: f64::from(self.0.start.pivot.translation.z) + self.0.ground, yaw: start.yaw }
    }

    /// The obstacle that the robot, settled and with its pivot at the goal, touches at every heading, if there is one: such a
    /// goal is no configuration that the robot can reach as it stands.
    pub fn blocked_goal(&self) -> Option<usize> {
        standing::blocked_goal(&self.0.robot, &self.0.environment, &self.0.start)
    }

    /// How trees are grown. The goal, if there is one, does not end a tree's growth: that would cut short the tree of a
    /// distance fitness.
    pub fn planner(&self) -> Planner {
        let spec = &self.0.spec.planner;
        Planner {
            algorithm: spec.algorithm,
            iterations: spec.iterations,
            metric: Metric { yaw_weight: spec.yaw_weight, height: !self.0.environment.is_flat() },
            map: self.0.environment.size,
            stop_at: None,
        }
    }

    /// How transitions are reused.
    pub fn reuse(&self) -> Reuse {
        let spec = &self.0.spec.planner;
        Reuse { tolerance: spec.reuse_tolerance, variants: spec.variants }
    }

    /// Where trees are grown.
    pub fn setting(&self) -> Setting<'_> {
        Setting {
            robot: &self.0.robot,
            environment: &self.0.environment,
            gaits: self.0.spec.gaits.count as usize,
            height: self.0.start.pivot.translation.z.into(),
        }
    }

    /// Names of the genome's parameters, such as `gait1.hip-front.omega1`, in order.
    pub fn parameter_names(&self) -> Vec<String> {
        let mut names = Vec::new();
        for gait in 1..=self.0.spec.gaits.count {
            for hinge in &self.0.robot.hinges {
                for parameter in self.controller().parameters() {
                    names.push(format!("gait{gait}.{}.{}", hinge.name, parameter.name));
                }
            }
        }
        names
    }

    /// Whether larger or smaller scores are better.
    pub fn direction(&self) -> Direction {
        self.0.fitness.direction()
    }

    /// Name and unit of the score, such as ("coverage", "%").
    pub fn score_label(&self) -> (&'static str, &'static str) {
        self.0.fitness.label()
    }

    /// A fresh optimiser at generation 0.
    pub fn optimiser(&self) -> Box<dyn Optimiser> {
        search::build(&self.0.spec.optimiser, self.0.bounds.clone(), self.direction(), self.0.spec.seed)
    }
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

/// Way to deal with a robot that does not come to rest on a job's own setting.
enum Unrest {
    /// It is settled on a quiet one.
    SettleQuietly,
    /// It starts like this.
    StartAs(Settled),
    /// The job is refused.
    Refuse,
}

fn with_physics(spec: &JobSpec, physics: PhysicsSpec, unrest: Unrest) -> Result<Job, Invalid> {
    let finish = FinishSpec { kind: FinishKind::None, ..FinishSpec::default() };
    Job::resolve(JobSpec { physics, finish, ..spec.clone() }, unrest)
}

/// A resolved job on the reference setting of its finish.
fn on_reference(spec: &JobSpec, finish: &Finish) -> Result<Job, Invalid> {
    with_physics(spec, finish.physics(&spec.physics), Unrest::SettleQuietly).map_err(|e| Invalid::Conflict {
        field: "finish".into(),
        reason: format!(
            "on its reference setting ({} steps a second, {} substeps) the job can't be used: {e}",
            finish.steps_per_second, finish.substeps
        ),
    })
}
