//! A kind of module: its parts, hinges and faces. A kind is data; those that ship are in `kinds/`.

use crate::base::registry::Component;

/// Limits of a joint without limits in its kind or file: least and greatest angle, rad.
pub const QUARTER_TURNS: [f32; 2] = [-std::f32::consts::FRAC_PI_2, std::f32::consts::FRAC_PI_2];

/// A kind of module. Coordinates are the module's own, mu.
#[derive(Debug)]
pub struct Kind {
    /// The name in robot files.
    pub name: &'static str,
    /// Rigid boxes. The hinges make one tree of all of them.
    pub parts: &'static [PartKind],
    /// The hinges between two parts each.
    pub hinges: &'static [HingeKind],
    /// Faces for attaching other modules, at least one. A module is attached by the first unless its file names
    /// another.
    pub faces: &'static [FaceKind],
}

/// A rigid box of a module.
#[derive(Debug)]
pub struct PartKind {
    /// Name, for pivots: `module/part`.
    pub name: &'static str,
    /// Centre, mu.
    pub center: [f64; 3],
    /// Half of its sides, mu.
    pub half: [f64; 3],
    /// Mass, kg.
    pub mass: f64,
}

/// A hinge between two parts of a module.
#[derive(Debug)]
pub struct HingeKind {
    /// Name. The joint is called `module.name`; the only hinge of a module is called as the module.
    pub name: &'static str,
    /// Index of the part that carries.
    pub from: usize,
    /// Index of the part that is carried.
    pub to: usize,
    /// A point of the axis, mu.
    pub anchor: [f64; 3],
    /// Unit vector.
    pub axis: [f64; 3],
    /// Least and greatest angle, rad, −3 to 3; 0 lies between them.
    pub limits: [f32; 2],
    /// Greatest rate of its target, rad/s; `None`: as fast as the controller says.
    pub speed: Option<f32>,
    /// Greatest torque of its motor, kg·mu²/s²; `None`: that of the job.
    pub torque: Option<f32>,
}

impl HingeKind {
    /// A hinge from −90° to 90° without limits on speed and torque of its own.
    pub const fn new(name: &'static str, [from, to]: [usize; 2], anchor: [f64; 3], axis: [f64; 3]) -> Self {
        Self { name, from, to, anchor, axis, limits: QUARTER_TURNS, speed: None, torque: None }
    }
}

/// A place where two modules dock, face to face.
#[derive(Debug)]
pub struct FaceKind {
    /// The name in robot files.
    pub name: &'static str,
    /// Index of the part it belongs to.
    pub part: usize,
    /// Centre of its face, mu.
    pub position: [f64; 3],
    /// Outward normal.
    pub normal: [f64; 3],
    /// The direction that two docked faces share at turn 0.
    pub up: [f64; 3],
}

impl Component for Kind {
    fn name(&self) -> &'static str {
        self.name
    }
}
