//! Catalogue of the robots, environments and jobs that ship, by name. It is compiled into the program.

/// File of the catalogue.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Name that jobs and commands use.
    pub name: &'static str,
    /// Text of the file.
    pub toml: &'static str,
}

macro_rules! entries {
    ($folder:literal: $($name:literal),* $(,)?) => {
        &[$(Entry { name: $name, toml: include_str!(concat!("../../../scenarios/", $folder, "/", $name, ".toml")) }),*]
    };
}

/// Returns the robots that ship.
pub fn robots() -> &'static [Entry] {
    entries!("robots": "quadropod", "lizard", "l-shape", "h-shape", "t-shape", "mtran-three", "mtran-random")
}

/// Returns the environments that ship.
pub fn environments() -> &'static [Entry] {
    entries!("environments":
        "empty", "column", "empty-goal", "column-goal", "reuse-1", "reuse-2", "reuse-3", "stairs", "plain")
}

/// Returns the jobs that ship.
pub fn jobs() -> &'static [Entry] {
    entries!("jobs":
        "quadropod-quick", "quadropod-empty", "quadropod-empty-paper", "lizard-column", "lizard-stairs", "quadropod-goal",
        "quadropod-plan", "quadropod-friction", "mtran-three-x", "mtran-three-y", "mtran-random-total", "mtran-quick")
}

/// Returns the entry called `name`.
pub fn find(entries: &'static [Entry], name: &str) -> Option<&'static Entry> {
    entries.iter().find(|e| e.name == name)
}
