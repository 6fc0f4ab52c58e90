//! Sine signals, one for each joint: section III of Vonásek and Faigl (2016).

use super::{Controller, Infeasible, Parameter, Signals, phase};
use crate::base::registry::Component;
use crate::model::Robot;
use crate::physics::TICK;
use std::f64::consts::PI;

/// Sine signals a(t) = A sin(ω t + φ) + B, with four parameters for each joint. The paper gives no bounds. These bounds
/// take amplitude (√1.3) and frequencies from the Hopf oscillator, and keep offsets within a third of the joint's
/// range.
pub struct Sine;

impl Component for Sine {
    fn name(&self) -> &'static str {
        "sine"
    }
}

impl Controller for Sine {
    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "amplitude", unit: "rad", bounds: (0.0, 1.14) },
            Parameter { name: "offset", unit: "rad", bounds: (-0.5, 0.5) },
            Parameter { name: "omega", unit: "rad/s", bounds: (0.0, 4.0) },
            Parameter { name: "phase", unit: "rad", bounds: (-PI, PI) },
        ]
    }

    /// Computes the signals. The state is the number of ticks since the start, eight bytes.
    fn signals(&self, _: &Robot, gait: &[f64], from: Option<&[u8]>, ticks: usize) -> Result<Signals, Infeasible> {
        let number = |bytes: &[u8]| bytes.try_into().map(u64::from_le_bytes).map_err(|_| phase::unfit());
        let first = from.map(number).transpose()?.unwrap_or(0);
        let signal = |parameters: &[f64]| {
            let &[amplitude, offset, omega, phase] = parameters else { unreachable!("a sine has four parameters") };
            (first..).take(ticks).map(|t| amplitude * libm::sin(omega * (t as f64 * TICK) + phase) + offset).collect()
        };
        let end = (first + ticks as u64 - 1).to_le_bytes().to_vec();
        Ok(Signals { joints: gait.chunks(4).map(signal).collect(), end })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::test_robot;

    #[test]
    fn signal_matches_formula() {
        let signal = &Sine.signals(&test_robot(), &[0.7, -0.2, 3.0, 0.4], None, 401).unwrap().joints[0];
        for (tick, value) in [(0, 0.4), (200, 3.4), (400, 6.4)] {
            assert_eq!(signal[tick], 0.7 * libm::sin(value) - 0.2, "at tick {tick}");
        }
    }
}
