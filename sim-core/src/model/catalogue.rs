//! The catalogue: robots, environments and jobs that ship, by name, compiled into the program.

/// A file of the catalogue.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// The name that jobs and commands use.
    pub name: &'static str,
    /// Its text.
    pub toml: &'static str,
}

macro_rules! entries {
    ($folder:literal: $($name:literal),* $(,)?) => {
        &[$(Entry { name: $name, toml: include_str!(concat!("../../../scenarios/", $folder, "/", $name, ".toml")) }),*]
    };
}

/// The robots that ship.
pub fn robots() -> &'static [Entry] {
    entries!("robots": "quadropod", "lizard", "l-shape", "h-shape", "t-shape")
}

/// The environments that ship.
pub fn environments() -> &'static [Entry] {
    entries!("environments":
        "empty", "column", "empty-goal", "column-goal", "reuse-1", "reuse-2", "reuse-3", "stairs")
}

/// The jobs that ship.
pub fn jobs() -> &'static [Entry] {
    entries!("jobs":
        "quadropod-quick", "quadropod-empty", "quadropod-empty-paper", "lizard-column", "lizard-stairs", "quadropod-goal",
        "quadropod-plan", "quadropod-friction")
}

/// The entry called `name`.
pub fn find(entries: &'static [Entry], name: &str) -> Option<&'static Entry> {
    entries.iter().find(|e| e.name == name)
}
