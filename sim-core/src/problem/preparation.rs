//! Preparation of a job: settles its robot, which is the expensive part, and derives all that follows from its pose.

use super::{Checked, JobSpec, standing, unusable_reference, with_physics};
use crate::base::encoding::{Unreadable, encoded};
use crate::base::error::Invalid;
use crate::base::math::{Pose, Rotation, Vector};
use crate::engines::{Quiet, Settled, settle_quietly_until};
use crate::evaluate;
use crate::model::{Place, State};
use crate::objective::Objective;
use crate::physics::{PhysicsSpec, Unsettled, settle_until};
use crate::plan::{TreeScene, standing_at};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Deref;
use std::sync::Arc;

/// First byte of an encoded preparation.
const FORMAT: u8 = 0xA1;
/// Greatest difference between the length of a rotation and 1.
const UNIT: f32 = 1e-3;

/// A checked job with its robot settled: all inputs of an evaluation. Cloning it takes little time.
#[derive(Clone, Debug)]
pub struct Job(Arc<Prepared>);

#[derive(Debug)]
struct Prepared {
    checked: Checked,
    fitness: Box<dyn Objective>,
    /// The settled start in the canonical frame.
    start: State,
    /// Height of the terrain that the robot starts on, mu; 0 on flat ground.
    ground: f64,
    /// The setting that the robot was settled on; `None` if it is the job's own.
    quiet: Option<Quiet>,
    /// The same job on the reference setting, without a finish of its own.
    reference: Option<Job>,
}

/// Result of settling a job's robot, on the job's own setting and on its reference setting. Other machines use these
/// bits and need not compute them again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Preparation {
    own: Start,
    reference: Option<Start>,
}

/// Stored form of a settled start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Start {
    /// Position x, y, z of the pivot, mu, and its rotation as a unit quaternion x, y, z, w.
    pivot: [f32; 7],
    /// Joint angles, rad.
    joints: Vec<f32>,
    /// Speed at which the robot trembles on the setting of its rollouts, mu/s. Present if the robot was settled on a
    /// quiet setting.
    trembling: Option<f32>,
}

/// Reason for which a job has no preparation.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unprepared {
    /// The caller stopped the preparation.
    #[error("stopped before the robot had settled")]
    Stopped,
    /// The robot can't stand, or its start is blocked.
    #[error(transparent)]
    Refused(#[from] Invalid),
}

/// Reason for which a preparation does not fit its job.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unfit {
    /// The bytes can't be read.
    #[error("the preparation can't be read: {0}")]
    Unreadable(#[from] Unreadable),
    /// The job has a reference setting and the preparation does not, or the other way round.
    #[error("the preparation has {found} settled starts, but its job needs {wanted}")]
    Starts {
        /// Number of settled starts in the preparation.
        found: usize,
        /// Number of settled starts that the job needs.
        wanted: usize,
    },
    /// The number of joint angles differs from the number of the robot's joints.
    #[error("a settled start has {found} joint angles, but the robot has {wanted} joints")]
    Joints {
        /// Number of joint angles in the preparation.
        found: usize,
        /// Number of the robot's joints.
        wanted: usize,
    },
    /// A number is impossible for a settled robot.
    #[error(
        "a settled start has impossible numbers: all must be finite, x and y of the pivot 0, the length of its rotation 1, \
         and the speed at least 0"
    )]
    Numbers,
}

encoded!(Preparation = FORMAT);

impl fmt::Display for Preparation {
    /// Writes a summary such as "settled with its pivot at a height of 0.52 mu (bits 3f051eb8)".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let height = self.own.pivot[2];
        write!(f, "settled with its pivot at a height of {height:.2} mu (bits {:08x})", height.to_bits())
    }
}

impl Start {
    fn of(settled: &Settled) -> Self {
        let State { pivot, joints, .. } = &settled.state;
        let (p, q) = (pivot.translation, pivot.rotation);
        Self {
            pivot: [p.x, p.y, p.z, q.x, q.y, q.z, q.w],
            joints: joints.clone(),
            trembling: settled.quiet.map(|quiet| quiet.trembling),
        }
    }

    /// Returns the settled start of a job's robot.
    fn settled(&self, job: &Checked) -> Settled {
        let [x, y, z, i, j, k, w] = self.pivot;
        let pivot = Pose::from_parts(Vector::new(x, y, z), Rotation::from_xyzw(i, j, k, w));
        let state = State::new(pivot, self.joints.clone());
        Settled { state, quiet: self.trembling.map(|trembling| job.quiet_setting(trembling)) }
    }

