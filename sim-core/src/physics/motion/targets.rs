//! Table of joint targets that a gait compiles to.

use crate::model::Hinge;

/// Time between two rows of the table, s.
pub const TICK: f64 = 0.005;

/// Joint targets over time, linear between ticks.
#[derive(Clone, Debug, PartialEq)]
pub struct Targets {
    joints: usize,
    duration: f64,
    rows: Vec<f32>,
}

impl Targets {
    /// Returns the number of rows of a table that lasts `duration` s.
    pub fn ticks(duration: f64) -> usize {
        libm::ceil(duration / TICK - 1e-9) as usize + 1
    }

    /// Creates a table from one signal for each joint (rad, one value per tick).
    ///
    /// # Panics
    /// If a signal is shorter than the duration.
    pub fn new(signals: &[Vec<f64>], duration: f64) -> Self {
        let ticks = Self::ticks(duration);
        let row = |t: usize| signals.iter().map(move |s| s[t] as f32);
        Self { joints: signals.len(), duration, rows: (0..ticks).flat_map(row).collect() }
    }

    /// Returns the table that the joints of a robot can follow. Targets are kept within each joint's limits, and from
    /// one tick to the next they change by no more than its speed allows. `from` holds the last targets of an earlier
    /// table, rad, from which joints with a greatest speed continue. Without it the first row is the signal's own start
    /// within the limits.
    ///
    /// # Panics
    /// If the table or `from` has fewer joints.
    pub fn within(mut self, hinges: &[Hinge], from: Option<&[f32]>) -> Self {
        for (joint, hinge) in hinges.iter().enumerate() {
            let [low, high] = hinge.limits;
            let most = hinge.speed.map(|speed| speed * TICK as f32);
            let mut before = None;
            if let (Some(from), Some(_)) = (from, most) {
                self.rows[joint] = from[joint];
            }
            for row in self.rows.chunks_exact_mut(self.joints) {
                let mut target = row[joint].clamp(low, high);
                if let (Some(before), Some(most)) = (before, most) {
                    target = target.clamp(before - most, before + most);
                }
                row[joint] = target;
                before = Some(target);
            }
        }
        self
    }

    /// Creates a table from the targets at given instants, rad by joint, the first at time 0. Targets are linear
    /// between instants, and held after the last until `duration`, s.
    pub fn between(instants: &[(f64, Vec<f64>)], duration: f64) -> Self {
        let joints = instants.first().map_or(0, |(_, targets)| targets.len());
        let mut signals = vec![Vec::new(); joints];
        let mut next = 1;
        for tick in 0..Self::ticks(duration) {
            let time = tick as f64 * TICK;
            while next < instants.len() && instants[next].0 <= time {
                next += 1;
            }
            let (from, to) = (&instants[next - 1], &instants[next.min(instants.len() - 1)]);
            let share = if to.0 > from.0 { (time - from.0) / (to.0 - from.0) } else { 0.0 };
            for (signal, (a, b)) in signals.iter_mut().zip(from.1.iter().zip(&to.1)) {
                signal.push(a + (b - a) * share);
            }
        }
        Self::new(&signals, duration)
    }

    /// Adds noise: every `every` ticks each joint's target is moved by a drawn angle, rad, in between linearly.
    pub fn with_noise(mut self, every: usize, mut draw: impl FnMut() -> f64) -> Self {
        let joints = self.joints.max(1);
        let knots = (self.rows.len() / joints).div_ceil(every) + 1;
        let drawn: Vec<f64> = (0..knots * joints).map(|_| draw()).collect();
        for (tick, row) in self.rows.chunks_exact_mut(joints).enumerate() {
            let (knot, share) = (tick / every, (tick % every) as f64 / every as f64);
            for (joint, target) in row.iter_mut().enumerate() {
                let [a, b] = [knot, knot + 1].map(|knot| drawn[knot * joints + joint]);
                *target = (f64::from(*target) + a + (b - a) * share) as f32;
            }
        }
        self
    }

    /// Returns a table with all joints at 0 for `duration` s.
    pub fn zero(joints: usize, duration: f64) -> Self {
        Self { joints, duration, rows: vec![0.0; joints * Self::ticks(duration)] }
    }

    /// Joins tables one after the other. Each but the last must last a whole number of ticks.
    pub(super) fn chain(tables: &[&Targets]) -> Self {
        let joints = tables.first().map_or(0, |t| t.joints);
        let mut chained = Self { joints, duration: 0.0, rows: Vec::new() };
        for (i, table) in tables.iter().enumerate() {
            let whole = table.whole_ticks() as usize;
            let rows = if i + 1 == tables.len() { table.rows.len() / joints.max(1) } else { whole };
            chained.rows.extend(&table.rows[..rows * joints]);
            chained.duration += table.duration;
        }
        chained
    }

