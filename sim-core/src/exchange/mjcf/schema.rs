//! Schema of MJCF: every element and attribute that is imported, ignored, or refused with a reason.
//!
//! The names are those that MuJoCo 4.0.1 prints as its schema (`mj_printSchema`), and a few of older versions.

use crate::exchange::schema::{Child, Rule};

/// The root element.
pub(super) static MUJOCO: Rule = Rule {
    tag: "mujoco",
    read: &["model"],
    passed: &[],
    refused: &[],
    children: &[
        Child::Many(&COMPILER),
        Child::Many(&DEFAULT),
        Child::Many(&OPTION),
        Child::Many(&WORLDBODY),
        Child::Many(&CONTACT),
        Child::Many(&ACTUATOR),
        Child::Passed("asset"),
        Child::Passed("size"),
        Child::Passed("visual"),
        Child::Passed("statistic"),
        Child::Passed("custom"),
        Child::Passed("keyframe"),
        Child::Passed("sensor"),
        Child::Empty("equality", "constraints other than hinges, such as closed loops, can't be imported"),
        Child::Empty("tendon", "tendons can't be imported"),
        Child::Empty("deformable", "deformable bodies can't be imported"),
        Child::Empty("extension", "plugins can't be imported"),
        Child::Refused("include", "included files can't be imported: put everything into one file"),
    ],
};

static COMPILER: Rule = Rule {
    tag: "compiler",
    read: &[
        "angle",
        "autolimits",
        "balanceinertia",
        "boundinertia",
        "boundmass",
        "coordinate",
        "eulerseq",
        "inertiafromgeom",
        "inertiagrouprange",
        "settotalmass",
    ],
    passed: &[
        "alignfree",
        "assetdir",
        "conflict",
        "discardvisual",
        "fitaabb",
        "fusestatic",
        "meshdir",
        "passthrough",
        "savecanonical",
        "savecompiled",
        "saveinertial",
        "strippath",
        "texturedir",
        "usethread",
    ],
    refused: &[],
    children: &[Child::Passed("lengthrange")],
};

static OPTION: Rule = Rule {
    tag: "option",
    read: &["density", "viscosity"],
    passed: &[
        "actuatorgroupdisable",
        "apirate",
        "ccd_iterations",
        "ccd_tolerance",
        "collision",
        "cone",
        "gravity",
        "impratio",
        "integrator",
        "iterations",
        "jacobian",
        "ls_iterations",
        "ls_tolerance",
        "magnetic",
        "mpr_iterations",
        "mpr_tolerance",
        "noslip_iterations",
        "noslip_tolerance",
        "o_friction",
        "o_margin",
        "o_solimp",
        "o_solref",
        "sdf_initpoints",
        "sdf_iterations",
        "sleep_tolerance",
        "solver",
        "timestep",
        "tolerance",
        "wind",
    ],
    refused: &[],
    children: &[Child::Once(&FLAG)],
};

/// The flags in `read` switch off physics that every job has.
static FLAG: Rule = Rule {
    tag: "flag",
    read: &["actuation", "constraint", "contact", "filterparent", "gravity", "limit"],
    passed: &[
        "autoreset",
        "clampctrl",
        "damper",
        "diagexact",
        "energy",
        "equality",
        "eulerdamp",
        "frictionloss",
        "fwdinv",
        "invdiscrete",
        "ipc",
        "island",
        "midphase",
        "multiccd",
        "nativeccd",
        "override",
        "passive",
        "refsafe",
        "sensor",
        "sensornoise",
        "sleep",
        "speculative",
        "spring",
        "warmstart",
    ],
    refused: &[],
    children: &[],
};

static DEFAULT: Rule = Rule {
    tag: "default",
    read: &["class"],
    passed: &[],
    refused: &[],
    children: &[
        Child::Many(&DEFAULT),
        Child::Template(&JOINT),
        Child::Template(&GEOM),
        Child::Template(&GENERAL),
        Child::Template(&MOTOR),
        Child::Template(&POSITION),
        Child::Template(&VELOCITY),
        Child::Template(&INTVELOCITY),
        Child::Passed("adhesion"),
        Child::Passed("camera"),
        Child::Passed("cylinder"),
        Child::Passed("damper"),
        Child::Passed("dcmotor"),
        Child::Passed("equality"),
        Child::Passed("light"),
        Child::Passed("material"),
        Child::Passed("mesh"),
        Child::Passed("muscle"),
        Child::Passed("orientation"),
        Child::Passed("pair"),
        Child::Passed("pid"),
        Child::Passed("site"),
        Child::Passed("tendon"),
        Child::Passed("texture"),
    ],
};

const COMPOSITE: Child = Child::Refused("composite", "composites can't be imported: write their bodies one by one");
const REPLICATE: Child = Child::Refused("replicate", "replicated bodies can't be imported: write them one by one");
const ATTACH: Child = Child::Refused("attach", "other models can't be attached: put everything into one file");
const FLEX: Child = Child::Refused("flexcomp", "deformable bodies can't be imported");
const PLUGIN: Child = Child::Refused("plugin", "plugins can't be imported");
const INCLUDE: Child = Child::Refused("include", "included files can't be imported: put everything into one file");

static WORLDBODY: Rule = Rule {
    tag: "worldbody",
    read: &[],
    passed: &[],
    refused: &[],
    children: &[
        Child::Many(&BODY),
        Child::Many(&FRAME),
        Child::Many(&GEOM),
        Child::Passed("light"),
        Child::Passed("camera"),
        Child::Passed("site"),
        COMPOSITE,
        REPLICATE,
        ATTACH,
        FLEX,
        INCLUDE,
    ],
};

