//! Outcome and trace of a rollout.

use super::Unsupported;
use crate::base::math::{Pose, Rotation, Vector};
use crate::model::{Robot, State};
use std::fmt;

/// Least number of samples per second of a trace, if there are as many steps.
const SAMPLES_PER_SECOND: u32 = 20;
/// Samples from the first to the last of a span. A span joins the boxes of its samples.
const SAMPLES_PER_SPAN: usize = 10;

/// Outcome of a rollout, and its trace.
#[derive(Clone, Debug, PartialEq)]
pub struct Rollout {
    /// State at the end, with its velocities and, if the rollout completed, the motion's end phase. For an unstable
    /// rollout it is the state at the last sound moment, for a refused one the state before the refused event.
    pub end: State,
    /// Greatest speed of a body at the end, mu/s.
    pub end_speed: f32,
    /// Configurations during the rollout, the first at the start, the last at the end.
    pub trace: Trace,
    /// Boxes around the robot over short spans of time, in the frame of the simulation.
    pub swept: Vec<Span>,
    /// Outcome of the rollout.
    pub outcome: Outcome,
    /// Simulated time, ms.
    pub simulated_ms: u64,
    /// Mechanical work of the motors.
    pub effort: Effort,
}

/// Mechanical work of a robot's motors over a rollout, kg·mu²/s²: torque times turn, summed over joints and steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Effort {
    /// Work with its sign; the work of a braking motor is negative.
    pub work: f64,
    /// Work without signs, which is the cost if motors can't store energy.
    pub turnover: f64,
}

impl Effort {
    /// Adds the work of one joint in one step.
    pub(crate) fn add(&mut self, work: f64) {
        self.work += work;
        self.turnover += work.abs();
    }
}

impl std::ops::AddAssign for Effort {
    fn add_assign(&mut self, other: Self) {
        self.work += other.work;
        self.turnover += other.turnover;
    }
}

/// Outcome of a rollout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// The rollout ran to its end.
    Completed,
    /// The simulation left its bounds, and its numbers are invalid from there on.
    Unstable {
        /// Time at which the bound was exceeded, s.
        time: f32,
        /// The exceeded bound.
        bound: Bound,
    },
    /// The engine can't simulate the rest. Everything before is simulated.
    Refused {
        /// Time of the refusal, s.
        time: f32,
        /// Index of the refused event in the motion; `None` where the robot, the terrain or the start is refused.
        event: Option<usize>,
        /// Reason of the refusal.
        reason: Unsupported,
    },
}

impl Rollout {
    /// Returns a rollout that is refused before its first step.
    pub(crate) fn refused(robot: &Robot, start: &State, reason: Unsupported) -> Self {
        let mut trace = Trace::new(robot.hinges.len());
        trace.push(0.0, start);
        Self {
            end: start.clone(),
            end_speed: 0.0,
            trace,
            swept: spans(&[robot.bounds(start)]),
            outcome: Outcome::Refused { time: 0.0, event: None, reason },
            simulated_ms: 0,
            effort: Effort::default(),
        }
    }
}

/// Bounds that separate a sound simulation from a broken one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bound {
    /// A number that is not finite.
    Finite,
    /// A body faster than [`Bound::SPEED`].
    Speed,
    /// A body's centre deeper in the ground than [`Bound::DEPTH`].
    Penetration,
    /// More kinetic energy a kg of the robot than [`Bound::ENERGY`].
    Energy,
    /// More energy than the start had and the motors gave, by more than an allowance: the energy that lifts the robot
    /// by [`Bound::LIFT`], plus the share [`Bound::DRIFT`] of what the motors gave and took. Only the lockstep engine
    /// checks this bound.
    Work,
}

