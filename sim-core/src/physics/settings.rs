//! The `[physics]` table of a job, and the physics that it resolves to.

use crate::base::error::{Faults, Invalid, in_range, whole_in_range};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Size of the robot, which sets gravity in map units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Scale {
    /// Modules of 1 m under 9.81 m/s², as in the paper's simulator.
    #[default]
    Paper,
    /// Modules of 0.105 m: 93.4 mu/s².
    Real,
}

/// The `[physics]` table. Values that are not given follow from the scale.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PhysicsSpec {
    /// The engine, or `auto`. In a resolved job, the engine that was chosen.
    pub engine: EngineChoice,
    /// Size of the robot.
    pub scale: Scale,
    /// Kind of joints on rapier; the lockstep engine has reduced coordinates only.
    pub joints: JointKind,
    /// Gravity, mu/s².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gravity: Option<f64>,
    /// Coulomb friction of all bodies and the ground.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Proportional gain of the joints' motors, kg·mu²/s² a rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stiffness: Option<f64>,
    /// Derivative gain of the joints' motors, kg·mu²/s a rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub damping: Option<f64>,
    /// Greatest torque of a motor, kg·mu²/s².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_torque: Option<f64>,
    /// Physics steps in a second of simulated time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps_per_second: Option<u32>,
    /// Solver iterations (substeps) of a step. On the lockstep engine, the number of linearisations of contacts and
    /// motors in a step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub substeps: Option<u32>,
}

/// Engine in a job's settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EngineChoice {
    /// Lockstep where its fidelity is sufficient, else rapier.
    #[default]
    Auto,
    /// The engine rapier.
    Rapier,
    /// The engine lockstep.
    Lockstep,
}

/// The physics engines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EngineKind {
    /// rapier3d: any terrain.
    Rapier,
    /// lockstep: many rollouts side by side, on flat ground or stairs, with boxes.
    Lockstep,
}

impl EngineKind {
    /// Returns the name in job files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rapier => "rapier",
            Self::Lockstep => "lockstep",
        }
    }
}

impl fmt::Display for EngineKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl From<EngineKind> for EngineChoice {
    fn from(kind: EngineKind) -> Self {
        match kind {
            EngineKind::Rapier => Self::Rapier,
            EngineKind::Lockstep => Self::Lockstep,
        }
    }
}

/// Constraint that holds the two bodies of a joint together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum JointKind {
    /// Every body moves by itself, and impulses pull the two bodies of a joint together. Fast, and a little soft.
    #[default]
    Impulse,
    /// The robot moves in its joint angles (reduced coordinates), so its joints can't come apart. A step costs several
    /// times as much.
    Multibody,
}

/// Steps a second and substeps of the lockstep engine, by scale.
const LOCKSTEP_PAPER: (u32, u32) = (200, 2);
const LOCKSTEP_REAL: (u32, u32) = (600, 2);

/// Resolved `[physics]` table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Physics {
    /// Gravity, mu/s², downwards.
    pub gravity: f32,
    /// Coulomb friction between all bodies and the ground.
    pub friction: f32,
    /// Proportional gain of the motors, kg·mu²/s² a rad.
    pub stiffness: f32,
    /// Derivative gain of the motors, kg·mu²/s a rad.
    pub damping: f32,
    /// Greatest torque of a motor, kg·mu²/s².
    pub max_torque: f32,
    /// Steps in a second. Collisions are detected once a step.
    pub steps_per_second: u32,
    /// Number of substeps in which rapier integrates a step: `1 / (steps_per_second · substeps)` decides the fidelity.
    /// On the lockstep engine, the number of linearisations of contacts and motors in a step.
    pub substeps: u32,
    /// Kind of joints.
    pub joints: JointKind,
}

impl Physics {
    /// Returns the default physics of a scale on an engine. That of lockstep is rapier's with other steps.
    pub fn of(engine: EngineKind, scale: Scale) -> Self {
        let rapier = Self::of_scale(scale);
        let (steps_per_second, substeps) = match (engine, scale) {
            (EngineKind::Rapier, _) => return rapier,
            (EngineKind::Lockstep, Scale::Paper) => LOCKSTEP_PAPER,
            (EngineKind::Lockstep, Scale::Real) => LOCKSTEP_REAL,
        };
        Self { steps_per_second, substeps, ..rapier }
    }

