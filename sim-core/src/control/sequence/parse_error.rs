//! Errors in the text of a motion sequence: the place, the text found there and the text expected.

use super::program::{MAX_DEPTH, MAX_ITEMS, MAX_MODULE, MAX_PROGRAM_LENGTH, MAX_SEGMENTS, MAX_TIMES};
use crate::model::mtran::Angle;
use std::fmt;

/// Greatest number of characters of the text that an error repeats.
pub const MAX_FOUND: usize = 20;

/// Characters that end a word and are a word of their own.
const SYMBOLS: [char; 8] = ['{', '}', '[', ']', ',', ';', '#', '°'];

/// Error in the text of a motion sequence.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}, column {column}: found {}, expected {expected}{}", quoted(.found), closing(.opened))]
pub struct ParseError {
    /// Line of the error, from 1.
    pub line: usize,
    /// Column of the error in characters, from 1.
    pub column: usize,
    /// Word or symbol at that place, at most [`MAX_FOUND`] characters of it. It is empty at the end of the text.
    pub found: String,
    /// Text that is allowed there.
    pub expected: Expected,
    /// Innermost opening brace that has no closing brace yet, if the expected text ends with its closing brace.
    pub opened: Option<Place>,
}

impl ParseError {
    /// Describes an error at the byte `at` of a text. `opened` is the byte of the innermost brace that is not closed.
    pub(super) fn new(text: &str, at: usize, expected: Expected, opened: Option<usize>) -> Self {
        let Place { line, column } = Place::of(text, at);
        let opened = opened.filter(|_| expected.names_close()).map(|at| Place::of(text, at));
        Self { line, column, found: shortened(&text[at..]), expected, opened }
    }
}

/// Place in a text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
}

impl Place {
    /// Returns the place of a byte of the text.
    fn of(text: &str, at: usize) -> Self {
        let before = &text[..at];
        let start = before.rfind('\n').map_or(0, |end| end + 1);
        Self { line: before.matches('\n').count() + 1, column: before[start..].chars().count() + 1 }
    }
}

/// Text that is allowed at the place of an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expected {
    /// First item of a program.
    Item,
    /// Further item of a program, or its end.
    ItemOrEnd,
    /// First item of a loop.
    LoopItem,
    /// Further item of a loop, or its closing brace.
    ItemOrClose,
    /// Operation of a segment, or its closing brace.
    OperationOrClose,
    /// Number of repeats of a loop.
    Times,
    /// Opening brace of a loop.
    Open,
    /// Bracket before the number of a module.
    OpenBracket,
    /// Number of a module.
    Module,
    /// Base part of a turn.
    Base,
    /// Part of a connection.
    Part,
    /// Bracket after a part.
    CloseBracket,
    /// Angle of a part.
    Angle,
    /// Comma between the angles of a turn.
    Comma,
    /// Face of a connection.
    Face,
    /// Module that the segment does not turn yet.
    OtherModule,
    /// Face that the segment does not name yet.
    OtherFace,
    /// Text of at most [`MAX_PROGRAM_LENGTH`] bytes.
    ShorterText,
    /// Program of at most [`MAX_PROGRAM_LENGTH`] bytes as it is printed.
    ShorterProgram {
        /// Length of the printed program in bytes.
        printed: usize,
    },
    /// Loops of depth [`MAX_DEPTH`] at most.
    LowerDepth,
    /// At most [`MAX_ITEMS`] items in the text.
    FewerItems,
    /// At most [`MAX_SEGMENTS`] segments, loops unrolled.
    FewerSegments,
}

impl Expected {
    /// Returns true if the description ends with a closing brace.
    fn names_close(self) -> bool {
        matches!(self, Self::LoopItem | Self::ItemOrClose | Self::OperationOrClose)
    }
}

