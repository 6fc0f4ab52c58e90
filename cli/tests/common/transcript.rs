//! Transcripts of failing commands, for snapshots of their errors.
#![allow(dead_code)] // each test file uses only a part

use crate::common::{Seen, evogait, listing};
use std::path::Path;

/// Runs failing commands, one a line, and returns each command with its error and its exit code.
///
/// The words of a line are separated by blanks, and `''` is an empty word. Words with `=` before the command set
/// environment variables. Blank lines and indentation are ignored. No command may print a result or change the folder.
pub fn errors(folder: &Path, lines: &str) -> String {
    let lines = lines.lines().map(str::trim).filter(|line| !line.is_empty());
    lines.map(|line| error(folder, line)).collect::<Vec<_>>().join("\n")
}

fn error(folder: &Path, line: &str) -> String {
    let is_variable = |word: &&str| !word.starts_with('-') && word.contains('=');
    let words: Vec<&str> = line.split_whitespace().map(|word| if word == "''" { "" } else { word }).collect();
    let variables = words.iter().copied().take_while(is_variable).count();
    let (variables, arguments) = words.split_at(variables);
    let mut command = evogait(folder, arguments);
    command.envs(variables.iter().filter_map(|variable| variable.split_once('=')));
    let before = listing(folder);
    let Seen { code, out, err } = Seen::of(command.output().expect("the command must start"));
    assert!(code == 1 || code == 2, "{line}: exit code {code}: {out}{err}");
    assert_eq!(out, "", "{line}");
    assert_eq!(listing(folder), before, "{line}");
    let typed = [variables, &["evogait"], arguments].concat();
    let typed = typed.iter().map(|word| if word.is_empty() { "''" } else { word }).collect::<Vec<_>>().join(" ");
    format!("$ {typed}\n{}→ {code}\n", err.replace("\n\nFor more information, try '--help'.", ""))
}

/// Replaces digests, which have 12 or 64 hexadecimal digits, by DIGEST. Decimals of numbers stay.
pub fn without_digests(text: &str) -> String {
    let is_digest = |word: &str| [12, 64].contains(&word.len()) && word.bytes().all(|b| b.is_ascii_hexdigit());
    let mut result = String::new();
    for part in text.split_inclusive(|c: char| !c.is_ascii_alphanumeric()) {
        let word = part.trim_end_matches(|c: char| !c.is_ascii_alphanumeric());
        result += if is_digest(word) && !result.ends_with('.') { "DIGEST" } else { word };
        result += &part[word.len()..];
    }
    result
}

/// Cuts the lists of shipped scenarios, so that a new one does not change a snapshot.
pub fn without_shipped_names(text: &str) -> String {
    let cut = |line: &str| match line.split_once(" that ship are ") {
        Some((head, _)) => format!("{head} that ship are NAMES"),
        None => line.to_owned(),
    };
    text.lines().map(|line| cut(line) + "\n").collect()
}