    fn fits(&self, job: &Checked) -> Result<(), Unfit> {
        let joints = job.robot().hinges.len();
        if self.joints.len() != joints {
            return Err(Unfit::Joints { found: self.joints.len(), wanted: joints });
        }
        let [x, y, _, i, j, k, w] = self.pivot;
        let finite = self.pivot.iter().chain(&self.joints).chain(&self.trembling).all(|n| n.is_finite());
        let unit = ((i * i + j * j + k * k + w * w).sqrt() - 1.0).abs() < UNIT;
        let speed = self.trembling.is_none_or(|speed| speed >= 0.0);
        if finite && unit && speed && x == 0.0 && y == 0.0 { Ok(()) } else { Err(Unfit::Numbers) }
    }
}

impl Checked {
    /// Settles the robot on the job's setting and on its reference setting. Calls `stop` before every physics step.
    ///
    /// # Errors
    /// If the robot can't stand, its start is blocked, or `stop` returns true.
    pub fn prepare(&self, stop: &dyn Fn() -> bool) -> Result<Preparation, Unprepared> {
        let own = self.settled_start(stop)?;
        let on_reference = |reference: &Checked| match (reference.settled_start(stop), self.finish()) {
            (Err(Unprepared::Refused(fault)), Some(finish)) => {
                Err(Unprepared::Refused(unusable_reference(finish, &fault)))
            }
            (settled, _) => settled,
        };
        let reference = self.on_reference().map(on_reference).transpose()?;
        Ok(Preparation { own, reference })
    }

    /// Checks that a preparation can belong to this job. Simulates nothing.
    pub fn takes(&self, preparation: &Preparation) -> Result<(), Unfit> {
        let wanted = 1 + usize::from(self.on_reference().is_some());
        let found = 1 + usize::from(preparation.reference.is_some());
        if found != wanted {
            return Err(Unfit::Starts { found, wanted });
        }
        preparation.own.fits(self)?;
        match (&preparation.reference, self.on_reference()) {
            (Some(start), Some(reference)) => start.fits(reference),
            _ => Ok(()),
        }
    }

    /// Combines the job with its preparation. Simulates nothing.
    ///
    /// # Errors
    /// If the preparation does not fit the job.
    pub fn with(self, preparation: Preparation) -> Result<Job, Invalid> {
        let unfit = |e: Unfit| Invalid::Conflict { field: "preparation".into(), reason: e.to_string() };
        self.takes(&preparation).map_err(unfit)?;
        let reference = self.on_reference().cloned().zip(preparation.reference);
        let stand = |(job, start): (Checked, Start)| {
            let settled = start.settled(&job);
            job.standing(settled, None)
        };
        let reference = match (reference.map(stand).transpose(), self.finish()) {
            (Err(fault), Some(finish)) => return Err(unusable_reference(finish, &fault)),
            (reference, _) => reference?,
        };
        let settled = preparation.own.settled(&self);
        self.standing(settled, reference)
    }

    fn settled_start(&self, stop: &dyn Fn() -> bool) -> Result<Start, Unprepared> {
        let settled =
            settle_quietly_until(self.chosen().engine, self.robot(), self.physics(), stop).map_err(unsettled)?;
        let start = Start::of(&settled);
        // Rejects a start that is blocked.
        self.clone().standing(settled, None)?;
        Ok(start)
    }

    fn standing(self, settled: Settled, reference: Option<Job>) -> Result<Job, Invalid> {
        let Settled { state: start, quiet } = settled;
        let ground = standing::ground_of_start(self.robot(), self.environment(), &start)?;
        let height = f64::from(start.pivot.translation.z) + ground;
        let fitness = self.fitness_spec();
        let fitness = fitness.kind.0.prepare(&fitness.settings, self.environment(), height)?;
        Ok(Job(Arc::new(Prepared { checked: self, fitness, start, ground, quiet, reference })))
    }
}

fn unsettled(error: Unsettled) -> Unprepared {
    match error {
        Unsettled::Stopped => Unprepared::Stopped,
        e => Unprepared::Refused(Invalid::Conflict { field: "robot".into(), reason: e.to_string() }),
    }
}

impl Deref for Job {
    type Target = Checked;

    fn deref(&self) -> &Checked {
        &self.0.checked
    }
}

impl Job {
    /// Reads, checks and prepares a self-contained job: its robot and environment are written out or built in.
    pub fn from_toml(text: &str) -> Result<Job, Invalid> {
        Self::prepared(Checked::from_toml(text)?)
    }