impl Bound {
    /// Greatest speed, mu/s. A free fall from 100 mu at 93 mu/s² is slower.
    pub const SPEED: f32 = 150.0;
    /// Greatest depth, mu: half a module.
    pub const DEPTH: f32 = 0.5;
    /// Greatest kinetic energy per mass, mu²/s².
    pub const ENERGY: f32 = 5000.0;
    /// Height of the lift in the allowance of [`Bound::Work`], mu.
    pub const LIFT: f32 = 0.1;
    /// Share of the motors' energy in the allowance of [`Bound::Work`].
    pub const DRIFT: f32 = 0.05;
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (time, bound) = match self {
            Self::Completed => return f.write_str("completed"),
            Self::Refused { event: None, reason, .. } => return write!(f, "refused: {reason}"),
            Self::Refused { time, event: Some(event), reason } => {
                return write!(f, "event {event} was refused after {time:.2} s: {reason}");
            }
            Self::Unstable { time, bound } => (time, bound),
        };
        match bound {
            Bound::Finite => write!(f, "a number was not finite after {time:.2} s"),
            Bound::Speed => write!(f, "a body was faster than {} mu/s after {time:.2} s", Bound::SPEED),
            Bound::Penetration => {
                write!(f, "a body was deeper than {} mu in the ground after {time:.2} s", Bound::DEPTH)
            }
            Bound::Energy => {
                write!(f, "kinetic energy exceeded {} mu²/s² times the robot's mass after {time:.2} s", Bound::ENERGY)
            }
            Bound::Work => {
                let lift = Bound::LIFT;
                write!(
                    f,
                    "the robot had gained more energy than its motors gave, \
                     enough to lift it by {lift} mu, after {time:.2} s"
                )
            }
        }
    }
}

/// The robot's axis-aligned box over a span of samples, both ends included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// First sample.
    pub first: usize,
    /// Last sample.
    pub last: usize,
    /// Lower corner, mu.
    pub low: Vector,
    /// Upper corner, mu.
    pub high: Vector,
}

/// Configurations over time, stored in flat arrays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    joints: usize,
    times: Vec<f32>,
    numbers: Vec<f32>,
}

impl Trace {
    /// Creates an empty trace of a robot with `joints` joints.
    pub fn new(joints: usize) -> Self {
        Self { joints, times: Vec::new(), numbers: Vec::new() }
    }

    /// Adds a sample at a time (s).
    pub fn push(&mut self, time: f32, state: &State) {
        let (p, q) = (state.pivot.translation, state.pivot.rotation);
        self.times.push(time);
        self.numbers.extend([p.x, p.y, p.z, q.x, q.y, q.z, q.w]);
        self.numbers.extend(&state.joints);
    }

    /// Returns the number of samples.
    pub fn len(&self) -> usize {
        self.times.len()
    }

    /// Returns true if there are no samples.
    pub fn is_empty(&self) -> bool {
        self.times.is_empty()
    }

    /// Returns the time of a sample, s.
    pub fn time(&self, i: usize) -> f32 {
        self.times[i]
    }

    /// Returns the pose of the pivot at a sample.
    pub fn pivot(&self, i: usize) -> Pose {
        let n = &self.numbers[i * (7 + self.joints)..];
        Pose::from_parts(Vector::new(n[0], n[1], n[2]), Rotation::from_xyzw(n[3], n[4], n[5], n[6]))
    }

    /// Returns the joint angles at a sample, rad.
    pub fn joints(&self, i: usize) -> &[f32] {
        &self.numbers[i * (7 + self.joints) + 7..][..self.joints]
    }

    /// Returns the configuration at a sample, without velocities.
    pub fn state(&self, i: usize) -> State {
        State::new(self.pivot(i), self.joints(i).to_vec())
    }
}

/// Returns the number of steps from one sample of a trace to the next.
pub(crate) fn sample_every(steps_per_second: u32) -> u32 {
    (steps_per_second / SAMPLES_PER_SECOND).max(1)
}

/// Joins the boxes of neighbouring samples to spans. Spans share their end samples, so no motion is left between two of
/// them.
pub(crate) fn spans(boxes: &[(Vector, Vector)]) -> Vec<Span> {
    let mut spans = Vec::new();
    let mut first = 0;
    loop {
        let last = (first + SAMPLES_PER_SPAN).min(boxes.len() - 1);
        let (mut low, mut high) = boxes[first];
        for (l, h) in &boxes[first..=last] {
            low = low.min(*l);
            high = high.max(*h);
        }
        spans.push(Span { first, last, low, high });
        if last + 1 >= boxes.len() {
            return spans;
        }
        first = last;
    }
}
