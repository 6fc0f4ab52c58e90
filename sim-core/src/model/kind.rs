//! Kinds of modules: parts, hinges and faces. A kind is data; the kinds that ship are in `kinds/`.

use crate::base::registry::Component;

/// Least and greatest angle of a joint without limits in its kind or file, rad.
pub const QUARTER_TURNS: [f32; 2] = [-std::f32::consts::FRAC_PI_2, std::f32::consts::FRAC_PI_2];

/// Kind of module. Coordinates are in the module's own frame, mu.
#[derive(Debug)]
pub struct ModuleKind {
    /// Name in robot files.
    pub name: &'static str,
    /// Rigid parts. The hinges join all of them to one tree.
    pub parts: &'static [PartKind],
    /// Hinges, each between two parts.
    pub hinges: &'static [HingeKind],
    /// Faces for docking, at least one. A module is attached by its first face unless its file names another.
    pub faces: &'static [FaceKind],
}

/// Rigid part of a module.
#[derive(Debug)]
pub struct PartKind {
    /// Name, used for pivots: `module/part`.
    pub name: &'static str,
    /// Shape for collisions and pictures.
    pub shape: PartShape,
    /// Centre of the box around the shape, mu.
    pub center: [f64; 3],
    /// Half of the side lengths of the box around the shape, mu.
    pub half: [f64; 3],
    /// Mass, kg, spread evenly over the shape; over the box for a part without a shape.
    pub mass: f64,
}

/// Shape of a part within its box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PartShape {
    /// The box itself.
    Box,
    /// Prism along z with a D-shaped outline, in a box that is as wide along x as along y: half of a box on the side of
    /// −y, and half of a cylinder about z on the side of +y. The half cylinder has [`D_EDGES`] flat faces.
    RoundAhead,
    /// The same with the half cylinder on the side of −y.
    RoundBehind,
    /// No shape: the part touches nothing.
    None,
}

/// Number of flat faces of the round half of a D-shaped part.
pub const D_EDGES: usize = 8;

impl PartKind {
    /// Creates a part that is a box.
    pub const fn cuboid(name: &'static str, center: [f64; 3], half: [f64; 3], mass: f64) -> Self {
        Self { name, shape: PartShape::Box, center, half, mass }
    }
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
    /// Faces that it can dock to.
    pub gender: Gender,
}

/// Gender of a face: the faces that it can dock to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gender {
    /// All faces.
    Any,
    /// Passive faces, and those that dock to all: the face has the latch.
    Active,
    /// Active faces, and those that dock to all.
    Passive,
}

impl Gender {
    /// Returns true if faces of these genders can dock.
    pub fn fits(self, other: Self) -> bool {
        self == Self::Any || other == Self::Any || self != other
    }

    /// Returns the name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Any => "any",
            Self::Active => "active",
            Self::Passive => "passive",
        }
    }
}

impl Component for ModuleKind {
    fn name(&self) -> &'static str {
        self.name
    }
}