impl fmt::Display for Expected {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let text = match self {
            Self::Item => r#"a segment "{ … }" or a loop "L N { … }""#,
            Self::ItemOrEnd => r#"a segment "{ … }", a loop "L N { … }" or the end of the text"#,
            Self::LoopItem => r#"at least one segment "{ … }" or loop "L N { … }" before the "}""#,
            Self::ItemOrClose => r#"a segment "{ … }", a loop "L N { … }" or the "}""#,
            Self::OperationOrClose => r#"an operation "m [ID base] θ0, θ1" or "c [ID part] face", or the "}""#,
            Self::Times => return write!(f, "a number of repeats: a whole number from 1 to {MAX_TIMES}"),
            Self::Open => r#""{" after the number of repeats"#,
            Self::OpenBracket => r#""[" before the number of the module"#,
            Self::Module => return write!(f, "the number of a module: a whole number from 0 to {MAX_MODULE}"),
            Self::Base => "the base part of the module: 0 or 1",
            Self::Part => "a part of the module: 0 or 1",
            Self::CloseBracket => r#""]" after the part"#,
            Self::Angle => return angle(f),
            Self::Comma => r#""," between the two angles"#,
            Self::Face => "a face: 0, 1 or 2",
            Self::OtherModule => "another module: a segment can turn a module only once",
            Self::OtherFace => "another face: a segment can name a face only once",
            Self::ShorterText => {
                return write!(f, "the end of the text: it can have at most {MAX_PROGRAM_LENGTH} bytes");
            }
            Self::ShorterProgram { printed } => {
                let most = MAX_PROGRAM_LENGTH;
                return write!(
                    f,
                    "a shorter program: with its spaces it has {printed} bytes, at most {most} are allowed"
                );
            }
            Self::LowerDepth => {
                return write!(f, r#"a segment "{{ … }}" or the "}}": loops can be nested at most {MAX_DEPTH} deep"#);
            }
            Self::FewerItems => {
                return write!(f, "no further item: a text can have at most {MAX_ITEMS} segments and loops");
            }
            Self::FewerSegments => {
                return write!(f, "fewer segments: with all loops unrolled there can be at most {MAX_SEGMENTS}");
            }
        };
        f.write_str(text)
    }
}

/// Writes the angles that are allowed.
fn angle(f: &mut fmt::Formatter) -> fmt::Result {
    let most = i32::from(Angle::MOST) * Angle::STEP;
    write!(f, "an angle: a multiple of {} degrees from -{most} to {most}", Angle::STEP)
}

/// Returns the word at the start of a text, or none at its end, with control characters escaped.
fn quoted(found: &str) -> String {
    match found {
        "" => "the end of the text".to_owned(),
        _ => format!("\"{}\"", found.escape_debug()),
    }
}

/// Names the brace that the closing brace before these words closes.
fn closing(opened: &Option<Place>) -> String {
    opened.map_or_else(String::new, |Place { line, column }| {
        format!(r#" that closes the "{{" at line {line}, column {column}"#)
    })
}

/// Returns true if a word ends before the character.
pub(super) fn ends_word(c: char) -> bool {
    c.is_whitespace() || SYMBOLS.contains(&c)
}

/// Returns the word or symbol at the start of a text, at most [`MAX_FOUND`] characters of it.
fn shortened(text: &str) -> String {
    let mut word: String = text.chars().take(1).collect();
    if word.starts_with(ends_word) {
        return word;
    }
    let mut rest = text.chars().skip(1).take_while(|c| !ends_word(*c));
    word.extend(rest.by_ref().take(MAX_FOUND - 1));
    if rest.next().is_some() {
        word.pop();
        word.push('…');
    }
    word
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn place_counts_lines_and_characters_from_one() {
        let text = "é{\r\n−°L";
        let places = text.char_indices().map(|(at, _)| Place::of(text, at)).map(|place| (place.line, place.column));
        assert_eq!(places.collect::<Vec<_>>(), [(1, 1), (1, 2), (1, 3), (1, 4), (2, 1), (2, 2), (2, 3)]);
        assert_eq!(Place::of(text, text.len()), Place { line: 2, column: 4 });
    }

    #[test]
    fn found_text_ends_with_the_word() {
        for (text, found) in [("", ""), ("{{", "{"), ("−45°", "−45"), ("°", "°"), ("one two", "one"), (" a", " ")]
        {
            assert_eq!(shortened(text), found);
        }
    }

    #[test]
    fn long_word_is_shortened() {
        assert_eq!(shortened(&"é".repeat(MAX_FOUND)), "é".repeat(MAX_FOUND));
        assert_eq!(shortened(&"é".repeat(MAX_FOUND + 1)), "é".repeat(MAX_FOUND - 1) + "…");
    }

    #[test]
    fn control_characters_are_escaped() {
        let error = ParseError::new("\u{1b}[0m", 0, Expected::Face, None);
        assert_eq!(error.to_string(), r#"line 1, column 1: found "\u{1b}", expected a face: 0, 1 or 2"#);
    }
}
