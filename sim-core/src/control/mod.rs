//! Controllers: signal generators that give joint targets over time.
//!
//! Nothing in a controller senses the physics, so a gait is compiled once to a motion, which all rollouts of that gait
//! share. No physics engine knows what an oscillator is.

mod gaits;
mod hopf;
mod sine;

pub use gaits::GaitsSpec;
pub(crate) use gaits::{bounds_of, validate_gaits, whole_steps};
pub use hopf::Hopf;
pub use sine::Sine;

use crate::base::registry::{Component, Registered, Registry};
use crate::model::Robot;
use crate::physics::{Motion, Targets};

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

/// A controller drives every joint by a signal of its own. A gait's parameters are laid out joint after joint, each with
/// the parameters in the order of [`Controller::parameters`]. Chosen by `controller` in the `[gaits]` table.
pub trait Controller: Component {
    /// The parameters of one joint.
    fn parameters(&self) -> &'static [Parameter];

    /// The signal of every joint of a gait, rad, at `ticks` instants [`TICK`](crate::physics::TICK) apart, the first at time 0. No joint's signal
    /// depends on another's parameters.
    fn signals(&self, gait: &[f64], ticks: usize) -> Vec<Vec<f64>>;

    /// The motion of a gait over `duration` s.
    ///
    /// # Panics
    /// If the number of parameters is not that of the robot's joints.
    fn compile(&self, robot: &Robot, gait: &[f64], duration: f64) -> Motion {
        let (joints, each) = (robot.hinges.len(), self.parameters().len());
        assert_eq!(gait.len(), joints * each, "a gait of {joints} joints has {} parameters", joints * each);
        Targets::new(&self.signals(gait, Targets::ticks(duration)), duration).within(&robot.hinges).into()
    }
}

impl Registered for dyn Controller {
    fn registry() -> &'static Registry<Self> {
        &CONTROLLERS
    }
}
