//! Errors in user input.

use std::fmt;

/// Error for a value in a robot, environment or job that can't be used. It is never retryable: the file must change.
///
/// `field` is the path of the value inside its file, such as `module[3].attach.port`.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Invalid {
    /// The text is not TOML, or lacks the expected structure.
    #[error("{message}")]
    Syntax {
        /// Message of the parser, with line and column.
        message: String,
    },
    /// A number is outside its range. NaN and infinities are always outside.
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
        /// Unit of value, min and max; empty for a pure number.
        unit: &'static str,
    },
    /// A whole number is outside its range. It is shown with all its digits.
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
        /// Unit of value, min and max; empty for a pure number.
        unit: &'static str,
    },
    /// A name does not exist.
    #[error("{field} = \"{value}\" is unknown: {}", Known(.known))]
    Unknown {
        /// Path of the value.
        field: String,
        /// The value found.
        value: String,
        /// The names that exist.
        known: Vec<String>,
    },
    /// A name is used twice.
    #[error("{field} = \"{value}\" is used twice: names must be unique")]
    Duplicate {
        /// Path of the second use.
        field: String,
        /// The name.
        value: String,
    },
    /// A text is not allowed as a name.
    #[error(
        "{field} = \"{value}\" is not a valid name: allowed are 1 to {} letters, digits, '-', '_' or '.', \
         first a letter or digit",
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
    /// A module is not connected to the pivot.
    #[error("module \"{module}\" is not connected to pivot \"{pivot}\": give it an `attach` that leads there")]
    Disconnected {
        /// The module.
        module: String,
        /// The pivot's module.
        pivot: String,
    },
    /// A module is attached to itself, directly or around a loop.
    #[error("module \"{module}\" is attached to itself through {through}: attachments must form a tree")]
    AttachmentLoop {
        /// The module.
        module: String,
        /// Modules along the loop.
        through: String,
    },
    /// Two modules are attached to one face.
    #[error("{field}: face \"{face}\" of module \"{module}\" is already taken by \"{by}\": attach one elsewhere")]
    FaceTaken {
        /// Path of the second attachment.
        field: String,
        /// Name of the face.
        face: String,
        /// Module that has the face.
        module: String,
        /// Module that is attached there already.
        by: String,
    },
    /// The start or the goal lies outside the map or in an obstacle.
    #[error("{what} at ({x}, {y}) lies {wrong}")]
    Misplaced {
        /// Name of the misplaced thing: "the start" or "the goal".
        what: &'static str,
        /// x from the map's centre, mu.
        x: f64,
        /// y from the map's centre, mu.
        y: f64,
        /// Description of the fault.
        wrong: String,
    },
    /// An element of a robot in another format can't be imported.
    #[error("line {line}, {element}: {reason}")]
    Foreign {
        /// Line on which the element begins.
        line: u32,
        /// The element and its name, such as `<joint name="knee">`.
        element: String,
        /// Reason, and what is allowed.
        reason: String,
    },
    /// Several faults of one file.
    #[error("{}", Several(.0))]
    Several(Vec<Invalid>),
    /// Two settings exclude each other, or one needs another.
    #[error("{field}: {reason}")]
    Conflict {
        /// Path of the value.
        field: String,
        /// Reason, and how to resolve it.
        reason: String,
    },
}

impl From<toml::de::Error> for Invalid {
    fn from(error: toml::de::Error) -> Self {
        let message = without_structs(error.to_string().trim_end());
        Self::Syntax { message: EXPECTED.iter().fold(message, |text, (rust, words)| text.replace(rust, words)) }
    }
}

/// Replaces "struct Name" of a message by "a table": the names of Rust types say nothing to users.
fn without_structs(message: &str) -> String {
    let (head, rest) = match message.split_once(STRUCT) {
        Some(split) => split,
        None => return message.to_owned(),
    };
    let name = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
    format!("{head}expected a table{}", without_structs(&rest[name..]))
}

/// Words before the name of a Rust type in the TOML parser's messages.
const STRUCT: &str = "expected struct ";

/// Rust types in the TOML parser's messages, with wording that needs no knowledge of Rust.
const EXPECTED: [(&str, &str); 11] = [
    // The parser adds this to integers that are too large for the field.
    ("` as i128", "`"),
    ("expected u32", "expected a whole number, 0 to 4294967295"),
    ("expected u64", "expected a whole number, 0 to 9223372036854775807"),
    ("expected f64", "expected a number"),
    ("expected i32", "expected a whole number"),
    ("expected a tuple of size", "expected an array of length"),
    ("expected a sequence", "expected an array"),
    ("invalid type: sequence", "invalid type: array"),
    ("expected a map", "expected a table"),
    ("invalid type: map", "invalid type: table"),
    ("wanted string or table", "expected a string"),
];

impl Invalid {
    /// Returns `Ok` without faults, the only fault, or all of them as [`Invalid::Several`].
    ///
    /// # Errors
    /// If there is at least one fault.
    pub fn all(mut faults: Vec<Invalid>) -> Result<(), Invalid> {
        match faults.len() {
            0 => Ok(()),
            1 => Err(faults.swap_remove(0)),
            _ => Err(Invalid::Several(faults)),
        }
    }
}

/// Faults collected while a file is checked, so that the user gets all of them at once.
#[derive(Debug, Default)]
pub(crate) struct Faults(Vec<Invalid>);

impl Faults {
    /// Adds a fault, unless it is listed already or the list is full.
    pub fn add(&mut self, fault: Invalid) {
        match fault {
            Invalid::Several(several) => several.into_iter().for_each(|fault| self.add(fault)),
            fault if self.is_full() || self.0.contains(&fault) => {}
            fault => self.0.push(fault),
        }
    }

    /// Returns the value, or adds its fault and returns `None`.
    pub fn take<T>(&mut self, found: Result<T, Invalid>) -> Option<T> {
        found.map_err(|fault| self.add(fault)).ok()
    }

    /// Returns true if the limit on collected faults is reached.
    pub fn is_full(&self) -> bool {
        self.0.len() >= crate::base::limits::MAX_FAULTS_SOUGHT
    }

    /// Returns true if there is no fault.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Ends the collection. Faults are ordered by line; those without a line come last.
    ///
    /// # Errors
    /// If there is at least one fault.
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
        if self.0.is_empty() {
            f.write_str("there is none, so leave this key out")
        } else {
            write!(f, "known are {}", self.0.join(", "))
        }
    }
}

/// Returns the known name that a misspelt name most likely stands for: at most 2 edits away, 1 for names of less than 4
/// letters.
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

/// Refuses a whole number outside `min..=max`. The number is not converted to a float, which would round large numbers.
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

/// Refuses texts that can't be names in messages, tables and file names.
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
