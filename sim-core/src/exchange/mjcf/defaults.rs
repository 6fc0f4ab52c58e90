//! Default values of attributes: the `<default>` classes.

use crate::base::error::Invalid;
use crate::exchange::source::{children, foreign, foreign_attribute, tag};
use roxmltree::Node;
use std::collections::BTreeMap;

/// Class of elements without a class.
pub(super) const MAIN: &str = "main";

/// Tags of actuators. They share one set of defaults, under any of these tags.
const ACTUATORS: &[&str] = &["general", "motor", "position", "velocity", "intvelocity"];

/// Classes by name: the class around each, and its elements.
#[derive(Debug, Default)]
pub(super) struct Defaults<'a>(BTreeMap<&'a str, (Option<&'a str>, Vec<Node<'a, 'a>>)>);

impl<'a> Defaults<'a> {
    /// Reads a `<default>` with all classes in it.
    pub fn read(&mut self, default: Node<'a, 'a>, around: Option<&'a str>) -> Result<(), Invalid> {
        let own = children(default).filter(|c| tag(*c) != "default").collect::<Vec<_>>();
        let name = match (default.attribute("class"), around) {
            (Some(name), Some(_)) => name,
            (None, Some(_)) => return Err(foreign(default, "it needs the attribute class")),
            // The outermost class applies to all elements, under any name.
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

    /// Returns the class that an element names by an attribute, or else the inherited class.
    ///
    /// # Errors
    /// If the class does not exist.
    pub fn class(&self, element: Node<'a, 'a>, attribute: &str, inherited: &'a str) -> Result<&'a str, Invalid> {
        match element.attribute(attribute) {
            Some(class) if class != MAIN && !self.0.contains_key(class) => {
                Err(foreign_attribute(element, attribute, format!("there is no default class \"{class}\"")))
            }
            given => Ok(given.unwrap_or(inherited)),
        }
    }

    /// Returns an attribute of an element: its own, else that of its class, else that of the classes around it.
    pub fn get(&self, element: Node<'a, 'a>, inherited: &'a str, attribute: &str) -> Result<Option<&'a str>, Invalid> {
        Ok(self.first(element, inherited, &[attribute])?.map(|(_, value)| value))
    }

    /// Returns name and value of the one attribute that is given out of several alternatives: the element's own, else
    /// that of its class, else that of the classes around it.
    ///
    /// # Errors
    /// If one element gives two of them.
    pub fn first<'n>(
        &self,
        element: Node<'a, 'a>,
        inherited: &'a str,
        attributes: &[&'n str],
    ) -> Result<Option<(&'n str, &'a str)>, Invalid> {
        for node in self.templates(element, inherited)? {
            let mut given = attributes.iter().filter_map(|name| Some((*name, node.attribute(*name)?)));
            match (given.next(), given.next()) {
                (Some((one, _)), Some((other, _))) => {
                    let reason = format!("both {one} and {other}: only one of them is allowed");
                    return Err(foreign_attribute(node, other, reason));
                }
                (Some(first), None) => return Ok(Some(first)),
                (None, _) => {}
            }
        }
        Ok(None)
    }

    /// Returns all values of an attribute: of the element first, then of its class and the classes around it.
    pub fn all(&self, element: Node<'a, 'a>, inherited: &'a str, attribute: &str) -> Result<Vec<&'a str>, Invalid> {
        Ok(self.templates(element, inherited)?.into_iter().filter_map(|node| node.attribute(attribute)).collect())
    }

    /// Returns the element, then the defaults for its tag in its class and in the classes around it.
    fn templates(&self, element: Node<'a, 'a>, inherited: &'a str) -> Result<Vec<Node<'a, 'a>>, Invalid> {
        let mut found = vec![element];
        let mut class = self.class(element, "class", inherited)?;
        while let Some((around, elements)) = self.0.get(class) {
            found.extend(elements.iter().rev().filter(|e| same_kind(tag(**e), tag(element))));
            match around {
                Some(next) if *next != class => class = next,
                _ => break,
            }
        }
        Ok(found)
    }
}

fn same_kind(a: &str, b: &str) -> bool {
    a == b || (ACTUATORS.contains(&a) && ACTUATORS.contains(&b))
}
