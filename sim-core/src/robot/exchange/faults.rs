//! Refusals of one file, collected so that a user sees all of them at once.

use crate::error::Invalid;

/// What is wrong in a file so far.
#[derive(Debug, Default)]
pub(super) struct Faults(Vec<Invalid>);

impl Faults {
    /// Adds a refusal.
    pub fn add(&mut self, fault: Invalid) {
        match fault {
            Invalid::Several(several) => several.into_iter().for_each(|fault| self.add(fault)),
            fault if self.0.contains(&fault) => {}
            fault => self.0.push(fault),
        }
    }

    /// The value, or nothing with its refusal added.
    pub fn take<T>(&mut self, found: Result<T, Invalid>) -> Option<T> {
        found.map_err(|fault| self.add(fault)).ok()
    }

    /// Whether nothing is wrong.
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
