//! Errors in user input.

use std::fmt;

/// A value in a robot, environment or job that can't be used. Never retryable: the file must change.
///
/// `field` is the path of the value inside its file, such as `module[3].attach.port`.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Invalid {
    /// The text is not TOML, or its structure is not the expected one. `message` says where (line and column) and why.
    #[error("{message}")]
    Syntax {
        /// Message of the parser, with line and column.
        message: String,
    },
    /// A number outside of what is allowed; NaN and infinities are always outside.
    #[error("{field} = {value} is out of range: allowed is {min} to {max}{}", unit_suffix(.unit))]
    OutOfRange {
        /// Path of the value.
        field: String,
        /// The value found.
        value: f64,
        /// Least allowed value.
        min: f64,
        /// Greatest allowed value.
        max: f64,
        /// Unit of the three, empty for a pure number.
        unit: &'static str,
    },
    /// A whole number outside of what is allowed, with all its digits.
    #[error("{field} = {value} is out of range: allowed is {min} to {max}{}", unit_suffix(.unit))]
    WholeOutOfRange {
        /// Path of the value.
        field: String,
        /// The value found.
        value: u64,
        /// Least allowed value.
        min: u64,
        /// Greatest allowed value.
        max: u64,
        /// Unit of the three, empty for a pure number.
        unit: &'static str,
    },
    /// A name that nothing has.
    #[error("{field} = \"{value}\" is unknown: {}", Known(.known))]
    Unknown {
        /// Path of the value.
        field: String,
        /// The value found.
        value: String,
        /// The names that exist.
        known: Vec<String>,
    },
    /// The same name twice.
    #[error("{field} = \"{value}\" is used twice: names must be unique")]
    Duplicate {
        /// Path of the second one.
        field: String,
        /// The name.
        value: String,
    },
    /// A name that can't be one.
    #[error(
        "{field} = \"{value}\" is no name: 1 to {} letters, digits, '-', '_' or '.' are allowed",
        crate::base::limits::MAX_NAME_LENGTH
    )]
    Name {
        /// Path of the value.
        field: String,
        /// The value found.
        value: String,
    },
    /// Two parts of the robot occupy the same space in the neutral configuration.
    #[error(
        "modules \"{first}\" and \"{second}\" overlap in the neutral configuration (by {depth:.3} mu): attach one elsewhere"
    )]
    Overlap {
        /// One module.
        first: String,
        /// The other module.
        second: String,
        /// Depth of the overlap, mu.
        depth: f64,
    },
    /// A module that hangs on nothing.
    #[error("module \"{module}\" is not connected to pivot \"{pivot}\": give it an `attach` that leads there")]
    Disconnected {
        /// The module.
        module: String,
        /// The pivot's module.
        pivot: String,
    },
    /// A module attached to itself, directly or around a loop.
    #[error("module \"{module}\" is attached to itself through {through}: attachments must form a tree")]
    AttachmentLoop {
        /// The module.
        module: String,
        /// The way around.
        through: String,
    },
    /// Two modules on one face.
    #[error("{field}: face \"{face}\" of module \"{module}\" is taken by \"{by}\"")]
    FaceTaken {
        /// Path of the second attachment.
        field: String,
        /// The face.
        face: String,
        /// The module that has it.
        module: String,
        /// The module that is attached there already.
        by: String,
    },
    /// A place that has to be free is not.
    #[error("{what} at ({x}, {y}) lies {wrong}")]
    Misplaced {
        /// The misplaced thing: the start or the goal.
        what: &'static str,
        /// mu from the map's centre.
        x: f64,
        /// mu from the map's centre.
        y: f64,
        /// Description of the fault.
        wrong: String,
    },
    /// Something in a robot of another format that a robot here can't have.
    #[error("line {line}, {element}: {reason}")]
    Foreign {
        /// Line on which the element begins.
        line: u32,
        /// The element and its name, such as `<joint name="knee">`.
        element: String,
        /// Why not, and what is allowed.
        reason: String,
    },
    /// Several of these, of one file.
    #[error("{}", Several(.0))]
    Several(Vec<Invalid>),
    /// Two settings that can't stand together, or one that needs another.
    #[error("{field}: {reason}")]
    Conflict {
        /// Path of the value.
        field: String,
        /// Why not, and what would do.
        reason: String,
    },
}

impl From<toml::de::Error> for Invalid {
    fn from(error: toml::de::Error) -> Self {
        let message = error.to_string().trim_end().to_owned();
        Self::Syntax { message: EXPECTED.iter().fold(message, |text, (rust, words)| text.replace(rust, words)) }
    }
}

