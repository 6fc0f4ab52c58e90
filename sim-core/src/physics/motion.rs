//! The table of joint targets that a gait compiles to.

use crate::model::JOINT_LIMIT;

/// Time between two rows of the table, s.
pub const TICK: f64 = 0.005;

/// Joint targets over time, linear between ticks, kept within the joints' limits.
#[derive(Clone, Debug, PartialEq)]
pub struct Targets {
    joints: usize,
    duration: f64,
    rows: Vec<f32>,
}

impl Targets {
    /// Rows of a table that lasts `duration` s.
    pub fn ticks(duration: f64) -> usize {
        libm::ceil(duration / TICK - 1e-9) as usize + 1
    }

    /// A table from one signal a joint (rad, one value a tick).
    ///
    /// # Panics
    /// If a signal is shorter than the duration.
    pub fn new(signals: &[Vec<f64>], duration: f64) -> Self {
        let ticks = Self::ticks(duration);
        let limit = f64::from(JOINT_LIMIT);
        let row = |t: usize| signals.iter().map(move |s| s[t].clamp(-limit, limit) as f32);
        Self { joints: signals.len(), duration, rows: (0..ticks).flat_map(row).collect() }
    }

    /// All joints at 0 for `duration` s: standing.
    pub fn zero(joints: usize, duration: f64) -> Self {
        Self { joints, duration, rows: vec![0.0; joints * Self::ticks(duration)] }
    }

    /// Tables one after the other. Each but the last must last a whole number of ticks.
    pub fn chain(tables: &[&Targets]) -> Self {
        let joints = tables.first().map_or(0, |t| t.joints);
        let mut chained = Self { joints, duration: 0.0, rows: Vec::new() };
        for (i, table) in tables.iter().enumerate() {
            let whole = libm::round(table.duration / TICK) as usize;
            let rows = if i + 1 == tables.len() { table.rows.len() / joints.max(1) } else { whole };
            chained.rows.extend(&table.rows[..rows * joints]);
            chained.duration += table.duration;
        }
        chained
    }

    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.joints
    }

    /// How long the gait lasts, s.
    pub fn duration(&self) -> f64 {
        self.duration
    }

    /// The targets at a time (s), held at the end; rad.
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

    #[test]
    fn targets_are_linear_between_ticks_and_held_at_the_end() {
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
    fn targets_stay_within_the_joint_limits() {
        let table = Targets::new(&[vec![9.0, -9.0]], TICK);
        let mut out = [0.0];
        table.at(0.0, &mut out);
        assert_eq!(out[0], JOINT_LIMIT);
    }

    #[test]
    fn chained_tables_follow_each_other() {
        let flat = |v: f64| Targets::new(&[vec![v; 3]], 2.0 * TICK);
        let chain = Targets::chain(&[&flat(0.25), &flat(0.5)]);
        let mut out = [0.0];
        chain.at(1.0 * TICK, &mut out);
        assert_eq!(out[0], 0.25);
        chain.at(2.0 * TICK, &mut out);
        assert_eq!(out[0], 0.5);
        assert_eq!(chain.duration(), 4.0 * TICK);
    }
}
