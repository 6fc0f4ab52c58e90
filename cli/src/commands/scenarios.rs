//! `evogait scenarios`: what ships.

use crate::console::{self, table};
use crate::error::Error;
use serde::Serialize;
use sim_core::catalogue::{self, Entry};

#[derive(Serialize)]
struct View {
    kind: &'static str,
    name: &'static str,
    description: String,
}

fn all() -> Vec<(&'static str, &'static Entry)> {
    let of = |kind, entries: &'static [Entry]| entries.iter().map(move |entry| (kind, entry));
    of("robots", catalogue::robots())
        .chain(of("environments", catalogue::environments()))
        .chain(of("jobs", catalogue::jobs()))
        .collect()
}

/// Lists, or prints one.
pub fn run(show: Option<String>, json: bool) -> Result<(), Error> {
    if let Some(name) = show {
        return one(&name);
    }
    let views: Vec<View> =
        all().into_iter().map(|(kind, e)| View { kind, name: e.name, description: description(e.toml) }).collect();
    if json {
        return console::say_json(&views);
    }
    let mut text = String::new();
    for kind in ["robots", "environments", "jobs"] {
        let rows: Vec<Vec<String>> = views
            .iter()
            .filter(|view| view.kind == kind)
            .map(|view| vec![view.name.to_owned(), first_sentence(&view.description)])
            .collect();
        text += &format!("{}\n\n", table(&[kind, ""], &rows));
    }
    text += "evogait scenarios show NAME prints one; evogait run JOB and evogait robot ROBOT take the names";
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
            let message = format!("\"{name}\" is the name of several: say {}", names.join(" or "));
            Err(Error::Usage { message })
        }
    }
}

/// The description in a scenario's file; what ships is TOML with one, so nothing is a fine answer otherwise.
fn description(text: &str) -> String {
    let table: toml::Table = text.parse().unwrap_or_default();
    table.get("description").and_then(|d| d.as_str()).unwrap_or_default().trim().to_owned()
}

fn first_sentence(text: &str) -> String {
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    line.find(". ").map_or(line.clone(), |end| line[..end].to_owned()).trim_end_matches('.').to_owned()
}
