//! Faces of a robot of M-TRAN modules, by number.

/// Face of a part of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Port {
    /// Number of the module.
    pub module: u32,
    /// Part of the module, 0 or 1.
    pub part: u8,
    /// Face of the part: 0 is its flat end, 1 and 2 are its sides at +z and −z.
    pub face: u8,
}
