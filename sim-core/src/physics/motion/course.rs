//! Course of a motion on the steps of a physics setting: number of steps, failures of joints and outcome.

use super::{Change, Motion, TICK};
use crate::model::{Robot, State};
use crate::physics::{Outcome, Physics, Unsupported};

/// Steps of a motion that an engine simulates.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Course {
    /// Number of steps to simulate: those of the motion, or those before the first event that is refused.
    pub steps: u32,
    /// Failures of joints, with the step before which each joint is locked; in the order of steps.
    pub failures: Vec<(u32, usize)>,
    /// Outcome if the simulation stays sound.
    pub outcome: Outcome,
}

impl Course {
    /// Returns the course of a motion from a start on a setting.
    pub fn new(robot: &Robot, physics: &Physics, start: &State, motion: &Motion) -> Self {
        let rate = physics.steps_per_second;
        let whole = physics.steps(motion.duration());
        if !start.connections.is_empty() {
            let reason = Unsupported::Connections;
            return Self {
                steps: 0,
                failures: Vec::new(),
                outcome: Outcome::Refused { time: 0.0, event: None, reason },
            };
        }
        let mut failures = Vec::new();
        for (event, happening) in motion.events().iter().enumerate() {
            // First step that begins at or after the tick; the slack is for ticks that fall on a step.
            let step = libm::ceil(f64::from(happening.tick) * TICK * f64::from(rate) - 1e-6) as u32;
            let step = step.min(whole);
            match (Unsupported::of_event(robot, &happening.change), happening.change) {
                (Err(reason), _) => {
                    let time = (f64::from(step) / f64::from(rate)) as f32;
                    let outcome = Outcome::Refused { time, event: Some(event), reason };
                    failures.retain(|&(failure, _)| failure < step);
                    return Self { steps: step, failures, outcome };
                }
                (Ok(()), Change::Fail { joint }) => failures.push((step, joint)),
                (Ok(()), _) => {}
            }
        }
        Self { steps: whole, failures, outcome: Outcome::Completed }
    }

    /// Returns the joints that are locked before a step.
    pub fn failing(&self, step: u32) -> impl Iterator<Item = usize> {
        self.failures.iter().filter(move |(at, _)| *at == step).map(|(_, joint)| *joint)
    }
}
