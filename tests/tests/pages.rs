//! The pages: links resolve, commands exist with their options, blocks of TOML are read as what they are.
//!
//! `tests/pages.sh` runs the blocks of commands.

use cluster_tests::sandbox::program;
use sim_core::model::environment::Environment;
use sim_core::model::{Robot, RobotSpec};
use sim_core::problem::Checked;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Fence of a block of code.
const FENCE: &str = "```";

/// A page of the project.
struct Page {
    path: PathBuf,
    text: String,
}

impl Page {
    /// Lines outside blocks of code, with their numbers from 1.
    fn prose(&self) -> Vec<(usize, &str)> {
        let mut inside = false;
        let mut lines = Vec::new();
        for (i, line) in self.text.lines().enumerate() {
            if line.trim_start().starts_with(FENCE) {
                inside = !inside;
            } else if !inside {
                lines.push((i + 1, line));
            }
        }
        lines
    }

    /// Blocks of code in a language: the line above the fence, the number of the fence's line, the code.
    fn blocks(&self, language: &str) -> Vec<(&str, usize, String)> {
        let lines: Vec<&str> = self.text.lines().collect();
        let opening = format!("{FENCE}{language}");
        let mut blocks = Vec::new();
        for (i, _) in lines.iter().enumerate().filter(|(_, line)| line.trim() == opening) {
            let code: Vec<&str> = lines[i + 1..].iter().take_while(|line| line.trim() != FENCE).copied().collect();
            blocks.push((if i == 0 { "" } else { lines[i - 1] }, i + 1, code.join("\n")));
        }
        blocks
    }

    /// Anchors of headings, as GitHub makes them.
    fn anchors(&self) -> BTreeSet<String> {
        let headings = self.prose().into_iter().filter(|(_, line)| line.starts_with('#'));
        let text = headings.map(|(_, line)| line.trim_start_matches('#').trim().to_lowercase());
        let keep = |c: &char| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_');
        text.map(|text| text.chars().filter(keep).map(|c| if c == ' ' { '-' } else { c }).collect()).collect()
    }

    fn at(&self, line: usize) -> String {
        format!("{}:{line}", self.path.display())
    }
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().unwrap()
}

/// All pages, by path from the root.
fn pages() -> BTreeMap<PathBuf, Page> {
    let root = root();
    let mut pages = BTreeMap::new();
    for folder in ["", "docs", "deploy", "tests/peers"] {
        for entry in std::fs::read_dir(root.join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|extension| extension == "md") {
                let text = std::fs::read_to_string(&path).unwrap();
                let path = path.strip_prefix(&root).unwrap().to_owned();
                pages.insert(path.clone(), Page { path, text });
            }
        }
    }
    assert!(pages.len() > 15, "{} pages", pages.len());
    pages
}

/// Targets of the links and pictures of a line.
fn links(line: &str) -> Vec<&str> {
    line.split("](").skip(1).filter_map(|rest| rest.split(')').next()).collect()
}

#[test]
fn links_of_pages_resolve() {
    let (root, pages) = (root(), pages());
    let mut tried = 0;
    for page in pages.values() {
        for (line, text) in page.prose() {
            for link in links(text).into_iter().filter(|link| !link.starts_with("https://")) {
                tried += 1;
                let (file, anchor) = link.split_once('#').map_or((link, None), |(file, anchor)| (file, Some(anchor)));
                let folder = page.path.parent().unwrap();
                let path = if file.is_empty() { root.join(&page.path) } else { root.join(folder).join(file) };
                let path = path.canonicalize().unwrap_or_else(|_| panic!("{}: {link} is not there", page.at(line)));
                let Some(anchor) = anchor else { continue };
                let target = &pages[path.strip_prefix(&root).unwrap()];
                assert!(target.anchors().contains(anchor), "{}: no heading gives #{anchor}", page.at(line));
            }
        }
    }
    assert!(tried > 80, "{tried} links");
}

