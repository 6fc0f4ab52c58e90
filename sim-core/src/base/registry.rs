//! Registries: the components of each kind, by name.
//!
//! Each kind of component has one registry beside its trait. A component that ships is one line in it. A program built
//! on evogait may add its own components before it reads jobs that use them. On a cluster, every coordinator and worker
//! must then be such a program.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;
use std::sync::{PoisonError, RwLock};

/// Name and revision of a component.
pub trait Component: Sync + 'static {
    /// Returns the name in job or robot files: lower case, words joined by `-`.
    fn name(&self) -> &'static str;

    /// Returns the revision, which is raised by hand when the component computes something else than before. A revision
    /// above 1 is part of the identity of the jobs that use the component.
    fn revision(&self) -> u32 {
        1
    }
}

/// A kind of component that has a registry.
pub trait Registered: Component {
    /// Returns the registry of this kind of component.
    fn registry() -> &'static Registry<Self>;
}

/// All components of one kind.
pub struct Registry<T: ?Sized + 'static> {
    shipped: &'static [&'static T],
    added: RwLock<Vec<&'static T>>,
}

/// Error for a new component with a name that is taken; holds the name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the component name \"{0}\" is taken: give the new component another name")]
pub struct NameTaken(pub &'static str);

impl<T: Component + ?Sized> Registry<T> {
    /// Creates a registry of the components that ship, at least one. Messages list them in this order.
    pub const fn new(shipped: &'static [&'static T]) -> Self {
        Self { shipped, added: RwLock::new(Vec::new()) }
    }

    /// Returns the first component that ships, which is the default for a file without a name.
    pub fn default(&self) -> &'static T {
        self.shipped[0]
    }

    /// Adds a component for the rest of the process.
    pub fn add(&self, component: &'static T) -> Result<(), NameTaken> {
        let mut added = self.added.write().unwrap_or_else(PoisonError::into_inner);
        let taken = self.shipped.iter().chain(added.iter()).any(|known| known.name() == component.name());
        if taken {
            return Err(NameTaken(component.name()));
        }
        added.push(component);
        Ok(())
    }

    /// Returns the component with this name.
    pub fn find(&self, name: &str) -> Option<&'static T> {
        self.all().into_iter().find(|component| component.name() == name)
    }

    /// Returns all components: those that ship, then those that were added.
    pub fn all(&self) -> Vec<&'static T> {
        let added = self.added.read().unwrap_or_else(PoisonError::into_inner);
        self.shipped.iter().chain(added.iter()).copied().collect()
    }

    /// Returns the names of all components, in the same order.
    pub fn names(&self) -> Vec<&'static str> {
        self.all().into_iter().map(|component| component.name()).collect()
    }
}

/// Component chosen by a file. It is written and read as its name.
pub struct Chosen<T: ?Sized + 'static>(pub &'static T);

impl<T: ?Sized> Clone for Chosen<T> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<T: ?Sized> Copy for Chosen<T> {}

impl<T: Component + ?Sized> PartialEq for Chosen<T> {
    fn eq(&self, other: &Self) -> bool {
        self.0.name() == other.0.name()
    }
}

impl<T: Component + ?Sized> fmt::Debug for Chosen<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0.name())
    }
}

impl<T: Registered + ?Sized> Default for Chosen<T> {
    fn default() -> Self {
        Self(T::registry().default())
    }
}

impl<T: Component + ?Sized> Serialize for Chosen<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.0.name())
    }
}

impl<'de, T: Registered + ?Sized> Deserialize<'de> for Chosen<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        let registry = T::registry();
        registry.find(&name).map(Self).ok_or_else(|| {
            // Same wording as serde's own error, which needs the list of names at compile time.
            serde::de::Error::custom(format!("unknown variant `{name}`, {}", expected(&registry.names())))
        })
    }
}

/// Returns the names that a parser expects, in serde's wording: "expected one of `a`, `b`, `c`".
pub(super) fn expected(known: &[&str]) -> String {
    let quoted: Vec<String> = known.iter().map(|name| format!("`{name}`")).collect();
    match quoted.as_slice() {
        [one] => format!("expected {one}"),
        [one, other] => format!("expected {one} or {other}"),
        _ => format!("expected one of {}", quoted.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Named(&'static str);

    impl Component for Named {
        fn name(&self) -> &'static str {
            self.0
        }
    }

    impl Registered for Named {
        fn registry() -> &'static Registry<Self> {
            static ALL: Registry<Named> = Registry::new(&[&Named("first"), &Named("second")]);
            &ALL
        }
    }

    #[test]
    fn added_component_is_found_and_duplicate_name_refused() {
        let registry = Registry::new(&[&Named("first"), &Named("second")]);
        assert!(registry.find("third").is_none());
        registry.add(&Named("third")).unwrap();
        assert_eq!(registry.names(), ["first", "second", "third"]);
        assert_eq!(registry.find("third").map(|c| c.name()), Some("third"));
        for taken in [&Named("first"), &Named("third")] {
            assert_eq!(registry.add(taken), Err(NameTaken(taken.0)));
        }
        assert_eq!(registry.names().len(), 3);
    }

    #[test]
    fn unknown_name_is_refused_with_the_known_names() {
        #[derive(Serialize, Deserialize)]
        struct File {
            #[serde(default)]
            kind: Chosen<Named>,
        }
        assert_eq!(toml::from_str::<File>("").unwrap().kind.0.name(), "first");
        let file: File = toml::from_str("kind = \"second\"").unwrap();
        assert_eq!(toml::to_string(&file).unwrap(), "kind = \"second\"\n");
        let Err(refused) = toml::from_str::<File>("\nkind = \"thrid\"") else {
            panic!("the unknown name was accepted")
        };
        let refused = refused.to_string();
        assert!(refused.contains("line 2"), "{refused}");
        assert!(refused.contains("unknown variant `thrid`, expected `first` or `second`"), "{refused}");
    }
}
