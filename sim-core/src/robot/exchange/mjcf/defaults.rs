//! What an attribute is where an element does not give it: `<default>` classes.

use crate::error::Invalid;
use crate::robot::exchange::source::{children, foreign, tag};
use roxmltree::Node;
use std::collections::BTreeMap;

/// The class that elements without one belong to.
pub(super) const MAIN: &str = "main";

/// Classes by name: the class around each, and its elements.
#[derive(Debug, Default)]
pub(super) struct Defaults<'a>(BTreeMap<&'a str, (Option<&'a str>, Vec<Node<'a, 'a>>)>);

impl<'a> Defaults<'a> {
    /// Takes in a `<default>` with all classes in it.
    pub fn read(&mut self, default: Node<'a, 'a>, around: Option<&'a str>) -> Result<(), Invalid> {
        let own = children(default).filter(|c| tag(*c) != "default").collect::<Vec<_>>();
        let name = match (default.attribute("class"), around) {
            (Some(name), Some(_)) => name,
            (None, Some(_)) => return Err(foreign(default, "it needs a class")),
            // The outermost class is that of all elements, whatever it is called.
            (called, None) => {
                if let Some(other) = called.filter(|name| *name != MAIN) {
                    self.0.insert(other, (Some(MAIN), Vec::new()));
                }
                MAIN
            }
        };
        self.0.entry(name).or_insert_with(|| (around, Vec::new())).1.extend(own);
        children(default).filter(|c| tag(*c) == "default").try_for_each(|inner| self.read(inner, Some(name)))
    }

    /// An element's attribute: its own, else that of its class, else those of the classes around that.
    pub fn get(&self, element: Node<'a, 'a>, inherited: &str, attribute: &str) -> Result<Option<&'a str>, Invalid> {
        if let Some(own) = element.attribute(attribute) {
            return Ok(Some(own));
        }
        let given = element.attribute("class");
        let mut class = given.unwrap_or(inherited);
        if given.is_some() && class != MAIN && !self.0.contains_key(class) {
            return Err(foreign(element, format!("there is no default class \"{class}\"")));
        }
        while let Some((around, elements)) = self.0.get(class) {
            let found = elements.iter().rev().filter(|e| tag(**e) == tag(element)).find_map(|e| e.attribute(attribute));
            match (found, around) {
                (Some(found), _) => return Ok(Some(found)),
                (None, Some(next)) if *next != class => class = next,
                (None, _) => break,
            }
        }
        Ok(None)
    }
}