/// The words of a command that begins with one of our programs, if a line has one: program, then arguments.
fn command(line: &str) -> Option<Vec<&str>> {
    let line = line.split(" #").next().unwrap();
    let words: Vec<&str> = line.split_whitespace().collect();
    let name = |word: &str| matches!(word.rsplit('/').next(), Some("evogait" | "coordinator" | "worker"));
    let first = words.iter().position(|word| !word.contains('=') || word.starts_with('-'))?;
    name(words[first]).then(|| words[first..].to_vec())
}

/// The help of a program's command, or `None` if there is no such command.
fn help(of: &[&str]) -> Option<String> {
    let output = program(of[0]).args(&of[1..]).arg("--help").output().unwrap();
    output.status.success().then(|| String::from_utf8(output.stdout).unwrap())
}

#[test]
fn commands_of_pages_exist_with_their_options() {
    let mut helps: BTreeMap<Vec<String>, Option<String>> = BTreeMap::new();
    let mut tried = 0;
    for page in pages().values() {
        let blocks = page.blocks("sh");
        let code = blocks.iter().flat_map(|(_, line, code)| {
            let joined = code.replace("\\\n", " ");
            joined.lines().map(|text| (*line, text.to_owned())).collect::<Vec<_>>()
        });
        // Inline code that begins with a program's name.
        let inline = page.prose().into_iter().flat_map(|(line, text)| {
            text.split('`').skip(1).step_by(2).map(move |code| (line, code.to_owned())).collect::<Vec<_>>()
        });
        for (line, text) in code.chain(inline) {
            let Some(words) = command(&text) else { continue };
            let program = words[0].rsplit('/').next().unwrap();
            let plain = |word: &&&str| word.chars().all(|c| c.is_ascii_lowercase());
            // `evogait`'s commands have at most two words.
            let depth = if program == "evogait" { words[1..].iter().take(2).take_while(plain).count() } else { 0 };
            let Some((named, help)) = (0..=depth).rev().find_map(|depth| {
                let of: Vec<String> =
                    [program].into_iter().chain(words[1..=depth].iter().copied()).map(str::to_owned).collect();
                let text =
                    helps.entry(of.clone()).or_insert_with(|| help(&of.iter().map(String::as_str).collect::<Vec<_>>()));
                text.clone().map(|text| (of, text))
            }) else {
                panic!("{}: {text}: {program} has no help", page.at(line));
            };
            let known: BTreeSet<&str> = help
                .split(|c: char| !(c.is_ascii_alphanumeric() || c == '-'))
                .filter(|word| word.starts_with('-'))
                .collect();
            if depth > 0 {
                assert!(named.len() > 1, "{}: {text}: no command {}", page.at(line), words[1]);
            }
            // Arguments after a lone `--` are for another program.
            for word in words.iter().take_while(|word| **word != "--").filter(|word| word.starts_with("--")) {
                let option = word.split('=').next().unwrap().trim_end_matches([',', '.', ';', ')', ']']);
                assert!(known.contains(option), "{}: {text}: {} has no {option}", page.at(line), named.join(" "));
                tried += 1;
            }
        }
    }
    assert!(tried > 60, "{tried} options");
}

#[test]
fn blocks_of_toml_are_read_as_marked() {
    let mut tried = 0;
    for page in pages().values().filter(|page| page.path != Path::new("docs/formats.md")) {
        for (mark, line, code) in page.blocks("toml") {
            let at = page.at(line);
            match mark {
                "<!-- job -->" => drop(Checked::from_toml(&code).unwrap_or_else(|e| panic!("{at}: {e}"))),
                "<!-- robot -->" => {
                    let spec: RobotSpec = toml::from_str(&code).unwrap_or_else(|e| panic!("{at}: {e}"));
                    drop(Robot::compile(&spec).unwrap_or_else(|e| panic!("{at}: {e}")));
                }
                "<!-- environment -->" => drop(Environment::from_toml(&code).unwrap_or_else(|e| panic!("{at}: {e}"))),
                "<!-- fragment -->" => drop(code.parse::<toml::Table>().unwrap_or_else(|e| panic!("{at}: {e}"))),
                mark => panic!("{at}: {mark:?} is no mark of a block: job, robot, environment or fragment"),
            }
            tried += 1;
        }
    }
    assert!(tried >= 3, "{tried} blocks");
}
