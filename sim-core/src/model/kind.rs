//! Kinds of modules: parts, hinges and faces. A kind is data; the kinds that ship are in `kinds/`.

use crate::base::registry::Component;

/// Least and greatest angle of a joint without limits in its kind or file, rad.
pub const QUARTER_TURNS: [f32; 2] = [-std::f32::consts::FRAC_PI_2, std::f32::consts::FRAC_PI_2];

/// Kind of module. Coordinates are in the module's own frame, mu.
#[derive(Debug)]
pub struct ModuleKind {
    /// Name in robot files.
    pub name: &'static str,
    /// Rigid boxes. The hinges join all of them to one tree.
    pub parts: &'static [PartKind],
    /// Hinges, each between two parts.
    pub hinges: &'static [HingeKind],
    /// Faces for docking, at least one. A module is attached by its first face unless its file names another.
    pub faces: &'static [FaceKind],
}

/// Rigid box of a module.
#[derive(Debug)]
pub struct PartKind {
    /// Name, used for pivots: `module/part`.
    pub name: &'static str,
    /// Centre, mu.
    pub center: [f64; 3],
    /// Half of its side lengths, mu.
    pub half: [f64; 3],
    /// Mass, kg.
    pub mass: f64,
}

/// Hinge between two parts of a module.
#[derive(Debug)]
pub struct HingeKind {
    /// Name. The joint is called `module.name`. The only hinge of a module has the module's name.
    pub name: &'static str,
    /// Index of the carrying part.
    pub from: usize,
    /// Index of the carried part.
    pub to: usize,
    /// A point of the axis, mu.
    pub anchor: [f64; 3],
    /// Unit vector of the axis.
    pub axis: [f64; 3],
    /// Least and greatest angle, rad, −3 to 3; 0 lies between them.
    pub limits: [f32; 2],
    /// Greatest rate of its target, rad/s. `None`: no limit beside the controller's.
    pub speed: Option<f32>,
    /// Greatest torque of its motor, kg·mu²/s². `None`: the job's `max_torque`.
    pub torque: Option<f32>,
}

impl HingeKind {
    /// Creates a hinge from −90° to 90° without limits on speed and torque of its own.
    pub const fn new(name: &'static str, [from, to]: [usize; 2], anchor: [f64; 3], axis: [f64; 3]) -> Self {
        Self { name, from, to, anchor, axis, limits: QUARTER_TURNS, speed: None, torque: None }
    }
}

/// Face of a module: a place where two modules dock.
#[derive(Debug)]
pub struct FaceKind {
    /// Name in robot files.
    pub name: &'static str,
    /// Index of its part.
    pub part: usize,
    /// Centre of the face, mu.
    pub position: [f64; 3],
    /// Outward normal.
    pub normal: [f64; 3],
    /// Up direction. Two docked faces share it at turn 0.
    pub up: [f64; 3],
}

impl Component for ModuleKind {
    fn name(&self) -> &'static str {
        self.name
    }
}
