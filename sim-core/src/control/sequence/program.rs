//! Programs of motion sequences: segments of turns and connections, and loops (Yoshida et al. 2003, section 2.2 B).

use crate::model::mtran::{Angle, Port};
use std::slice;

/// Greatest length of a program's text in bytes (UTF-8), both as it is read and as it is printed.
pub const MAX_PROGRAM_LENGTH: usize = 65_536;
/// Greatest number of repeats of a loop.
pub const MAX_TIMES: u32 = 1_000;
/// Greatest depth of loops in loops. A loop that is in no other loop has depth 1.
pub const MAX_DEPTH: usize = 8;
/// Greatest number of items in a text: segments and loops, each counted once, at any depth.
pub const MAX_ITEMS: usize = 1_000;
/// Greatest number of segments of a program with all loops unrolled.
pub const MAX_SEGMENTS: u64 = 10_000;
/// Greatest number of a module.
pub const MAX_MODULE: u32 = 255;

/// Program: what a robot repeats until its time is over.
///
/// Its text is read by [`parse`](super::parse::parse) and written by `Display`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Program {
    /// Segments and loops, in the order in which they are carried out.
    pub items: Vec<Item>,
}

impl Program {
    /// Returns the segments in the order in which they are carried out, loops unrolled. No segment is copied.
    pub fn segments(&self) -> impl Iterator<Item = &Segment> {
        Segments { levels: vec![Level::new(1, &self.items)] }
    }

    /// Returns the number of segments with all loops unrolled, `u64::MAX` if there are more.
    pub fn count(&self) -> u64 {
        count(&self.items)
    }
}

/// Segment, or a loop over items.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Item {
    /// One segment.
    Segment(Segment),
    /// Items that are carried out `times` times: `L times { … }`.
    Loop {
        /// Number of repeats, 1 to [`MAX_TIMES`].
        times: u32,
        /// Items of the loop, at least one.
        items: Vec<Item>,
    },
}

impl Item {
    /// Returns the number of segments with all loops unrolled, `u64::MAX` if there are more.
    pub fn count(&self) -> u64 {
        match self {
            Self::Segment(_) => 1,
            Self::Loop { times, items } => count(items).saturating_mul(u64::from(*times)),
        }
    }
}

/// Counts the segments of some items, loops unrolled.
fn count(items: &[Item]) -> u64 {
    items.iter().map(Item::count).fold(0, u64::saturating_add)
}

/// Iterator over the segments of a program, loops unrolled. It allocates one level a nested loop.
struct Segments<'a> {
    /// Loops that are being carried out, the outermost first. The first level is the program itself.
    levels: Vec<Level<'a>>,
}

/// Loop that is being carried out.
struct Level<'a> {
    /// Repeats left after the current one.
    left: u32,
    /// All items of the loop.
    items: &'a [Item],
    /// Items left of the current repeat.
    rest: slice::Iter<'a, Item>,
}

impl<'a> Level<'a> {
    /// Begins a loop. With no repeats it has no items.
    fn new(times: u32, items: &'a [Item]) -> Self {
        let items = if times == 0 { &[] } else { items };
        Self { left: times.saturating_sub(1), items, rest: items.iter() }
    }
}

impl<'a> Iterator for Segments<'a> {
    type Item = &'a Segment;

    fn next(&mut self) -> Option<&'a Segment> {
        loop {
            let level = self.levels.last_mut()?;
            match level.rest.next() {
                Some(Item::Segment(segment)) => return Some(segment),
                Some(Item::Loop { times, items }) => self.levels.push(Level::new(*times, items)),
                None if level.left > 0 && !level.items.is_empty() => {
                    level.left -= 1;
                    level.rest = level.items.iter();
                }
                None => drop(self.levels.pop()),
            }
        }
    }
}

/// Operations that are carried out at once. It ends when the target of its slowest servo arrives.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Segment {
    /// Turns, at most one a module.
    pub turns: Vec<Turn>,
    /// Faces whose connections are kept, or made at the end: `c [module part] face`. A face is named at most once.
    pub connections: Vec<Port>,
}

/// Operation `m [module base] θ₀, θ₁`: turns both servos of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Turn {
    /// Number of the module.
    pub module: u32,
    /// Part that stays fixed to other modules, 0 or 1. The other one is the moving part.
    pub base: u8,
    /// Angles of part 0 and part 1 relative to the link.
    pub angles: [Angle; 2],
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(module: u32) -> Item {
        let turn = Turn { module, base: 0, angles: [Angle::default(); 2] };
        Item::Segment(Segment { turns: vec![turn], connections: Vec::new() })
    }

    fn looped(times: u32, items: Vec<Item>) -> Item {
        Item::Loop { times, items }
    }

    fn modules(program: &Program) -> Vec<u32> {
        program.segments().map(|segment| segment.turns[0].module).collect()
    }

    #[test]
    fn segments_of_nested_loops_come_in_order() {
        let inner = looped(2, vec![segment(2), segment(3)]);
        let program = Program { items: vec![segment(0), looped(2, vec![segment(1), inner]), segment(4)] };
        assert_eq!(modules(&program), [0, 1, 2, 3, 2, 3, 1, 2, 3, 2, 3, 4]);
        assert_eq!(program.count(), 12);
    }

    #[test]
    fn empty_loops_have_no_segments() {
        let empty = looped(u32::MAX, Vec::new());
        let program = Program { items: vec![looped(0, vec![segment(1)]), empty, segment(2)] };
        assert_eq!(modules(&program), [2]);
        assert_eq!(program.count(), 1);
        assert_eq!(Program::default().count(), 0);
        assert_eq!(Program::default().segments().count(), 0);
    }

    #[test]
    fn segments_are_not_copied() {
        let program = Program { items: vec![looped(2, vec![segment(1)])] };
        let found: Vec<&Segment> = program.segments().collect();
        assert!(std::ptr::eq(found[0], found[1]));
    }

    #[test]
    fn count_saturates() {
        let deep = (0..3).fold(segment(0), |item, _| looped(u32::MAX, vec![item]));
        assert_eq!(Program { items: vec![deep, segment(0)] }.count(), u64::MAX);
    }
}
