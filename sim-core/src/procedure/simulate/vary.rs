//! Draws of the values that vary in a repeat. Each quantity has its own random stream, so a new range changes no other
//! draw.

use crate::base::random::{Purpose, Stream};
use crate::physics::{Change, Event, Motion};
use crate::problem::Checked;
use serde::{Deserialize, Serialize};

/// Number of ticks between two draws of noise: 0.1 s.
const NOISE_EVERY: usize = 20;

/// Quantities that vary. Their numbers select the random streams, so every result depends on them.
#[derive(Clone, Copy)]
#[repr(u32)]
enum Quantity {
    Friction = 1,
    MotorStrength = 2,
    X = 3,
    Y = 4,
    Yaw = 5,
    DeadJoints = 6,
    Noise = 7,
}

/// Values drawn for a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Drawn {
    /// Coefficient of Coulomb friction.
    pub friction: f64,
    /// Factor of every motor's greatest torque.
    pub motor_strength: f64,
    /// Start of the robot: x, y (mu) and heading (rad).
    pub start: [f64; 3],
    /// Indexes of the locked joints, from 0, in ascending order.
    pub dead: Vec<u32>,
}

impl Drawn {
    /// Draws the values of a repeat. `None` gives the values with nothing varied.
    pub fn of(job: &Checked, repeat: Option<u32>) -> Self {
        let start = &job.environment().start;
        let friction = job.spec().physics.friction.unwrap_or(job.physics().friction.into());
        let mut drawn = Self { friction, motor_strength: 1.0, start: [start.x, start.y, start.yaw], dead: Vec::new() };
        let (Some(repeat), Some(simulate)) = (repeat, &job.spec().simulate) else { return drawn };
        let vary = &simulate.vary;
        let uniform = |quantity: Quantity, range: Option<[f64; 2]>| {
            range.map(|[low, high]| stream(job, quantity, 0, repeat).uniform(low, high))
        };
        drawn.friction = uniform(Quantity::Friction, vary.friction).unwrap_or(drawn.friction);
        drawn.motor_strength = uniform(Quantity::MotorStrength, vary.motor_strength).unwrap_or(1.0);
        let moved = [(Quantity::X, vary.x), (Quantity::Y, vary.y), (Quantity::Yaw, vary.yaw)];
        for (at, (quantity, range)) in drawn.start.iter_mut().zip(moved) {
            *at += uniform(quantity, range).unwrap_or(0.0);
        }
        let mut stream = stream(job, Quantity::DeadJoints, 0, repeat);
        let mut alive: Vec<u32> = (0..job.robot().hinges.len() as u32).collect();
        for _ in 0..vary.dead_joints.unwrap_or(0).min(alive.len() as u32) {
            drawn.dead.push(alive.remove(stream.below(alive.len() as u32) as usize));
        }
        drawn.dead.sort_unstable();
        drawn
    }

    /// Locks the dead joints at the beginning of a motion.
    pub(super) fn kill(&self, motion: Motion) -> Motion {
        let event = |&joint: &u32| Event { tick: 0, change: Change::Fail { joint: joint as usize } };
        motion.with_events(self.dead.iter().map(event).collect())
    }
}

/// Adds a repeat's noise to the targets of a motion. `step` is the index of the step in the repeat, from 0.
pub(super) fn with_noise(job: &Checked, motion: &Motion, repeat: Option<u32>, step: u32) -> Motion {
    let noise = job.spec().simulate.as_ref().and_then(|simulate| simulate.vary.target_noise).filter(|sd| *sd > 0.0);
    let (Some(deviation), Some(repeat)) = (noise, repeat) else { return motion.clone() };
    let mut stream = stream(job, Quantity::Noise, step, repeat);
    let targets = motion.targets().clone().with_noise(NOISE_EVERY, || deviation * stream.normal());
    motion.clone().with_targets(targets.within(&job.robot().hinges, None))
}

fn stream(job: &Checked, quantity: Quantity, step: u32, repeat: u32) -> Stream {
    Stream::new(job.spec().seed, Purpose::Vary, quantity as u32, step, repeat)
}
