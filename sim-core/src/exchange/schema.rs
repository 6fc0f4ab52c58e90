//! Rules for the elements and attributes of a format: each is read, ignored or refused. All others are refused as
//! unknown.

use super::source::{XACRO, foreign, foreign_attribute, has_expression, tag};
use crate::base::error::{Faults, nearest};
use roxmltree::Node;
use std::collections::{BTreeMap, BTreeSet};

/// Rule for an element of a format.
pub(super) struct Rule {
    /// Tag of the element.
    pub tag: &'static str,
    /// Attributes that are read, including those that must have their neutral value.
    pub read: &'static [&'static str],
    /// Attributes that are ignored: appearance, or values that come from a job.
    pub passed: &'static [&'static str],
    /// Attributes that can't be imported.
    pub refused: &'static [&'static str],
    /// Content of the element.
    pub children: &'static [Child],
}

/// Rule for the content of an element.
pub(super) enum Child {
    /// At most one such element.
    Once(&'static Rule),
    /// Any number of such elements.
    Many(&'static Rule),
    /// Defaults for such elements: the same without name and class.
    Template(&'static Rule),
    /// Element that is ignored with all its content.
    Passed(&'static str),
    /// Element that can't be imported: tag and reason.
    Refused(&'static str, &'static str),
    /// Element that can't be imported unless it is empty: tag and reason.
    Empty(&'static str, &'static str),
}

impl Child {
    fn tag(&self) -> &'static str {
        match self {
            Self::Once(rule) | Self::Many(rule) | Self::Template(rule) => rule.tag,
            Self::Passed(tag) | Self::Refused(tag, _) | Self::Empty(tag, _) => tag,
        }
    }
}

/// Record of all ignored content: whole elements, and attributes by element.
#[derive(Debug, Default)]
pub(super) struct Passed {
    elements: BTreeSet<&'static str>,
    attributes: BTreeMap<&'static str, BTreeSet<&'static str>>,
}

impl Passed {
    /// Returns one sentence for the user; `None` if nothing was ignored.
    pub fn note(&self) -> Option<String> {
        let elements = self.elements.iter().map(|tag| format!("<{tag}>"));
        let attributes = self.attributes.iter().map(|(tag, names)| {
            let names: Vec<&str> = names.iter().copied().collect();
            format!("{tag} {}", names.join(" "))
        });
        let all: Vec<String> = elements.chain(attributes).collect();
        (!all.is_empty()).then(|| format!("ignored (appearance, or set by a job's [physics]): {}", all.join(", ")))
    }
}

/// Checks an element and all its content against its rule.
pub(super) fn check(element: Node, rule: &'static Rule, faults: &mut Faults, passed: &mut Passed) {
    check_as(element, rule, false, faults, passed);
}

fn check_as(element: Node, rule: &'static Rule, template: bool, faults: &mut Faults, passed: &mut Passed) {
    attributes(element, rule, template, faults, passed);
    if let Some(text) =
        element.children().filter(|c| c.is_text()).find_map(|c| c.text().filter(|t| !t.trim().is_empty()))
    {
        let text: String = text.trim().chars().take(40).collect();
        faults.add(foreign(element, format!("the text \"{text}\" in it is not allowed: write values as attributes")));
    }
    let mut seen = BTreeSet::new();
    for inner in element.children().filter(Node::is_element) {
        if faults.is_full() {
            return;
        }
        if inner.tag_name().namespace().is_some_and(|space| space.contains("xacro")) {
            faults.add(foreign(inner, XACRO));
            continue;
        }
        let Some(child) = rule.children.iter().find(|child| child.tag() == tag(inner)) else {
            faults.add(unknown_element(inner, rule));
            continue;
        };
        match child {
            Child::Many(rule) => check_as(inner, rule, false, faults, passed),
            Child::Template(rule) => check_as(inner, rule, true, faults, passed),
            Child::Once(rule) => {
                if !seen.insert(rule.tag) {
                    faults.add(foreign(
                        inner,
                        format!("a second <{}> in <{}>: only one is allowed", rule.tag, tag(element)),
                    ));
                }
                check_as(inner, rule, false, faults, passed);
            }
            Child::Passed(tag) => {
                passed.elements.insert(tag);
            }
            Child::Refused(_, why) => faults.add(foreign(inner, *why)),
            Child::Empty(_, why) => {
                if let Some(first) = inner.children().find(Node::is_element) {
                    faults.add(foreign(first, *why));
                }
            }
        }
    }
}

fn attributes(element: Node, rule: &'static Rule, template: bool, faults: &mut Faults, passed: &mut Passed) {
    for attribute in element.attributes() {
        let name = attribute.name();
        let named = |names: &'static [&'static str]| names.iter().find(|known| **known == name);
        let belongs = !(template && ["name", "class"].contains(&name));
        if has_expression(attribute.value()) {
            faults.add(foreign_attribute(element, name, XACRO));
        } else if attribute.namespace().is_some() || (belongs && named(rule.read).is_some()) {
            // Attributes of other namespaces belong to other programs.
        } else if let Some(known) = named(rule.passed) {
            passed.attributes.entry(rule.tag).or_default().insert(known);
        } else if named(rule.refused).is_some() {
            faults.add(foreign_attribute(element, name, format!("{name} can't be imported: remove it")));
        } else {
            let all = rule.read.iter().chain(rule.passed).copied();
            let all: Vec<&str> = all.filter(|name| !(template && ["name", "class"].contains(name))).collect();
            let reason = match nearest(name, &all) {
                Some(meant) => format!("{name} is no attribute of <{}>: {meant} may be meant", rule.tag),
                None if all.is_empty() => format!("{name}: <{}> has no attributes", rule.tag),
                None => format!("{name} is no attribute of <{}>: allowed are {}", rule.tag, all.join(", ")),
            };
            faults.add(foreign_attribute(element, name, reason));
        }
    }
}

fn unknown_element(element: Node, rule: &Rule) -> crate::base::error::Invalid {
    let allowed = rule.children.iter().filter(|c| !matches!(c, Child::Refused(..) | Child::Empty(..)));
    let allowed: Vec<&str> = allowed.map(Child::tag).collect();
    let reason = match nearest(tag(element), &allowed) {
        Some(meant) => format!("there is no such element in <{}>: <{meant}> may be meant", rule.tag),
        None if allowed.is_empty() => format!("no content is allowed in <{}>: write values as attributes", rule.tag),
        None => format!("this element can't be imported in <{}>: allowed are {}", rule.tag, allowed.join(", ")),
    };
    foreign(element, reason)
}
