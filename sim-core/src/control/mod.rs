//! Controllers: signal generators that give joint targets over time.
//!
//! A controller receives nothing from the physics. So a gait is compiled once to a motion, which all rollouts of that
//! gait share. Physics engines execute motions and contain no oscillators.

mod gaits;
mod hopf;
mod phase;
pub mod sequence;
mod sine;

pub use gaits::GaitsSpec;
pub(crate) use gaits::{space_of, validate_gaits, whole_steps};
pub use hopf::Hopf;
pub use sequence::Sequence;
pub use sine::Sine;

use crate::base::error::Invalid;
use crate::base::registry::{Component, Registered, Registry};
use crate::genotype::{Gene, Length, NamedGene, NoRules, Rules, Space};
use crate::model::{Phase, Robot};
use crate::physics::{Event, Motion, Targets};
use std::sync::Arc;

/// All controllers; the first is the default of jobs that name none.
static CONTROLLERS: Registry<dyn Controller> = Registry::new(&[&Hopf, &Sine, &Sequence]);

/// A parameter of a controller; every joint has its own value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Name in job files, tables and results.
    pub name: &'static str,
    /// Unit, empty for a pure number.
    pub unit: &'static str,
    /// Default bounds.
    pub bounds: (f64, f64),
}

/// Robot, duration, start and events of the motion that a controller compiles.
#[derive(Clone, Copy, Debug)]
pub struct Run<'a> {
    /// The compiled robot: its joints in order, with limits and speeds.
    pub robot: &'a Robot,
    /// Duration of the motion, s.
    pub duration: f64,
    /// Phase at the end of an earlier motion of the same gait ([`Motion::end_phase`]), from which the controller
    /// continues. `None` uses the controller's own start.
    pub from: Option<&'a Phase>,
    /// External events, such as the failure of a joint.
    pub events: &'a [Event],
}

impl<'a> Run<'a> {
    /// Returns a run from the controller's own start, without external events.
    pub fn new(robot: &'a Robot, duration: f64) -> Self {
        Self { robot, duration, from: None, events: &[] }
    }
}

/// Error of a gait that its controller can't compile to a motion. The evaluation fails and can't be retried.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the gait can't be carried out: {0}")]
pub struct Infeasible(pub String);

/// Signals of all joints, and the state from which the controller continues after them.
#[derive(Clone, Debug, PartialEq)]
pub struct Signals {
    /// One signal for each joint, rad, with one value for each tick.
    pub joints: Vec<Vec<f64>>,
    /// The controller's state at the last tick.
    pub end: Vec<u8>,
}

/// Signal generator with one signal for each joint. A gait's parameters are stored joint by joint, each joint's in the
/// order of [`Controller::parameters`]. A job chooses the controller by `controller` in the `[gaits]` table.
pub trait Controller: Component {
    /// Returns the parameters of one joint.
    fn parameters(&self) -> &'static [Parameter];

    /// Refuses a robot that the controller can't move.
    fn fits(&self, _robot: &Robot) -> Result<(), Invalid> {
        Ok(())
    }

    /// Returns the space of one gait on a robot. Its genes are named `joint.parameter`.
    fn space(&self, robot: &Robot) -> Space {
        let gene = |joint: &str, &Parameter { name, unit, bounds: (low, high) }: &Parameter| NamedGene {
            name: format!("{joint}.{name}"),
            unit,
            gene: Gene::Real { low, high },
        };
        let of_joint = |hinge| self.parameters().iter().map(move |parameter| gene(hinge, parameter));
        Space { genes: robot.hinges.iter().flat_map(|hinge| of_joint(&hinge.name)).collect(), length: Length::Fixed }
    }

    /// Returns the least and greatest number of segments of a gait if a job gives none, for a controller of sequences.
    /// `None`: those of the space.
    fn segments(&self) -> Option<(u32, u32)> {
        None
    }

    /// Returns the static rules that gaits of a robot keep, for searches. `overlap` is the allowed overlap of modules,
    /// mu, `None` for the controller's own.
    ///
    /// # Errors
    /// If the controller has no rules for the robot.
    fn rules(&self, _robot: &Robot, _overlap: Option<f64>) -> Result<Arc<dyn Rules>, Invalid> {
        Ok(Arc::new(NoRules))
    }

    /// Returns the signal of every joint of a gait at `ticks` instants, [`TICK`](crate::physics::TICK) apart; `ticks`
    /// is at least one. `from` is the state in which earlier signals ended, and the state at the first instant. Without
    /// it the controller begins at its own start. No joint's signal depends on another joint's parameters.
    ///
    /// # Errors
    /// If the state does not belong to this gait, or the parameters give no signals.
    fn signals(&self, robot: &Robot, gait: &[f64], from: Option<&[u8]>, ticks: usize) -> Result<Signals, Infeasible>;

    /// Compiles a gait to a motion: its signals, kept within the joints' limits and greatest speeds.
    ///
    /// # Errors
    /// The errors of [`Controller::signals`], and a phase of another gait.
    ///
    /// # Panics
    /// If the gait's length does not fit [`Controller::space`].
    fn compile(&self, run: &Run<'_>, gait: &[f64]) -> Result<Motion, Infeasible> {
        assert_eq!(
            self.space(run.robot).check_length(gait.len()),
            Ok(()),
            "the gait's length does not fit the robot and its controller"
        );
        let (from, at) = run.from.map(|phase| phase::read(phase, run.robot.hinges.len())).transpose()?.unzip();
        let signals = self.signals(run.robot, gait, from, Targets::ticks(run.duration))?;
        let targets = Targets::new(&signals.joints, run.duration).within(&run.robot.hinges, at.as_deref());
        let end = phase::write(&signals.end, targets.rows().next_back().unwrap_or(&[]));
        Ok(Motion::from(targets).with_events(run.events.to_vec()).with_end_phase(end))
    }
}

/// Robot for tests of controllers that do not depend on it.
#[cfg(test)]
fn test_robot() -> Robot {
    let entry = crate::model::catalogue::find(crate::model::catalogue::robots(), "quadropod").unwrap();
    Robot::compile(&toml::from_str(entry.toml).unwrap()).unwrap()
}

impl Registered for dyn Controller {
    fn registry() -> &'static Registry<Self> {
        &CONTROLLERS
    }
}