    /// Checks and prepares a self-contained job.
    pub fn new(spec: JobSpec) -> Result<Job, Invalid> {
        Self::prepared(Checked::new(spec)?)
    }

    fn prepared(checked: Checked) -> Result<Job, Invalid> {
        match checked.prepare(&|| false) {
            Ok(preparation) => checked.with(preparation),
            Err(Unprepared::Refused(fault)) => Err(fault),
            Err(Unprepared::Stopped) => unreachable!("`stop` always returns false"),
        }
    }

    /// Makes the same job with other physics and without a finish; settles its robot on these physics.
    pub fn with_physics(&self, physics: PhysicsSpec) -> Result<Job, Invalid> {
        Self::prepared(with_physics(self.spec(), physics)?)
    }

    /// Makes the same job with other friction and without a finish. If its robot does not come to rest with this
    /// friction, it starts as in this job if `trembles` is true. Otherwise the job is rejected, as in earlier versions,
    /// so that results keep their bits.
    pub(crate) fn with_friction(
        &self,
        friction: f64,
        trembles: bool,
        stop: &dyn Fn() -> bool,
    ) -> Result<Job, Unprepared> {
        let physics = PhysicsSpec { friction: Some(friction), ..self.spec().physics.clone() };
        let other = with_physics(self.spec(), physics)?;
        let settled = match settle_until(other.engine(), other.robot(), other.physics(), stop) {
            Ok(state) => Settled { state, quiet: None },
            Err(Unsettled::Stopped) => return Err(Unprepared::Stopped),
            Err(_) if trembles => Settled { state: self.start().clone(), quiet: self.0.quiet },
            Err(error) => return Err(unsettled(error)),
        };
        Ok(other.standing(settled, None)?)
    }

    /// Returns the part of the job that is known without a simulation.
    pub fn checked(&self) -> &Checked {
        &self.0.checked
    }

    /// Returns the setting that the robot was settled on; `None` if it is the job's own.
    pub fn quiet(&self) -> Option<&Quiet> {
        self.0.quiet.as_ref()
    }

    /// Returns the same job on the reference setting of its finish, if it has one.
    pub fn reference(&self) -> Option<&Job> {
        self.0.reference.as_ref()
    }

    /// Returns the objective.
    pub fn fitness(&self) -> &dyn Objective {
        &*self.0.fitness
    }

    /// Returns the settled start in the canonical frame.
    pub fn start(&self) -> &State {
        &self.0.start
    }

    /// Returns the settled start of rollouts with its place: on flat ground in the canonical frame, with
    /// [`Place::ORIGIN`]; over terrain in the map.
    pub fn start_among_terrain(&self) -> (State, Place) {
        match self.environment().is_flat() {
            true => (self.start().clone(), Place::ORIGIN),
            false => (standing_at(self.start(), &self.root()), self.root()),
        }
    }

    /// Returns the pivot's place at the start.
    pub fn root(&self) -> Place {
        let start = &self.environment().start;
        Place { x: start.x, y: start.y, z: f64::from(self.0.start.pivot.translation.z) + self.0.ground, yaw: start.yaw }
    }

    /// Returns the pivot's place for a start at (x, y), mu, with heading `yaw`, rad.
    ///
    /// # Errors
    /// If the robot can't stand there, or the place is outside the map.
    pub fn root_at(&self, x: f64, y: f64, yaw: f64) -> Result<Place, Invalid> {
        let mut environment = self.environment().clone();
        (environment.start.x, environment.start.y, environment.start.yaw) = (x, y, yaw);
        if !environment.contains(x, y) {
            return Err(Invalid::Misplaced { what: "the start", x, y, wrong: "outside the map".into() });
        }
        let ground = standing::ground_of_start(self.robot(), &environment, &self.0.start)?;
        Ok(Place { x, y, z: f64::from(self.0.start.pivot.translation.z) + ground, yaw })
    }

    /// Returns an obstacle that blocks the goal: the settled robot, with its pivot at the goal, touches an obstacle at
    /// every heading. The robot can't reach such a goal in its settled posture. `None` if the goal is free.
    pub fn blocked_goal(&self) -> Option<usize> {
        standing::blocked_goal(self.robot(), self.environment(), &self.0.start)
    }

    /// Returns robot, environment and gaits that trees are grown for.
    pub fn setting(&self) -> TreeScene<'_> {
        evaluate::setting(self)
    }
}
