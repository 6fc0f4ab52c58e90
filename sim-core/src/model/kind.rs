//! Kinds of modules: their parts, hinge and faces. A kind is data; a new one is an entry here.

/// A kind of module. Coordinates are the module's own, mu.
#[derive(Debug)]
pub struct Kind {
    /// The name in robot files.
    pub name: &'static str,
    /// Rigid boxes.
    pub parts: &'static [PartKind],
    /// The hinge between two of them, if it has one.
    pub hinge: Option<HingeKind>,
    /// Where others can be attached; the first is the one a module is attached by unless its file says otherwise.
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
    /// kg.
    pub mass: f64,
}

/// A hinge between two parts of a module.
#[derive(Debug)]
pub struct HingeKind {
    /// Index of the part that carries.
    pub from: usize,
    /// Index of the part that is carried.
    pub to: usize,
    /// A point of the axis, mu.
    pub anchor: [f64; 3],
    /// Unit vector.
    pub axis: [f64; 3],
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

/// Module length is 1 mu: two cubes of 0.48 mu on a grid of 0.5 mu, so that docked cubes leave a gap of 0.02 mu.
const HALF: [f64; 3] = [0.24; 3];
const CUBE_MASS: f64 = 0.5;
const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];
const NEG_X: [f64; 3] = [-1.0, 0.0, 0.0];
const NEG_Y: [f64; 3] = [0.0, -1.0, 0.0];
const NEG_Z: [f64; 3] = [0.0, 0.0, -1.0];

const fn face(name: &'static str, part: usize, position: [f64; 3], normal: [f64; 3], up: [f64; 3]) -> FaceKind {
    FaceKind { name, part, position, normal, up }
}

/// A CoSMO module (Liedke et al. 2013, as Vonásek and Faigl 2016, section V, use it): two cubes and one hinge about z
/// between them. Cube `a` lies at −x, cube `b` at +x.
const COSMO: Kind = Kind {
    name: "cosmo",
    parts: &[
        PartKind { name: "a", center: [-0.25, 0.0, 0.0], half: HALF, mass: CUBE_MASS },
        PartKind { name: "b", center: [0.25, 0.0, 0.0], half: HALF, mass: CUBE_MASS },
    ],
    hinge: Some(HingeKind { from: 0, to: 1, anchor: [0.0; 3], axis: Z }),
    faces: &[
        face("back", 0, [-0.5, 0.0, 0.0], NEG_X, Z),
        face("front", 1, [0.5, 0.0, 0.0], X, Z),
        face("a-left", 0, [-0.25, 0.25, 0.0], Y, Z),
        face("a-right", 0, [-0.25, -0.25, 0.0], NEG_Y, Z),
        face("a-top", 0, [-0.25, 0.0, 0.25], Z, X),
        face("a-bottom", 0, [-0.25, 0.0, -0.25], NEG_Z, X),
        face("b-left", 1, [0.25, 0.25, 0.0], Y, Z),
        face("b-right", 1, [0.25, -0.25, 0.0], NEG_Y, Z),
        face("b-top", 1, [0.25, 0.0, 0.25], Z, X),
        face("b-bottom", 1, [0.25, 0.0, -0.25], NEG_Z, X),
    ],
};

/// One passive cube with six faces: a body to attach legs to.
const BLOCK: Kind = Kind {
    name: "block",
    parts: &[PartKind { name: "cube", center: [0.0; 3], half: HALF, mass: CUBE_MASS }],
    hinge: None,
    faces: &[
        face("back", 0, [-0.25, 0.0, 0.0], NEG_X, Z),
        face("front", 0, [0.25, 0.0, 0.0], X, Z),
        face("left", 0, [0.0, 0.25, 0.0], Y, Z),
        face("right", 0, [0.0, -0.25, 0.0], NEG_Y, Z),
        face("top", 0, [0.0, 0.0, 0.25], Z, X),
        face("bottom", 0, [0.0, 0.0, -0.25], NEG_Z, X),
    ],
};

/// All kinds.
pub const KINDS: &[Kind] = &[COSMO, BLOCK];
