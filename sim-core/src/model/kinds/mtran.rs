//! Kind `mtran`: the module of M-TRAN (Yoshida, Murata, Kamimura, Tomita, Kurokawa and Kokaji 2003, section 2.1).

use super::{NEG_Y, NEG_Z, Y, Z};
use crate::model::kind::{FaceKind, Gender, HingeKind, ModuleKind, PartKind, PartShape, QUARTER_TURNS};

/// M-TRAN module: two D-shaped parts on a link, each turning about an axis of its own. The axes are parallel and 1 mu
/// apart. The link lies along y, the axes along z, and the module's origin is the middle of the link.
///
/// At angle 0 the round halves face each other and the flat ends face away. A positive angle turns a part about +z
/// relative to the link. Assumptions where the paper gives no value: a mass of 1 kg, of which the link, which touches
/// nothing, has a fifth; a gap of 0.02 mu between docked modules; part 1 is the active one, with the latches.
pub(super) static MTRAN: ModuleKind = ModuleKind {
    name: "mtran",
    parts: &[
        PartKind { name: "0", shape: PartShape::RoundAhead, center: AXIS_0, half: HALF, mass: 0.4 },
        PartKind { name: "link", shape: PartShape::None, center: [0.0; 3], half: [0.1, 0.5, 0.1], mass: 0.2 },
        PartKind { name: "1", shape: PartShape::RoundBehind, center: AXIS_1, half: HALF, mass: 0.4 },
    ],
    hinges: &[servo("0", 0, AXIS_0), servo("1", 2, AXIS_1)],
    faces: &[
        face("0/0", 0, [0.0, -1.0, 0.0], NEG_Y, Z, Gender::Passive),
        face("0/1", 0, [0.0, -0.5, 0.5], Z, Y, Gender::Passive),
        face("0/2", 0, [0.0, -0.5, -0.5], NEG_Z, Y, Gender::Passive),
        face("1/0", 2, [0.0, 1.0, 0.0], Y, Z, Gender::Active),
        face("1/1", 2, [0.0, 0.5, 0.5], Z, Y, Gender::Active),
        face("1/2", 2, [0.0, 0.5, -0.5], NEG_Z, Y, Gender::Active),
    ],
};

const AXIS_0: [f64; 3] = [0.0, -0.5, 0.0];
const AXIS_1: [f64; 3] = [0.0, 0.5, 0.0];
/// Half of the side lengths of a part, mu.
const HALF: [f64; 3] = [0.49; 3];
/// Speed of a servo, π/6 rad/s (section 4).
const SPEED: f32 = std::f32::consts::FRAC_PI_6;
/// Torque of a servo, kg·mu²/s²: at 9.81 mu/s² it lifts another module, 1 kg at 1.5 mu from the axis, and a third more
/// (section 4: "maximum torque to lift another module against gravity").
const TORQUE: f32 = 2.0 * 9.81;

/// Servo between the link, which carries it, and a part.
const fn servo(name: &'static str, part: usize, axis: [f64; 3]) -> HingeKind {
    HingeKind {
        name,
        from: 1,
        to: part,
        anchor: axis,
        axis: Z,
        limits: QUARTER_TURNS,
        speed: Some(SPEED),
        torque: Some(TORQUE),
    }
}

const fn face(
    name: &'static str,
    part: usize,
    position: [f64; 3],
    normal: [f64; 3],
    up: [f64; 3],
    gender: Gender,
) -> FaceKind {
    FaceKind { name, part, position, normal, up, gender }
}
