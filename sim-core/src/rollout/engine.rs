//! The interface of physics engines, and what makes two of them the same.

use super::{Physics, RapierEngine, Rollout};
use crate::control::{Targets, controller};
use crate::environment::Block;
use crate::identity::Digest;
use crate::job::{ControllerKind, EngineKind, JointKind, Scale};
use crate::lockstep::{self, LockstepEngine};
use crate::random::{Purpose, Stream};
use crate::robot::{Robot, State};
use std::sync::OnceLock;

/// A rollout to be done.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// Where it starts, at rest.
    pub start: &'a State,
    /// What the joints are told.
    pub targets: &'a Targets,
}

/// A physics engine: a batch of rollouts of one robot in, their outcomes out, in the same order.
///
/// A pure function of each request: what else is in the batch changes no bit of any outcome.
pub trait Engine: Send + Sync {
    /// Simulates. Ground is flat at z = 0 with `terrain` standing on it.
    fn run(&self, robot: &Robot, physics: &Physics, terrain: &[Block], batch: &[Request<'_>]) -> Vec<Rollout>;

    /// Simulates one rollout on flat ground, which may be given up on the way: `None` once `stop` says so. Else the bits are
    /// those of [`Engine::run`].
    fn run_until(
        &self,
        robot: &Robot,
        physics: &Physics,
        request: &Request<'_>,
        stop: &dyn Fn() -> bool,
    ) -> Option<Rollout> {
        if stop() { None } else { Some(self.run(robot, physics, &[], &[*request]).swap_remove(0)) }
    }

    /// Rollouts that take as long together as one of them alone, on this machine. Only speed depends on it.
    fn lanes(&self) -> usize {
        1
    }
}

/// The engine of a kind.
pub fn engine(kind: EngineKind) -> &'static dyn Engine {
    match kind {
        EngineKind::Rapier => &RapierEngine,
        EngineKind::Lockstep => &LockstepEngine,
    }
}

/// Raised by hand when a change of ours alters results: rollouts, planner, fitness or optimisers; for the latter raise
/// `optimise::REVISION`, too.
const REVISION: u32 = 2;

/// The exact versions of the crates whose arithmetic enters results; `tests/versions.rs` holds them to `Cargo.lock`.
pub const NUMERIC_CRATES: &[(&str, &str)] = &[
    ("rapier3d", "0.36.1"),
    ("parry3d", "0.31.1"),
    ("glam", "0.33.12"),
    ("nalgebra", "0.35.0"),
    ("libm", "0.2.16"),
    ("fearless_simd", "1.2.0"),
];

/// The digest of an engine as this build and machine have it: revision, crate versions and the bits of a short golden
/// rollout. A worker runs a job only if it has an engine of the same digest.
pub fn engine_digest(kind: EngineKind) -> Digest {
    match kind {
        EngineKind::Rapier => {
            static DIGEST: OnceLock<Digest> = OnceLock::new();
            *DIGEST.get_or_init(|| {
                Digest::of("evogait engine rapier 1", &(REVISION, NUMERIC_CRATES, golden_rollout(kind)))
            })
        }
        EngineKind::Lockstep => {
            static DIGEST: OnceLock<Digest> = OnceLock::new();
            *DIGEST.get_or_init(|| {
                let revisions = (REVISION, lockstep::REVISION);
                Digest::of("evogait engine lockstep 1", &(revisions, NUMERIC_CRATES, golden_rollout(kind)))
            })
        }
    }
}

/// What a job needs that searches on one engine and chooses its winner on another: both, so that all of its tasks go to
/// workers that have both.
pub fn engines_digest(search: EngineKind, finish: EngineKind) -> Digest {
    if search == finish {
        return engine_digest(search);
    }
    Digest::of("evogait engines 1", &(engine_digest(search), engine_digest(finish)))
}

/// What jobs of this build may need: name and digest.
pub fn engine_digests() -> Vec<(&'static str, Digest)> {
    let (rapier, lockstep) = (EngineKind::Rapier, EngineKind::Lockstep);
    vec![
        ("rapier", engine_digest(rapier)),
        ("lockstep", engine_digest(lockstep)),
        ("lockstep with rapier", engines_digest(lockstep, rapier)),
    ]
}

/// Bits of the end of a recorded gait of the quadropod, 2 s, with every kind of joint that the engine has.
pub(crate) fn golden_rollout(kind: EngineKind) -> Vec<u32> {
    let entry = crate::catalogue::robots().first().expect("the catalogue has robots");
    let spec = toml::from_str(entry.toml).expect("a robot that ships is valid");
    let robot = Robot::compile(&spec).expect("a robot that ships is valid");
    let hopf = controller(ControllerKind::Hopf);
    let mut stream = Stream::new(0, Purpose::Sample, 0, 0, 0);
    let mut gait = Vec::new();
    for _ in 0..robot.hinges.len() {
        gait.extend(hopf.parameters().iter().map(|p| stream.uniform(p.bounds.0, p.bounds.1)));
    }
    let targets = hopf.compile(&gait, robot.hinges.len(), 2.0);
    let start = robot.neutral();
    let request = Request { start: &start, targets: &targets };
    let bits = |joints: JointKind| {
        let physics = Physics { joints, ..Physics::of(kind, Scale::Paper) };
        let end = engine(kind).run(&robot, &physics, &[], &[request]).swap_remove(0).end;
        let (p, q) = (end.pivot.translation, end.pivot.rotation);
        [p.x, p.y, p.z, q.x, q.y, q.z, q.w].into_iter().chain(end.joints).map(f32::to_bits).collect::<Vec<_>>()
    };
    match kind {
        EngineKind::Rapier => [JointKind::Impulse, JointKind::Multibody].map(bits).concat(),
        EngineKind::Lockstep => bits(JointKind::default()),
    }
}
