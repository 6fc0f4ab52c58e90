//! Rules of static feasibility, and the refusals of segments (Yoshida et al. 2003, section 3.2 B).

use crate::model::mtran::PENETRATION;
use std::fmt;

/// Reading of the paper's sentence on connections: "the software assumes that the motion operation automatically cuts
/// all the connections of moving part that changes its position", unless they are named by `c`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Reading {
    /// A turn cuts all connections of its moving part, also if its angles stay the same. A connection is kept if the
    /// segment names either of its two faces.
    #[default]
    EitherFace,
    /// As [`Reading::EitherFace`], but the named face must be on the moving part. If both faces are on moving parts,
    /// both must be named.
    MovingFace,
    /// As [`Reading::EitherFace`], but a turn that changes no angle of its module cuts nothing.
    Changed,
    /// As [`Reading::EitherFace`], and the base part of each turned module must be connected to another module after
    /// the cuts. The paper: "explicitly fixed to another module".
    FixedBase,
}

impl Reading {
    /// All readings.
    pub const ALL: [Self; 4] = [Self::EitherFace, Self::MovingFace, Self::Changed, Self::FixedBase];

    /// Returns the name of the reading.
    pub fn name(self) -> &'static str {
        match self {
            Self::EitherFace => "either-face",
            Self::MovingFace => "moving-face",
            Self::Changed => "changed",
            Self::FixedBase => "fixed-base",
        }
    }
}

/// Rule that a segment breaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Rule {
    /// Modules exist.
    Module,
    /// Parts and faces exist, and a module is turned at most once a segment.
    Form,
    /// All modules stay connected to each other after the cuts.
    Connectivity,
    /// Base parts are connected to other modules ([`Reading::FixedBase`] only).
    Base,
    /// Connections that close a loop stay closed during the motion.
    Loop,
    /// Parts of different modules do not overlap during the motion.
    Collision,
}

impl Rule {
    /// All rules, in the order in which they are checked.
    pub const ALL: [Self; 6] = [Self::Module, Self::Form, Self::Connectivity, Self::Base, Self::Loop, Self::Collision];

    /// Returns the name of the rule.
    pub fn name(self) -> &'static str {
        match self {
            Self::Module => "module",
            Self::Form => "form",
            Self::Connectivity => "connectivity",
            Self::Base => "base",
            Self::Loop => "loop",
            Self::Collision => "collision",
        }
    }
}

/// Refusal of a segment.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub struct Refusal {
    /// Index of the segment in its program, from 0; `None` if the segment was applied alone.
    pub segment: Option<usize>,
    /// Rule that the segment breaks.
    pub rule: Rule,
    /// Numbers of the modules that break it, in order.
    pub modules: Vec<u32>,
    /// Values that break the rule, and those that are allowed.
    pub reason: String,
}

impl Refusal {
    pub(super) fn new(rule: Rule, mut modules: Vec<u32>, reason: String) -> Self {
        modules.sort_unstable();
        modules.dedup();
        Self { segment: None, rule, modules, reason }
    }

    /// Returns the refusal with the index of its segment in a program.
    pub fn in_segment(self, index: usize) -> Self {
        Self { segment: Some(index), ..self }
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.segment {
            Some(index) => write!(f, "segment {index}: ")?,
            None => write!(f, "segment: ")?,
        }
        write!(f, "rule {}: {}", self.rule.name(), self.reason)
    }
}

/// Semantics of segments: the reading of the paper, and the rules that are checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Semantics {
    /// Reading of the paper's sentence on cut connections.
    pub reading: Reading,
    /// All modules must stay connected. If false, a segment may divide the robot; pieces without a turned module stay
    /// where they are.
    pub connectivity: bool,
    /// Greatest depth of an overlap of two parts that is not a collision, mu. `None`: collisions are not checked.
    pub penetration: Option<f64>,
}

impl Default for Semantics {
    fn default() -> Self {
        Self { reading: Reading::default(), connectivity: true, penetration: Some(PENETRATION) }
    }
}
