//! An engine setting as a word: `30x8` is 30 steps a second of 8 substeps each, `30x8-multibody` the same with multibody
//! joints.

use serde::{Serialize, Serializer};
use sim_core::job::JointKind;
use sim_core::rollout::Physics;
use std::fmt;
use std::str::FromStr;

/// What of the physics may be traded for speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Setting {
    /// Steps in a simulated second, 1 to 10000.
    pub steps_per_second: u32,
    /// Substeps of a step, 1 to 1000.
    pub substeps: u32,
    /// How joints are held together.
    pub joints: JointKind,
}

impl Setting {
    /// That of some physics.
    pub fn of(physics: &Physics) -> Self {
        let Physics { steps_per_second, substeps, joints, .. } = *physics;
        Self { steps_per_second, substeps, joints }
    }

    /// The physics with this setting.
    pub fn apply(self, physics: &Physics) -> Physics {
        let Self { steps_per_second, substeps, joints } = self;
        Physics { steps_per_second, substeps, joints, ..*physics }
    }

    /// Whether a gait of so many s is a whole number of steps.
    pub fn divides(self, duration: f64) -> bool {
        let steps = duration * f64::from(self.steps_per_second);
        (steps - steps.round()).abs() < 1e-6
    }
}

impl fmt::Display for Setting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.steps_per_second, self.substeps)?;
        match self.joints {
            JointKind::Impulse => Ok(()),
            JointKind::Multibody => f.write_str("-multibody"),
        }
    }
}

impl FromStr for Setting {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "'{text}' is no engine setting: write STEPSxSUBSTEPS, steps a second (1 to 10000) and substeps of a step \
                 (1 to 1000), such as 30x8 or 30x8-multibody"
            )
        };
        let (numbers, joints) = match text.split_once('-') {
            None | Some((_, "impulse")) => (text.strip_suffix("-impulse").unwrap_or(text), JointKind::Impulse),
            Some((numbers, "multibody")) => (numbers, JointKind::Multibody),
            Some(_) => return Err(wrong()),
        };
        let (steps, substeps) = numbers.split_once('x').ok_or_else(wrong)?;
        let number = |text: &str, most: u32| text.parse().ok().filter(|n| (1..=most).contains(n)).ok_or_else(wrong);
        Ok(Self { steps_per_second: number(steps, 10_000)?, substeps: number(substeps, 1000)?, joints })
    }
}

impl Serialize for Setting {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_is_read_as_it_is_written() {
        for text in ["30x8", "240x4", "60x16-multibody"] {
            assert_eq!(text.parse::<Setting>().unwrap().to_string(), text);
        }
        assert_eq!("30x8-impulse".parse::<Setting>(), "30x8".parse());
    }

    #[test]
    fn what_is_no_setting_is_refused() {
        for text in ["", "30", "30x", "x8", "0x8", "30x0", "30x1001", "10001x1", "-30x8", "30x8-glue", "30x8-", "3.5x8"]
        {
            let refused = text.parse::<Setting>().unwrap_err();
            assert!(refused.contains("30x8-multibody") && refused.contains(&format!("'{text}'")), "{refused}");
        }
    }
}