    /// Returns the targets of every tick, rad, the first at time 0.
    pub fn rows(&self) -> impl DoubleEndedIterator<Item = &[f32]> {
        self.rows.chunks_exact(self.joints.max(1))
    }

    /// Returns the number of joints.
    pub fn joints(&self) -> usize {
        self.joints
    }

    /// Returns the duration of the table, s.
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// Returns the number of ticks until the table after it begins.
    pub(super) fn whole_ticks(&self) -> u32 {
        libm::round(self.duration / TICK) as u32
    }

    /// Computes the targets at a time (s), rad; the last row is held at the end.
    pub fn at(&self, time: f64, out: &mut [f32]) {
        let last = self.rows.len() / self.joints - 1;
        let tick = (time / TICK).max(0.0);
        let before = (tick as usize).min(last);
        let after = (before + 1).min(last);
        let share = ((tick - before as f64) as f32).clamp(0.0, 1.0);
        let (a, b) = (&self.rows[before * self.joints..], &self.rows[after * self.joints..]);
        for (joint, target) in out.iter_mut().enumerate().take(self.joints) {
            *target = a[joint] + (b[joint] - a[joint]) * share;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::Vector;
    use crate::model::QUARTER_TURNS;

    #[test]
    fn targets_are_linear_between_ticks_then_held() {
        let ramp: Vec<f64> = (0..=4).map(|t| 0.1 * f64::from(t)).collect();
        let table = Targets::new(&[ramp], 4.0 * TICK);
        let at = |t: f64| {
            let mut out = [0.0];
            table.at(t, &mut out);
            out[0]
        };
        assert_eq!(at(0.0), 0.0);
        assert!((at(1.5 * TICK) - 0.15).abs() < 1e-6);
        assert!((at(1.0) - 0.4).abs() < 1e-6);
    }

    #[test]
    fn targets_are_linear_between_instants_then_held() {
        let instants = [(0.0, vec![0.0, 1.0]), (0.01, vec![0.2, 1.0]), (0.02, vec![0.2, 0.0])];
        let table = Targets::between(&instants, 0.03);
        let rows: Vec<&[f32]> = table.rows().collect();
        let expected =
            [[0.0, 1.0], [0.1, 1.0], [0.2, 1.0], [0.2, 0.5], [0.2, 0.0], [0.2, 0.0], [0.2, 0.0f32]].map(|row| row);
        assert_eq!(rows.len(), expected.len());
        for (row, expected) in rows.iter().zip(&expected) {
            assert!(row.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{rows:?}");
        }
    }

    #[test]
    fn noise_is_linear_between_drawn_knots() {
        let mut drawn = [0.1, -0.2, 0.3, 0.4, 0.0, 0.0].into_iter();
        let table = Targets::zero(2, 4.0 * TICK).with_noise(4, || drawn.next().unwrap());
        let rows: Vec<&[f32]> = table.rows().collect();
        for (tick, expected) in [(0, [0.1, -0.2]), (2, [0.2, 0.1]), (4, [0.3, 0.4f32])] {
            assert!(rows[tick].iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-6), "{tick}: {:?}", rows[tick]);
        }
    }

    #[test]
    fn targets_stay_within_joint_limits() {
        let table = Targets::new(&[vec![9.0, -9.0]], TICK).within(&[hinge([-0.3, 0.5], None)], None);
        let mut out = [0.0];
        table.at(0.0, &mut out);
        assert_eq!(out[0], 0.5);
        table.at(TICK, &mut out);
        assert_eq!(out[0], -0.3);
    }

    /// A step of 0.5 rad at 2 rad/s takes 0.25 s, on a straight line. A slower signal does not change.
    #[test]
    fn greatest_speed_turns_step_into_ramp() {
        let ticks = Targets::ticks(1.0);
        let step: Vec<f64> = (0..ticks).map(|t| if t == 0 { 0.0 } else { 0.5 }).collect();
        let slow: Vec<f64> = (0..ticks).map(|t| 1.9 * TICK * t as f64).map(|angle| angle.min(0.4)).collect();
        let signals = [step, slow];
        let free = Targets::new(&signals, 1.0);
        let table = free.clone().within(&[hinge(QUARTER_TURNS, Some(2.0)), hinge(QUARTER_TURNS, Some(2.0))], None);
        let (mut out, mut own) = ([0.0; 2], [0.0; 2]);
        for time in [0.0, 0.05, 0.1, 0.2, 0.25, 0.3, 1.0] {
            table.at(time, &mut out);
            free.at(time, &mut own);
            assert!((f64::from(out[0]) - (2.0 * time).min(0.5)).abs() < 1e-5, "{} rad at {time} s", out[0]);
            assert_eq!(out[1], own[1], "at {time} s");
        }
    }

    fn hinge(limits: [f32; 2], speed: Option<f32>) -> Hinge {
        let (anchor, axis) = (Vector::ZERO, Vector::Z);
        Hinge { name: "joint".into(), parent: 0, anchor, axis, limits, speed, torque: None }
    }
}
