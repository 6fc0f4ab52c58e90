//! Joint targets of a program over time.

use super::program::Segment;
use crate::model::mtran::Angle;
use crate::physics::TICK;

/// Targets of all servos over time, rad: module by module, part 0 before part 1.
///
/// A segment begins when the one before has ended, and ends at the first tick at which all targets have arrived. The
/// program begins again when its last segment has ended, from the angles as they are then.
pub struct Timetable<'a> {
    segments: Vec<&'a Segment>,
    /// Greatest speed of each servo, rad/s.
    speeds: &'a [f64],
    /// Targets at the current tick.
    targets: Vec<f64>,
    /// Targets at the end of the current segment.
    goals: Vec<f64>,
    /// Index of the segment that begins next.
    next: usize,
}

impl<'a> Timetable<'a> {
    /// Begins a program with all servos at 0. There is one speed a servo, rad/s, two servos a module.
    pub fn new(segments: Vec<&'a Segment>, speeds: &'a [f64]) -> Self {
        let still = vec![0.0; speeds.len()];
        Self { segments, speeds, targets: still.clone(), goals: still, next: 0 }
    }

    /// Returns the targets at the current tick.
    pub fn targets(&self) -> &[f64] {
        &self.targets
    }

    /// Goes on by one tick. Returns the indexes of the segments that begin at the current tick: none while one is
    /// carried out, and several if they change no angle, which takes no time.
    pub fn advance(&mut self) -> Vec<usize> {
        let mut begun = Vec::new();
        // After all segments in a row changed no angle, the robot stands still for this tick.
        while self.targets == self.goals && begun.len() < self.segments.len() {
            let segment = self.segments[self.next];
            for turn in &segment.turns {
                for (part, angle) in turn.angles.into_iter().enumerate() {
                    if let Some(goal) = self.goals.get_mut(2 * turn.module as usize + part) {
                        *goal = radians(angle);
                    }
                }
            }
            begun.push(self.next);
            self.next = (self.next + 1) % self.segments.len();
        }
        for ((target, goal), speed) in self.targets.iter_mut().zip(&self.goals).zip(self.speeds) {
            let most = speed * TICK;
            // Rounding leaves the last step a little short or long: a target that is nearly there arrives.
            let left = goal - *target;
            *target = if left.abs() <= most * (1.0 + 1e-9) { *goal } else { *target + most.copysign(left) };
        }
        begun
    }
}

/// Returns an angle in rad.
pub fn radians(angle: Angle) -> f64 {
    f64::from(angle.steps()) * std::f64::consts::FRAC_PI_6
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::sequence::program::Turn;

    fn segment(module: u32, steps: [i8; 2]) -> Segment {
        let angles = steps.map(|step| Angle::of_steps(step).unwrap());
        Segment { turns: vec![Turn { module, base: 0, angles }], connections: Vec::new() }
    }

    /// 90° at π/6 rad/s take 3 s; the segment of 30° after it takes 1 s, and then the program begins again.
    #[test]
    fn segment_ends_when_its_slowest_target_arrives() {
        let segments = [segment(0, [3, 1]), segment(1, [0, -1])];
        let speeds = [std::f64::consts::FRAC_PI_6; 4];
        let mut table = Timetable::new(segments.iter().collect(), &speeds);
        let mut begun = Vec::new();
        for tick in 0..1600 {
            begun.extend(table.advance().into_iter().map(|segment| (tick, segment)));
            if tick + 1 == 200 {
                assert!((table.targets()[0] - radians(Angle::of_steps(1).unwrap())).abs() < 1e-12);
                assert_eq!(table.targets()[1], radians(Angle::of_steps(1).unwrap()));
            }
        }
        // The second round changes no angle: both segments take no time, every tick.
        assert_eq!(begun[..4], [(0, 0), (600, 1), (800, 0), (800, 1)]);
        assert_eq!(table.targets()[3], -std::f64::consts::FRAC_PI_6);
    }

    #[test]
    fn faster_servo_arrives_earlier_and_waits() {
        let segments = [segment(0, [3, 3]), segment(0, [0, 0])];
        let speeds = [std::f64::consts::FRAC_PI_2, std::f64::consts::FRAC_PI_6];
        let mut table = Timetable::new(segments.iter().collect(), &speeds);
        let begun: Vec<usize> = (0..1201).filter(|_| !table.advance().is_empty()).collect();
        assert_eq!(begun, [0, 600, 1200]);
    }
}
