//! Engine settings and their names. `30x8` means the rapier engine with 30 steps per second of 8 substeps each.
//! `30x8-multibody` means the same with multibody joints. `200x2-lockstep` means the lockstep engine with 200 steps per
//! second of 2 linearisations each.

use serde::{Serialize, Serializer};
use sim_core::physics::{EngineChoice, EngineKind, JointKind, Physics, PhysicsSpec, Scale};
use sim_core::problem::Checked;
use std::fmt;
use std::str::FromStr;

/// Greatest number of steps per simulated second.
pub const MAX_STEPS: u32 = 10_000;
/// Greatest number of substeps of a step.
pub const MAX_SUBSTEPS: u32 = 1000;

/// Engine and parameters of the physics that trade accuracy for speed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PhysicsSetting {
    /// Physics engine.
    pub engine: EngineKind,
    /// Steps per simulated second, 1 to 10000.
    pub steps_per_second: u32,
    /// Substeps per step, 1 to 1000.
    pub substeps: u32,
    /// Model of the joints in the rapier engine.
    pub joints: JointKind,
}

impl PhysicsSetting {
    /// Returns the setting of a job's search.
    pub fn of(job: &Checked) -> Self {
        Self::from_physics(job.chosen().engine, job.physics())
    }

    /// Returns the setting of a resolved job's `[physics]`; `None` if it is not resolved.
    pub fn of_resolved(spec: &PhysicsSpec) -> Option<Self> {
        let engine = match spec.engine {
            EngineChoice::Auto => return None,
            EngineChoice::Rapier => EngineKind::Rapier,
            EngineChoice::Lockstep => EngineKind::Lockstep,
        };
        let (steps_per_second, substeps) = (spec.steps_per_second?, spec.substeps?);
        Some(Self { engine, steps_per_second, substeps, joints: spec.joints })
    }

    /// Returns the default setting of an engine at a scale.
    pub fn own(engine: EngineKind, scale: Scale) -> Self {
        Self::from_physics(engine, &Physics::of(engine, scale))
    }

    /// Returns a setting that is usually fine enough for a reference. A comparison with [`Self::halved`] on some gaits
    /// shows if it is.
    pub fn finest(engine: EngineKind, scale: Scale) -> Self {
        let (steps_per_second, substeps) = match (engine, scale) {
            (EngineKind::Rapier, Scale::Paper) => (480, 8),
            (EngineKind::Rapier, Scale::Real) => (960, 16),
            (EngineKind::Lockstep, Scale::Paper) => (1600, 4),
            (EngineKind::Lockstep, Scale::Real) => (4800, 4),
        };
        Self { engine, steps_per_second, substeps, joints: JointKind::default() }
    }

    /// Returns this setting with twice its substeps, and with twice its steps. `None` if it has more than [`MAX_STEPS`]
    /// / 2 steps a second or [`MAX_SUBSTEPS`] / 2 substeps.
    pub fn halved(self) -> Option<[Self; 2]> {
        let (steps_per_second, substeps) = (2 * self.steps_per_second, 2 * self.substeps);
        let possible = steps_per_second <= MAX_STEPS && substeps <= MAX_SUBSTEPS;
        possible.then_some([Self { substeps, ..self }, Self { steps_per_second, ..self }])
    }

    fn from_physics(engine: EngineKind, physics: &Physics) -> Self {
        let Physics { steps_per_second, substeps, joints, .. } = *physics;
        Self { engine, steps_per_second, substeps, joints }
    }

    /// Writes this setting into a job's physics.
    pub fn write(self, spec: &mut PhysicsSpec) {
        spec.engine = self.engine.into();
        spec.steps_per_second = Some(self.steps_per_second);
        spec.substeps = Some(self.substeps);
        spec.joints = self.joints;
    }

    /// Returns the physics with this setting's steps, substeps and joints.
    pub fn apply(self, physics: &Physics) -> Physics {
        let Self { steps_per_second, substeps, joints, .. } = self;
        Physics { steps_per_second, substeps, joints, ..*physics }
    }

