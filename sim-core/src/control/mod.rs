//! Controllers: signal generators that give joint targets over time.
//!
//! A controller senses nothing of the physics, so a gait is compiled once to a motion, which all rollouts of that gait
//! share. Physics engines execute motions and have no oscillators.

mod gaits;
mod hopf;
mod phase;
mod sine;

pub use gaits::GaitsSpec;
pub(crate) use gaits::{space_of, validate_gaits, whole_steps};
pub use hopf::Hopf;
pub use sine::Sine;

use crate::base::registry::{Component, Registered, Registry};
use crate::genotype::{Gene, Length, NamedGene, Space};
use crate::model::{Phase, Robot};
use crate::physics::{Event, Motion, Targets};

/// The controllers there are; the first is that of a job that names none.
static CONTROLLERS: Registry<dyn Controller> = Registry::new(&[&Hopf, &Sine]);

/// A parameter of a controller, one a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Name in job files, tables and results.
    pub name: &'static str,
    /// Unit, empty for a pure number.
    pub unit: &'static str,
    /// Default bounds.
    pub bounds: (f64, f64),
}

/// The run that a controller makes a motion for.
#[derive(Clone, Copy, Debug)]
pub struct Run<'a> {
    /// The compiled robot: its joints in order, with limits and speeds.
    pub robot: &'a Robot,
    /// Duration of the motion, s.
    pub duration: f64,
    /// Phase at the end of an earlier motion of the same gait ([`Motion::end_phase`]); `None` starts at the
    /// controller's own start.
    pub from: Option<&'a Phase>,
    /// Events from outside, such as the failure of a joint.
    pub events: &'a [Event],
}

impl<'a> Run<'a> {
    /// A run from the controller's own start, to which nothing happens from outside.
    pub fn new(robot: &'a Robot, duration: f64) -> Self {
        Self { robot, duration, from: None, events: &[] }
    }
}

/// A gait that its controller can't make a motion of. Its evaluation has failed; not retryable.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the gait can't be carried out: {0}")]
pub struct Infeasible(pub String);

/// Signals of all joints, and how a controller goes on after them.
#[derive(Clone, Debug, PartialEq)]
pub struct Signals {
    /// A signal a joint, rad, one value a tick.
    pub joints: Vec<Vec<f64>>,
    /// The controller's state at the last tick.
    pub end: Vec<u8>,
}

/// A controller drives every joint by a signal of its own. A gait's parameters are laid out joint after joint, each with
/// the parameters in the order of [`Controller::parameters`]. Chosen by `controller` in the `[gaits]` table.
pub trait Controller: Component {
    /// The parameters of one joint.
    fn parameters(&self) -> &'static [Parameter];

    /// The space of one gait on a robot. Its genes are named `joint.parameter`.
    fn space(&self, robot: &Robot) -> Space {
        let gene = |joint: &str, &Parameter { name, unit, bounds: (low, high) }: &Parameter| NamedGene {
            name: format!("{joint}.{name}"),
            unit,
            gene: Gene::Real { low, high },
        };
        let of_joint = |hinge| self.parameters().iter().map(move |parameter| gene(hinge, parameter));
        Space { genes: robot.hinges.iter().flat_map(|hinge| of_joint(&hinge.name)).collect(), length: Length::Fixed }
    }

    /// The signal of every joint of a gait at `ticks` instants [`TICK`](crate::physics::TICK) apart, at least one. `from`: the
    /// state that earlier signals ended in, which the first instant then has; the controller's own start if there is none.
    /// No joint's signal depends on another's parameters.
    ///
    /// # Errors
    /// If the state is not one of this gait, or no signals follow from the parameters.
    fn signals(&self, gait: &[f64], from: Option<&[u8]>, ticks: usize) -> Result<Signals, Infeasible>;

    /// The motion of a gait: what its signals ask of joints that have limits and a greatest speed.
    ///
    /// # Errors
    /// As [`Controller::signals`].
    ///
    /// # Panics
    /// If the gait's length is none of [`Controller::space`].
    fn compile(&self, run: &Run<'_>, gait: &[f64]) -> Result<Motion, Infeasible> {
        assert_eq!(self.space(run.robot).check_length(gait.len()), Ok(()), "the gait is another robot's");
        let (from, at) = run.from.map(|phase| phase::read(phase, run.robot.hinges.len())).transpose()?.unzip();
        let signals = self.signals(gait, from, Targets::ticks(run.duration))?;
        let targets = Targets::new(&signals.joints, run.duration).within(&run.robot.hinges, at.as_deref());
        let end = phase::write(&signals.end, targets.rows().next_back().unwrap_or(&[]));
        Ok(Motion::from(targets).with_events(run.events.to_vec()).with_end_phase(end))
    }
}

impl Registered for dyn Controller {
    fn registry() -> &'static Registry<Self> {
        &CONTROLLERS
    }
}