/// Expectations in a parser's messages, and their wording for readers without knowledge of Rust.
const EXPECTED: [(&str, &str); 4] = [
    // TOML has larger integers than a field here takes.
    ("` as i128", "`"),
    ("expected u32", "expected a whole number, 0 to 4294967295"),
    ("expected u64", "expected a whole number, 0 to 9223372036854775807"),
    ("expected f64", "expected a number"),
];

impl Invalid {
    /// Returns `Ok` without faults, the only fault, or all of them.
    ///
    /// # Errors
    /// If there is one.
    pub fn all(mut faults: Vec<Invalid>) -> Result<(), Invalid> {
        match faults.len() {
            0 => Ok(()),
            1 => Err(faults.swap_remove(0)),
            _ => Err(Invalid::Several(faults)),
        }
    }
}

/// Refusals collected so far, so that a user sees all of them at once.
#[derive(Debug, Default)]
pub(crate) struct Faults(Vec<Invalid>);

impl Faults {
    /// Adds a refusal.
    pub fn add(&mut self, fault: Invalid) {
        match fault {
            Invalid::Several(several) => several.into_iter().for_each(|fault| self.add(fault)),
            fault if self.is_full() || self.0.contains(&fault) => {}
            fault => self.0.push(fault),
        }
    }

    /// The value, or nothing with its refusal added.
    pub fn take<T>(&mut self, found: Result<T, Invalid>) -> Option<T> {
        found.map_err(|fault| self.add(fault)).ok()
    }

    /// Returns true if the limit on listed faults is reached.
    pub fn is_full(&self) -> bool {
        self.0.len() >= crate::base::limits::MAX_FAULTS_SOUGHT
    }

    /// Returns true without faults.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// All refusals in the order of their lines.
    ///
    /// # Errors
    /// If there is one.
    pub fn end(mut self) -> Result<(), Invalid> {
        self.0.sort_by_key(|fault| match fault {
            Invalid::Foreign { line, .. } => *line,
            _ => u32::MAX,
        });
        Invalid::all(self.0)
    }
}

struct Several<'a>(&'a [Invalid]);

impl fmt::Display for Several<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let most = crate::base::limits::MAX_FAULTS;
        let or_more = if self.0.len() < crate::base::limits::MAX_FAULTS_SOUGHT { "" } else { " or more" };
        write!(f, "{} faults{or_more}", self.0.len())?;
        let indented = |fault: &Invalid| fault.to_string().replace('\n', "\n  ");
        self.0.iter().take(most).try_for_each(|fault| write!(f, "\n  {}", indented(fault)))?;
        match self.0.len().checked_sub(most) {
            Some(more @ 1..) => write!(f, "\n  and {more} more: at most {most} are listed"),
            _ => Ok(()),
        }
    }
}

fn unit_suffix(unit: &str) -> String {
    if unit.is_empty() { String::new() } else { format!(" {unit}") }
}

struct Known<'a>(&'a [String]);

impl fmt::Display for Known<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() { f.write_str("there is none") } else { write!(f, "known are {}", self.0.join(", ")) }
    }
}

/// The name that a misspelt one stands for, if one is near enough.
pub(crate) fn nearest<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    let distance = |known: &&str| strsim::damerau_levenshtein(name, known);
    let most = if name.len() < 4 { 1 } else { 2 };
    known.iter().copied().min_by_key(|known| distance(known)).filter(|known| distance(known) <= most)
}

/// Refuses a number outside `min..=max`, and NaN.
pub(crate) fn in_range(
    field: impl Into<String>,
    value: f64,
    (min, max): (f64, f64),
    unit: &'static str,
) -> Result<(), Invalid> {
    if value >= min && value <= max {
        Ok(())
    } else {
        Err(Invalid::OutOfRange { field: field.into(), value, min, max, unit })
    }
}

/// Refuses a whole number outside `min..=max`, however large: a float would round it.
pub(crate) fn whole_in_range(
    field: impl Into<String>,
    value: impl Into<u64>,
    (min, max): (u64, u64),
    unit: &'static str,
) -> Result<(), Invalid> {
    let value = value.into();
    if (min..=max).contains(&value) {
        Ok(())
    } else {
        Err(Invalid::WholeOutOfRange { field: field.into(), value, min, max, unit })
    }
}

/// Refuses texts that can't name a thing in messages, tables and file names.
pub(crate) fn name(field: impl Into<String>, value: &str) -> Result<(), Invalid> {
    let fine = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    if (1..=crate::base::limits::MAX_NAME_LENGTH).contains(&value.len())
        && value.chars().all(fine)
        && value.starts_with(|c: char| c.is_ascii_alphanumeric())
    {
        Ok(())
    } else {
        Err(Invalid::Name { field: field.into(), value: value.to_owned() })
    }
}
