//! Schema of URDF: every element and attribute that is imported, ignored, or refused with a reason. It covers the
//! published specification and the extensions that common tools write.

use crate::exchange::schema::{Child, Rule};

const fn rule(tag: &'static str, read: &'static [&'static str], children: &'static [Child]) -> Rule {
    Rule { tag, read, passed: &[], refused: &[], children }
}

/// The root element.
pub(super) static ROBOT: Rule = Rule {
    passed: &["version"],
    ..rule(
        "robot",
        &["name"],
        &[
            Child::Many(&LINK),
            Child::Many(&JOINT),
            Child::Passed("material"),
            Child::Passed("transmission"),
            Child::Passed("gazebo"),
            Child::Passed("ros2_control"),
            Child::Passed("sensor"),
            Child::Passed("mujoco"),
        ],
    )
};

static LINK: Rule = Rule {
    passed: &["type"],
    ..rule(
        "link",
        &["name"],
        &[
            Child::Once(&INERTIAL),
            Child::Many(&COLLISION),
            Child::Passed("visual"),
            Child::Passed("contact"),
            Child::Passed("self_collision_checking"),
            Child::Passed("sensor"),
        ],
    )
};

static ORIGIN: Rule = rule("origin", &["xyz", "rpy"], &[]);
static MASS: Rule = rule("mass", &["value"], &[]);
static INERTIA: Rule = rule("inertia", &["ixx", "iyy", "izz", "ixy", "ixz", "iyz"], &[]);
static INERTIAL: Rule = rule("inertial", &[], &[Child::Once(&ORIGIN), Child::Once(&MASS), Child::Once(&INERTIA)]);
static COLLISION: Rule = rule("collision", &["name"], &[Child::Once(&ORIGIN), Child::Once(&GEOMETRY)]);

const SHAPE: &str = "only box and capsule are allowed as collision shapes";

static GEOMETRY: Rule = rule(
    "geometry",
    &[],
    &[
        Child::Many(&BOX),
        Child::Many(&CAPSULE),
        Child::Refused("sphere", SHAPE),
        Child::Refused("cylinder", SHAPE),
        Child::Refused("mesh", SHAPE),
    ],
);
static BOX: Rule = rule("box", &["size"], &[]);
static CAPSULE: Rule = rule("capsule", &["radius", "length"], &[]);

static JOINT: Rule = rule(
    "joint",
    &["name", "type"],
    &[
        Child::Once(&ORIGIN),
        Child::Once(&PARENT),
        Child::Once(&CHILD),
        Child::Once(&AXIS),
        Child::Once(&LIMIT),
        Child::Once(&DYNAMICS),
        Child::Passed("calibration"),
        Child::Passed("safety_controller"),
        Child::Refused("mimic", "it mimics another joint: every joint needs its own motor"),
    ],
);
static PARENT: Rule = rule("parent", &["link"], &[]);
static CHILD: Rule = rule("child", &["link"], &[]);
static AXIS: Rule = rule("axis", &["xyz"], &[]);
static LIMIT: Rule = Rule { passed: &["effort", "velocity"], ..rule("limit", &["lower", "upper"], &[]) };
static DYNAMICS: Rule = rule("dynamics", &["damping", "friction"], &[]);