/// Content of bodies, directly or in frames.
static IN_BODY: [Child; 14] = [
    Child::Once(&INERTIAL),
    Child::Many(&JOINT),
    Child::Once(&FREEJOINT),
    Child::Many(&GEOM),
    Child::Many(&BODY),
    Child::Many(&FRAME),
    Child::Passed("site"),
    Child::Passed("camera"),
    Child::Passed("light"),
    COMPOSITE,
    REPLICATE,
    ATTACH,
    FLEX,
    INCLUDE,
];

static BODY: Rule = Rule {
    tag: "body",
    read: &["name", "childclass", "pos", "quat", "euler", "axisangle", "xyaxes", "zaxis", "mocap", "gravcomp"],
    passed: &["fuse", "simple", "sleep", "user"],
    refused: &[],
    children: &IN_BODY,
};

static FRAME: Rule = Rule {
    tag: "frame",
    read: &["name", "childclass", "pos", "quat", "euler", "axisangle", "xyaxes", "zaxis"],
    passed: &[],
    refused: &[],
    children: &IN_BODY,
};

static INERTIAL: Rule = Rule {
    tag: "inertial",
    read: &["pos", "quat", "euler", "axisangle", "xyaxes", "zaxis", "mass", "diaginertia", "fullinertia"],
    passed: &[],
    refused: &[],
    children: &[],
};

static JOINT: Rule = Rule {
    tag: "joint",
    read: &[
        "name",
        "class",
        "type",
        "pos",
        "axis",
        "range",
        "limited",
        "ref",
        "stiffness",
        "damping",
        "armature",
        "frictionloss",
        "springdamper",
    ],
    passed: &[
        "actuatorfrclimited",
        "actuatorfrcrange",
        "actuatorgravcomp",
        "group",
        "margin",
        "solimpfriction",
        "solimplimit",
        "solreffriction",
        "solreflimit",
        "springref",
        "springyield",
        "user",
    ],
    refused: &[],
    children: &[],
};

static FREEJOINT: Rule =
    Rule { tag: "freejoint", read: &["name"], passed: &["align", "group"], refused: &[], children: &[] };

static GEOM: Rule = Rule {
    tag: "geom",
    read: &[
        "name",
        "class",
        "type",
        "size",
        "fromto",
        "pos",
        "quat",
        "euler",
        "axisangle",
        "xyaxes",
        "zaxis",
        "mass",
        "density",
        "contype",
        "conaffinity",
        "condim",
        "shellinertia",
    ],
    passed: &[
        "castshadow",
        "fitscale",
        "fluidcoef",
        "fluidshape",
        "friction",
        "gap",
        "group",
        "hfield",
        "margin",
        "material",
        "mesh",
        "priority",
        "rgba",
        "solimp",
        "solmix",
        "solref",
        "user",
    ],
    refused: &["adhesion", "surfacevel"],
    children: &[PLUGIN],
};

static CONTACT: Rule = Rule {
    tag: "contact",
    read: &[],
    passed: &[],
    refused: &[],
    children: &[
        Child::Many(&EXCLUDE),
        Child::Refused("pair", "contacts of single pairs can't be imported: all bodies without a common joint touch"),
    ],
};

static EXCLUDE: Rule =
    Rule { tag: "exclude", read: &["name", "body1", "body2"], passed: &[], refused: &[], children: &[] };

static ACTUATOR: Rule = Rule {
    tag: "actuator",
    read: &[],
    passed: &[],
    refused: &[],
    children: &[
        Child::Many(&GENERAL),
        Child::Many(&MOTOR),
        Child::Many(&POSITION),
        Child::Many(&VELOCITY),
        Child::Many(&INTVELOCITY),
        Child::Refused("adhesion", NOT_A_JOINT),
        Child::Refused("cylinder", NO_SERVO),
        Child::Refused("damper", NO_SERVO),
        Child::Refused("dcmotor", NO_SERVO),
        Child::Refused("muscle", NO_SERVO),
        Child::Refused("orientation", NOT_A_JOINT),
        Child::Refused("pid", NO_SERVO),
        PLUGIN,
    ],
};

const NOT_A_JOINT: &str = "only actuators of joints can be imported";
const NO_SERVO: &str = "this actuator can't be imported: allowed are position, velocity, motor, general, intvelocity";

/// Defines the rule of an actuator of joints, with the attributes that all of them share. Gains and force limits come
/// from the job.
macro_rules! actuator {
    ($name:ident: $tag:literal, read: [$($read:literal),*], passed: [$($passed:literal),*]) => {
        static $name: Rule = Rule {
            tag: $tag,
            read: &["name", "class", "joint", "jointinparent", "ctrlrange", "ctrllimited", "gear", $($read),*],
            passed: &[
                "armature", "damping", "delay", "forcelimited", "forcerange", "group", "interp", "lengthrange",
                "nsample", "user", $($passed),*
            ],
            refused: &["body", "cranklength", "cranksite", "refsite", "site", "slidersite", "tendon"],
            children: &[],
        };
    };
}

actuator!(GENERAL: "general", read: ["biastype", "inheritrange"], passed: [
    "actdim", "actearly", "actlimited", "actrange", "biasprm", "dynprm", "dyntype", "ffrange", "gainprm", "gaintype",
    "input", "velrange"
]);
actuator!(MOTOR: "motor", read: [], passed: []);
actuator!(POSITION: "position", read: ["inheritrange"], passed: ["dampratio", "kp", "kv", "timeconst"]);
actuator!(VELOCITY: "velocity", read: [], passed: ["kv"]);
actuator!(INTVELOCITY: "intvelocity", read: ["inheritrange"], passed: [
    "actlimited", "actrange", "dampratio", "kp", "kv"
]);
