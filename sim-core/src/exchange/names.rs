//! Conversion of names: MuJoCo and ROS allow any text, and bodies without a name.

use super::source::foreign;
use super::tree::Link;
use crate::base::error::{self, Faults};
use crate::base::limits::MAX_NAME_LENGTH;
use roxmltree::Node;

/// Name of a robot if its file gives none.
const UNNAMED: &str = "robot";

/// Converted names, allowed here and unique, in the order of the links.
#[derive(Debug)]
pub(super) struct Names {
    pub robot: String,
    pub bodies: Vec<String>,
    /// Name of the hinge that carries each link, if there is one.
    pub hinges: Vec<Option<String>>,
    /// Note that lists the names that were changed.
    pub note: Option<String>,
}

/// Converts the names of a file. Refuses names that it gives twice.
pub(super) fn adopt(robot: Option<&str>, links: &[Link], faults: &mut Faults) -> Names {
    let mut changed = Vec::new();
    let robot = match robot.filter(|name| !name.is_empty()) {
        None => UNNAMED.to_owned(),
        Some(name) => one(name, UNNAMED, &[], &mut changed),
    };
    let bodies: Vec<Given> = links
        .iter()
        .enumerate()
        .map(|(i, link)| Given { element: link.element, name: link.name.as_deref(), instead: format!("body{i}") })
        .collect();
    let bodies = unique(&bodies, faults, &mut changed);
    let hinged: Vec<usize> = (0..links.len()).filter(|i| links[*i].hinge.is_some()).collect();
    let hinges: Vec<Given> = hinged
        .iter()
        .filter_map(|&i| {
            let hinge = links[i].hinge.as_ref()?;
            Some(Given { element: hinge.element, name: hinge.name.as_deref(), instead: bodies[i].clone() })
        })
        .collect();
    let mut of_hinges = vec![None; links.len()];
    for (i, name) in hinged.into_iter().zip(unique(&hinges, faults, &mut changed)) {
        of_hinges[i] = Some(name);
    }
    let note = (!changed.is_empty())
        .then(|| format!("changed names (allowed are letters, digits, '-', '_' and '.'): {}", changed.join(", ")));
    Names { robot, bodies, hinges: of_hinges, note }
}

struct Given<'a> {
    element: Node<'a, 'a>,
    name: Option<&'a str>,
    /// Name if the file gives none.
    instead: String,
}

fn unique(given: &[Given], faults: &mut Faults, changed: &mut Vec<String>) -> Vec<String> {
    for (i, second) in given.iter().enumerate() {
        let Some(first) = given[..i].iter().find(|first| second.name.is_some() && first.name == second.name) else {
            continue;
        };
        let line = first.element.document().text_pos_at(first.element.range().start).row;
        let name = second.name.unwrap_or_default();
        faults.add(foreign(
            second.element,
            format!("the name \"{name}\" is used twice, first in line {line}: names must be unique"),
        ));
    }
    let allowed = |name: Option<&str>| name.filter(|name| error::name("", name).is_ok()).map(str::to_owned);
    let mut names: Vec<String> = given.iter().filter_map(|g| allowed(g.name)).collect();
    let found = given.iter().map(|g| match allowed(g.name) {
        Some(name) => name,
        None => {
            let name = match g.name {
                Some(name) => one(name, &g.instead, &names, changed),
                None => free(&g.instead, &names),
            };
            names.push(name.clone());
            name
        }
    });
    found.collect()
}

/// Converts a name to one that is allowed and free.
fn one(name: &str, instead: &str, taken: &[String], changed: &mut Vec<String>) -> String {
    if error::name("", name).is_ok() {
        return name.to_owned();
    }
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '_' };
    let text: String = name.chars().map(plain).collect();
    let text = text.trim_start_matches(|c: char| !c.is_ascii_alphanumeric());
    let name_here = free(if text.is_empty() { instead } else { text }, taken);
    changed.push(format!("\"{}\" is {name_here}", name.chars().take(MAX_NAME_LENGTH).collect::<String>()));
    name_here
}

/// Returns the name, or the first of `name-2`, `name-3` … that is free.
fn free(name: &str, taken: &[String]) -> String {
    let short = |most: usize| &name[..name.len().min(most)];
    let numbered = (2u32..).map(|n| {
        let end = format!("-{n}");
        format!("{}{end}", short(MAX_NAME_LENGTH - end.len()))
    });
    let mut all = std::iter::once(short(MAX_NAME_LENGTH).to_owned()).chain(numbered);
    all.find(|name| !taken.contains(name)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_names_become_allowed_and_stay_unique() {
        let mut changed = Vec::new();
        let taken = ["leg_a".to_owned(), "leg_a-2".to_owned()];
        for (name, here) in [("leg/a", "leg_a-3"), ("_x", "x"), ("旋转1", "1"), ("旋转", "body7"), ("fine", "fine")]
        {
            assert_eq!(one(name, "body7", &taken, &mut changed), here);
        }
        let long = "y".repeat(80);
        assert_eq!(free(&long, &[]).len(), MAX_NAME_LENGTH);
        assert_eq!(free(&long, &[free(&long, &[])]).len(), MAX_NAME_LENGTH);
        assert_eq!(changed.len(), 4);
    }
}