    /// Returns the default physics of a scale on rapier. `paper`: modules of 1 m under 9.81 m/s². `real`: CoSMO modules
    /// of 0.105 m, so 9.81 / 0.105 mu/s², with motors ten times as strong and finer steps, because joints carry ten
    /// times the load.
    pub fn of_scale(scale: Scale) -> Self {
        let paper = Self {
            gravity: 9.81,
            friction: 0.8,
            stiffness: 400.0,
            damping: 20.0,
            max_torque: 60.0,
            steps_per_second: 30,
            substeps: 8,
            joints: JointKind::Impulse,
        };
        match scale {
            Scale::Paper => paper,
            Scale::Real => Self {
                gravity: 93.4,
                stiffness: 4000.0,
                damping: 200.0,
                max_torque: 400.0,
                steps_per_second: 60,
                substeps: 16,
                ..paper
            },
        }
    }

    /// Returns the setting on which winners are chosen and scored again: rapier's for the scale, in finer steps.
    pub fn reference_of(scale: Scale) -> Self {
        let (steps_per_second, substeps) = match scale {
            Scale::Paper => (60, 16),
            Scale::Real => (120, 32),
        };
        Self { steps_per_second, substeps, ..Self::of_scale(scale) }
    }

    /// Resolves and validates the `[physics]` table.
    pub fn resolve(engine: EngineKind, spec: &PhysicsSpec) -> Result<Self, Invalid> {
        let scale = Self::of(engine, spec.scale);
        let mut faults = Faults::default();
        let mut number = |field: &str, value: Option<f64>, scale: f32, range: (f64, f64), unit: &'static str| {
            let value = value.unwrap_or(shortest(scale));
            faults.take(in_range(format!("physics.{field}"), value, range, unit));
            value as f32
        };
        let resolved = Self {
            gravity: number("gravity", spec.gravity, scale.gravity, (0.0, 1e4), "mu/s²"),
            friction: number("friction", spec.friction, scale.friction, (0.0, 10.0), ""),
            stiffness: number("stiffness", spec.stiffness, scale.stiffness, (0.0, 1e7), "kg·mu²/s²"),
            damping: number("damping", spec.damping, scale.damping, (0.0, 1e7), "kg·mu²/s"),
            max_torque: number("max_torque", spec.max_torque, scale.max_torque, (0.0, 1e7), "kg·mu²/s²"),
            steps_per_second: spec.steps_per_second.unwrap_or(scale.steps_per_second),
            substeps: spec.substeps.unwrap_or(scale.substeps),
            joints: spec.joints,
        };
        for (field, value, most) in
            [("steps_per_second", resolved.steps_per_second, 10_000), ("substeps", resolved.substeps, 1000)]
        {
            faults.take(whole_in_range(format!("physics.{field}"), value, (1, most), ""));
        }
        faults.end().map(|()| resolved)
    }

    /// Returns the table with engine and every number written out.
    pub fn written_out(&self, engine: EngineKind, spec: &PhysicsSpec) -> PhysicsSpec {
        PhysicsSpec {
            engine: engine.into(),
            scale: spec.scale,
            joints: self.joints,
            gravity: Some(shortest(self.gravity)),
            friction: Some(shortest(self.friction)),
            stiffness: Some(shortest(self.stiffness)),
            damping: Some(shortest(self.damping)),
            max_torque: Some(shortest(self.max_torque)),
            steps_per_second: Some(self.steps_per_second),
            substeps: Some(self.substeps),
        }
    }

    /// Returns the number of steps of a rollout that lasts `duration` s.
    pub fn steps(&self, duration: f64) -> u32 {
        libm::round(duration * f64::from(self.steps_per_second)) as u32
    }
}

/// Returns the f64 with the text of the f32, so that 0.8 is written as 0.8 and read back to the same bits.
fn shortest(value: f32) -> f64 {
    value.to_string().parse().expect("a number's text is a number")
}
