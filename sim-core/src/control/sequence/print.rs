//! Text of motion sequences: one segment a line, loops indented (Yoshida et al. 2003, section 2.2 B).
//!
//! Parsing the text of a valid program returns the same program.

use super::program::{Item, Program, Segment, Turn};
use crate::model::mtran::{Angle, Port};
use std::fmt;

/// Spaces that a loop adds before its items.
const INDENT: usize = 2;

/// Writes one segment a line. There is no line break at the end.
impl fmt::Display for Program {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        for (index, item) in self.items.iter().enumerate() {
            if index > 0 {
                writeln!(f)?;
            }
            write_item(f, item, 0)?;
        }
        Ok(())
    }
}

/// Writes an item after so many spaces.
fn write_item(f: &mut fmt::Formatter, item: &Item, spaces: usize) -> fmt::Result {
    match item {
        Item::Segment(segment) => write!(f, "{:spaces$}{segment}", ""),
        Item::Loop { times, items } => {
            writeln!(f, "{:spaces$}L {times} {{", "")?;
            for item in items {
                write_item(f, item, spaces + INDENT)?;
                writeln!(f)?;
            }
            write!(f, "{:spaces$}}}", "")
        }
    }
}

/// Writes the turns, then the connections.
impl fmt::Display for Segment {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("{ ")?;
        for turn in &self.turns {
            write!(f, "{turn} ")?;
        }
        for connection in &self.connections {
            write!(f, "{connection} ")?;
        }
        f.write_str("}")
    }
}

impl fmt::Display for Turn {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let [first, second] = self.angles;
        write!(f, "m [{} {}] {first}, {second}", self.module, self.base)
    }
}

impl fmt::Display for Port {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "c [{} {}] {}", self.module, self.part, self.face)
    }
}

/// Writes degrees without their sign `°`.
impl fmt::Display for Angle {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        self.degrees().fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::super::parse::parse;
    use super::super::program::{MAX_DEPTH, MAX_PROGRAM_LENGTH, MAX_SEGMENTS};
    use super::super::samples::program;
    use proptest::prelude::*;

    #[test]
    fn program_is_printed_one_segment_a_line() {
        let text = "{} {c[1 1]0;m[1,1]0°,−90} L 3{{m[0 0]90,0}L 2{{}}}";
        let printed = "\
{ }
{ m [1 1] 0, -90 c [1 1] 0 }
L 3 {
  { m [0 0] 90, 0 }
  L 2 {
    { }
  }
}";
        assert_eq!(parse(text).unwrap().to_string(), printed);
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 1_000, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn printed_program_parses_to_itself(program in program()) {
            let text = program.to_string();
            prop_assert!(text.len() <= MAX_PROGRAM_LENGTH && program.count() <= MAX_SEGMENTS);
            prop_assert_eq!(parse(&text), Ok(program));
        }

        #[test]
        fn count_is_the_number_of_unrolled_segments(program in program()) {
            prop_assert_eq!(program.count(), program.segments().count() as u64);
        }
    }

    #[test]
    fn deepest_loops_print_and_parse() {
        let text = format!("{}{{ }}{}", "L 1 {".repeat(MAX_DEPTH), "}".repeat(MAX_DEPTH));
        let program = parse(&text).unwrap();
        assert_eq!(parse(&program.to_string()), Ok(program));
    }
}
