//! Text of initial states, as in the paper (Yoshida et al. 2003, section 2.2 A).
//!
//! A line holds one module: its number, position, directions of axis and link, and angles in degrees:
//!
//! ```text
//! ID 0 p(0,0,0) z(0,1,0) y(-1,0,0) (0, 0)   # comment
//! ```
//!
//! Lines may come in any order. The numbers of n modules are 0 to n − 1. Spaces between tokens have no meaning. Empty
//! lines are allowed, and `#` begins a comment.

use super::Angle;
use super::{Configuration, MAX_MODULES, Place, PlaceError};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Error in the text of an initial state.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}, column {column}: {message}")]
pub struct TextError {
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// Error, and the values that are allowed.
    pub message: String,
}

/// Reason why a text is not a configuration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InitialStateError {
    /// The text is malformed.
    #[error(transparent)]
    Text(#[from] TextError),
    /// The places are not a configuration.
    #[error(transparent)]
    Place(#[from] PlaceError),
}

impl Configuration {
    /// Returns the configuration of the text of an initial state.
    ///
    /// # Errors
    ///
    /// The text is malformed (see [`parse`]), or its places are not a configuration
    /// (see [`Configuration::of_places`]).
    pub fn of_text(text: &str) -> Result<Self, InitialStateError> {
        Ok(Self::of_places(&parse(text)?)?)
    }
}

/// Returns the places of the text of an initial state; the place of module i is at index i.
///
/// # Errors
///
/// A line is malformed, an angle is not a multiple of 30° from −90° to 90°, or a number of a module is missing, used
/// twice, or not below [`MAX_MODULES`].
pub fn parse(text: &str) -> Result<Vec<Place>, TextError> {
    let mut places: BTreeMap<usize, (usize, Place)> = BTreeMap::new();
    for (index, line) in text.lines().enumerate() {
        let mut cursor = Cursor::of_line(index + 1, line);
        if cursor.at_end() {
            continue;
        }
        cursor.word("ID")?;
        let at = cursor.token();
        let id = cursor.whole(0, MAX_MODULES as i64 - 1, "the number of a module")? as usize;
        if let Some((first, _)) = places.get(&id) {
            return Err(cursor.error(at, format!("module {id} is already in line {first}: a number is used only once")));
        }
        let place = Place {
            position: cursor.vector("p")?,
            z: cursor.vector("z")?,
            y: cursor.vector("y")?,
            angles: cursor.angles()?,
        };
        if !cursor.at_end() {
            return Err(cursor.error(cursor.at, "expected the end of the line or a comment `#`".to_owned()));
        }
        places.insert(id, (index + 1, place));
    }
    for (expected, (&id, &(line, _))) in places.iter().enumerate() {
        if id != expected {
            let message = format!("module {id} without module {expected}: the numbers of n modules must be 0 to n - 1");
            return Err(TextError { line, column: 1, message });
        }
    }
    Ok(places.into_values().map(|(_, place)| place).collect())
}

/// Returns the text of an initial state. [`parse`] returns the same places from it.
pub fn print(places: &[Place]) -> String {
    let mut text = String::new();
    for (id, place) in places.iter().enumerate() {
        let [p, z, y] = [place.position, place.z, place.y].map(|v| v.map(number).join(","));
        let [first, second] = place.angles.map(Angle::degrees);
        writeln!(text, "ID {id} p({p}) z({z}) y({y}) ({first}, {second})").expect("a string accepts all text");
    }
    text
}

/// Returns the shortest text that parses to the same number. Small numbers have an exponent. −0 becomes 0.
fn number(value: f64) -> String {
    match value + 0.0 {
        v if v != 0.0 && v.abs() < 1e-4 => format!("{v:e}"),
        v => format!("{v}"),
    }
}

/// Position in a line without its comment.
struct Cursor {
    line: usize,
    characters: Vec<char>,
    at: usize,
}

impl Cursor {
    fn of_line(line: usize, text: &str) -> Self {
        Self { line, characters: text.chars().take_while(|c| *c != '#').collect(), at: 0 }
    }

    fn error(&self, at: usize, message: String) -> TextError {
        TextError { line: self.line, column: at + 1, message }
    }

    /// Returns true if only spaces remain.
    fn at_end(&mut self) -> bool {
        self.token() == self.characters.len()
    }

    /// Skips spaces and returns the index of the next character.
    fn token(&mut self) -> usize {
        while self.characters.get(self.at).is_some_and(|c| c.is_whitespace()) {
            self.at += 1;
        }
        self.at
    }

    /// Reads a word or a sign.
    fn word(&mut self, word: &str) -> Result<(), TextError> {
        let at = self.token();
        let length = word.chars().count();
        if self.characters[at..].iter().take(length).copied().eq(word.chars()) {
            self.at += length;
            return Ok(());
        }
        let form = "ID n p(x,y,z) z(x,y,z) y(x,y,z) (angle, angle)";
        Err(self.error(at, format!("expected `{word}`: a line has the form `{form}`")))
    }

    /// Reads the characters of a number.
    fn digits(&mut self) -> String {
        let at = self.token();
        let part_of_number = |c: &&char| c.is_ascii_digit() || matches!(c, '+' | '-' | '.' | 'e' | 'E');
        let digits: String = self.characters[at..].iter().take_while(part_of_number).collect();
        self.at += digits.chars().count();
        digits
    }

    /// Reads a whole number from `least` to `most`.
    fn whole(&mut self, least: i64, most: i64, name: &str) -> Result<i64, TextError> {
        let at = self.token();
        let value = self.digits().parse::<i64>().ok().filter(|v| (least..=most).contains(v));
        value.ok_or_else(|| self.error(at, format!("expected {name}: a whole number from {least} to {most}")))
    }

    /// Reads three numbers in brackets after a name.
    fn vector(&mut self, name: &str) -> Result<[f64; 3], TextError> {
        self.word(name)?;
        let mut vector = [0.0; 3];
        for (value, before) in vector.iter_mut().zip(["(", ",", ","]) {
            self.word(before)?;
            let at = self.token();
            let read = self.digits().parse::<f64>().ok().filter(|v| v.is_finite());
            *value = read.ok_or_else(|| self.error(at, format!("expected a coordinate of {name}: a finite number")))?;
        }
        self.word(")")?;
        Ok(vector)
    }

    /// Reads two angles in brackets.
    fn angles(&mut self) -> Result<[Angle; 2], TextError> {
        let mut angles = [Angle::default(); 2];
        for (angle, before) in angles.iter_mut().zip(["(", ","]) {
            self.word(before)?;
            let at = self.token();
            let read = self.digits().parse().ok().and_then(Angle::of_degrees);
            *angle = read.ok_or_else(|| {
                self.error(at, "expected an angle in degrees: a multiple of 30 from -90 to 90".to_owned())
            })?;
        }
        self.word(")")?;
        Ok(angles)
    }
}