    /// Returns true if a gait of `duration` s is a whole number of steps.
    pub fn divides(self, duration: f64) -> bool {
        let steps = duration * f64::from(self.steps_per_second);
        (steps - steps.round()).abs() < 1e-6
    }
}

impl fmt::Display for PhysicsSetting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.steps_per_second, self.substeps)?;
        match (self.engine, self.joints) {
            (EngineKind::Lockstep, _) => f.write_str("-lockstep"),
            (EngineKind::Rapier, JointKind::Impulse) => Ok(()),
            (EngineKind::Rapier, JointKind::Multibody) => f.write_str("-multibody"),
        }
    }
}

impl FromStr for PhysicsSetting {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "'{text}' is not an engine setting: write STEPSxSUBSTEPS, steps per second (1 to 10000) and substeps \
                 of a step (1 to 1000), such as 30x8, 30x8-multibody or 200x2-lockstep"
            )
        };
        let (rapier, lockstep) = (EngineKind::Rapier, EngineKind::Lockstep);
        let (numbers, engine, joints) = match text.split_once('-') {
            None => (text, rapier, JointKind::Impulse),
            Some((numbers, "impulse")) => (numbers, rapier, JointKind::Impulse),
            Some((numbers, "multibody")) => (numbers, rapier, JointKind::Multibody),
            Some((numbers, "lockstep")) => (numbers, lockstep, JointKind::default()),
            Some(_) => return Err(wrong()),
        };
        let (steps, substeps) = numbers.split_once('x').ok_or_else(wrong)?;
        let number = |text: &str, most: u32| text.parse().ok().filter(|n| (1..=most).contains(n)).ok_or_else(wrong);
        let (steps_per_second, substeps) = (number(steps, MAX_STEPS)?, number(substeps, MAX_SUBSTEPS)?);
        Ok(Self { engine, steps_per_second, substeps, joints })
    }
}

impl Serialize for PhysicsSetting {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn setting_survives_writing_and_reading() {
        for text in ["30x8", "240x4", "60x16-multibody", "200x2-lockstep"] {
            assert_eq!(text.parse::<PhysicsSetting>().unwrap().to_string(), text);
        }
        assert_eq!("30x8-impulse".parse::<PhysicsSetting>(), "30x8".parse());
    }

    #[test]
    fn halved_setting_has_half_the_step_or_substep() {
        let halved = "240x4-lockstep".parse::<PhysicsSetting>().unwrap().halved().unwrap();
        assert_eq!(halved.map(|setting| setting.to_string()), ["240x8-lockstep", "480x4-lockstep"]);
        for (text, possible) in [("5000x500", true), ("5001x500", false), ("5000x501", false)] {
            assert_eq!(text.parse::<PhysicsSetting>().unwrap().halved().is_some(), possible, "{text}");
        }
    }

    #[test]
    fn parser_never_panics_on_random_text() {
        let letters: Vec<char> = "0123456789xX-. multibodylockstep\u{0}é".chars().collect();
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize
        };
        for _ in 0..100_000 {
            let length = random() % 12;
            let text: String = (0..length).map(|_| letters[random() % letters.len()]).collect();
            if let Ok(setting) = text.parse::<PhysicsSetting>() {
                assert_eq!(setting.to_string().parse(), Ok(setting), "{text}");
            }
        }
    }

    #[test]
    fn invalid_settings_are_refused() {
        for text in [
            "",
            "30",
            "30x",
            "x8",
            "0x8",
            "30x0",
            "30x1001",
            "10001x1",
            "-30x8",
            "30x8-glue",
            "30x8-",
            "3.5x8",
            "200x2-lockstep-multibody",
        ] {
            let refused = text.parse::<PhysicsSetting>().unwrap_err();
            assert!(refused.contains("30x8-multibody") && refused.contains(&format!("'{text}'")), "{refused}");
        }
    }
}
