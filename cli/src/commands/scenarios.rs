//! `evogait scenarios`: robots, environments and jobs that ship with the program.

use crate::console::{self, table};
use crate::error::Error;
use serde::Serialize;
use sim_core::base::registry::Registered as _;
use sim_core::model::catalogue::{self, Entry};
use sim_core::model::{Robot, RobotSpec};
use sim_core::procedure::ProcedureKind;

#[derive(Serialize)]
struct View {
    kind: &'static str,
    name: &'static str,
    /// Procedure of a job; `None` for robots and environments.
    #[serde(skip_serializing_if = "Option::is_none")]
    procedure: Option<String>,
    description: String,
    #[serde(skip)]
    toml: &'static str,
}

fn all() -> Vec<(&'static str, &'static Entry)> {
    let of = |kind, entries: &'static [Entry]| entries.iter().map(move |entry| (kind, entry));
    of("robots", catalogue::robots())
        .chain(of("environments", catalogue::environments()))
        .chain(of("jobs", catalogue::jobs()))
        .collect()
}

/// Prints the list of scenarios, or the file of one.
pub fn run(show: Option<String>, json: bool) -> Result<(), Error> {
    if let Some(name) = show {
        return one(&name);
    }
    let view = |(kind, e): (_, &Entry)| View {
        kind,
        name: e.name,
        procedure: (kind == "jobs").then(|| procedure(e.toml)),
        description: description(e.toml),
        toml: e.toml,
    };
    let views: Vec<View> = all().into_iter().map(view).collect();
    if json {
        return console::say_json(&views);
    }
    let mut text = String::new();
    let procedures = <dyn ProcedureKind>::registry().names();
    let of_jobs = procedures.iter().map(|procedure| ("jobs", Some(*procedure), format!("jobs that {procedure}")));
    let groups = [("robots", None, "robots".to_owned()), ("environments", None, "environments".to_owned())];
    for (kind, procedure, title) in groups.into_iter().chain(of_jobs) {
        let rows: Vec<Vec<String>> = views
            .iter()
            .filter(|view| view.kind == kind && view.procedure.as_deref() == procedure)
            .map(|view| {
                let facts = if kind == "robots" { robot_facts(view.toml).unwrap_or_default() } else { String::new() };
                vec![view.name.to_owned(), facts + &first_sentence(&view.description)]
            })
            .collect();
        if !rows.is_empty() {
            text += &format!("{}\n\n", table(&[&title, ""], &rows));
        }
    }
    text += "`evogait scenarios show NAME` prints one; `evogait run JOB` and `evogait robot ROBOT` accept the names";
    console::say(&text)
}

fn one(name: &str) -> Result<(), Error> {
    let found: Vec<_> =
        all().into_iter().filter(|(kind, e)| e.name == name || format!("{kind}/{}", e.name) == name).collect();
    match found.as_slice() {
        [(_, entry)] => console::say(entry.toml),
        [] => Err(Error::NotFound {
            what: "scenario",
            name: name.to_owned(),
            known: all().iter().map(|(_, e)| e.name).collect::<Vec<_>>().join(", "),
        }),
        several => {
            let names: Vec<String> = several.iter().map(|(kind, e)| format!("{kind}/{}", e.name)).collect();
            let message = format!("\"{name}\" is the name of several scenarios: use {}", names.join(" or "));
            Err(Error::Usage { message })
        }
    }
}

/// Returns the procedure in a job's file.
fn procedure(text: &str) -> String {
    let table: toml::Table = text.parse().unwrap_or_default();
    let named = table.get("procedure").and_then(|procedure| procedure.as_str());
    named.unwrap_or(<dyn ProcedureKind>::registry().default().name()).to_owned()
}

/// Returns the description in a scenario's file, or an empty text. All scenarios that ship have one.
fn description(text: &str) -> String {
    let table: toml::Table = text.parse().unwrap_or_default();
    table.get("description").and_then(|d| d.as_str()).unwrap_or_default().trim().to_owned()
}

/// Returns the text before the first full stop that a capital letter follows, so that "Fig. 3" does not end a sentence.
fn first_sentence(text: &str) -> String {
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let begins_with_capital = |rest: &str| rest.chars().next().is_some_and(char::is_uppercase);
    let end = line.match_indices(". ").map(|(at, _)| at).find(|at| begins_with_capital(&line[at + 2..]));
    end.map_or(line.as_str(), |at| &line[..at]).trim_end_matches('.').to_owned()
}

/// Returns the numbers of modules and joints of a robot as a sentence.
fn robot_facts(toml: &str) -> Option<String> {
    let spec: RobotSpec = toml::from_str(toml).ok()?;
    let robot = Robot::compile(&spec).ok()?;
    Some(format!("{} modules, {} joints. ", spec.modules.len(), robot.hinges.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_sentence_ends_at_full_stop_before_capital() {
        assert_eq!(first_sentence("Robot of\nA (2016), Fig. 3. The figure is lost."), "Robot of A (2016), Fig. 3");
        assert_eq!(first_sentence("Only one."), "Only one");
        assert_eq!(first_sentence(""), "");
    }
}
