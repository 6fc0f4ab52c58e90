//! Angles of M-TRAN parts, in steps.

/// Angle in steps of 30°, −3 to 3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Angle(i8);

impl Angle {
    /// Degrees of a step.
    pub const STEP: i32 = 30;
    /// Greatest number of steps to either side: 90°.
    pub const MOST: i8 = 3;

    /// Returns the angle of so many steps; `None` beyond ±90°.
    pub fn of_steps(steps: i8) -> Option<Self> {
        (-Self::MOST..=Self::MOST).contains(&steps).then_some(Self(steps))
    }

    /// Returns the angle of so many degrees; `None` if it is not a multiple of 30° from −90° to 90°.
    pub fn of_degrees(degrees: i64) -> Option<Self> {
        let steps = degrees / i64::from(Self::STEP);
        let whole = degrees % i64::from(Self::STEP) == 0;
        i8::try_from(steps).ok().filter(|_| whole).and_then(Self::of_steps)
    }

    /// Returns the number of steps of 30°.
    pub fn steps(self) -> i8 {
        self.0
    }

    /// Returns the angle in degrees.
    pub fn degrees(self) -> i32 {
        i32::from(self.0) * Self::STEP
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_multiples_of_thirty_degrees() {
        let degrees = (-400..=400).filter_map(Angle::of_degrees).map(Angle::degrees).collect::<Vec<_>>();
        assert_eq!(degrees, [-90, -60, -30, 0, 30, 60, 90]);
        assert_eq!(Angle::of_degrees(i64::MIN), None);
        assert_eq!(Angle::of_steps(4), None);
    }
}
