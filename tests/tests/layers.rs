//! Rules of dependency: which folders of sim-core, which crates and which modules may use which others.
//!
//! The test reads sources and manifests. Code under `#[cfg(test)]` may use anything.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Folders of sim-core. Each may use the ones before it.
const FOLDERS: [&str; 15] = [
    "base",
    "genotype",
    "model",
    "physics",
    "engines",
    "exchange",
    "control",
    "plan",
    "objective",
    "evaluate",
    "search",
    "problem",
    "report",
    "procedure",
    "job",
];

/// Folder and package of each crate, and the packages of this workspace that it may depend on.
const CRATES: [(&str, &str, &[&str]); 8] = [
    ("sim-core", "sim-core", &[]),
    ("study", "study", &["sim-core"]),
    ("proto", "proto", &["sim-core"]),
    ("telemetry", "telemetry", &[]),
    ("coordinator", "coordinator", &["sim-core", "proto", "telemetry"]),
    ("worker", "worker", &["sim-core", "proto", "telemetry"]),
    ("cli", "cli", &["sim-core", "study", "proto", "telemetry", "coordinator", "worker"]),
    ("tests", "cluster-tests", &["sim-core", "study", "proto", "telemetry", "coordinator", "worker", "cli"]),
];

/// Crates in which the top-level modules must not use each other in a cycle.
const WITHOUT_CIRCLES: [&str; 6] = ["proto", "study", "telemetry", "coordinator", "worker", "cli"];

/// Name that stands for a crate's root among its modules.
const ROOT: &str = "lib";

/// Use of a module by another module of the same crate.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Arrow {
    from: String,
    to: String,
    file: PathBuf,
    line: usize,
}

impl Arrow {
    fn show(&self) -> String {
        format!("{}:{}: {} -> {}", self.file.display(), self.line, self.from, self.to)
    }
}

/// Word or sign of a source, with its line number, counted from 1.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Token {
    text: String,
    line: usize,
}

/// Splits a source into words and signs. Skips comments, strings and character literals.
fn tokens(source: &str) -> Vec<Token> {
    let chars: Vec<char> = source.chars().collect();
    let at = |i: usize| chars.get(i).copied().unwrap_or('\0');
    let (mut tokens, mut line, mut i) = (Vec::new(), 1, 0);
    while i < chars.len() {
        let c = chars[i];
        let start = i;
        if c == '/' && at(i + 1) == '/' {
            while i < chars.len() && chars[i] != '\n' {
                i += 1;
            }
        } else if c == '/' && at(i + 1) == '*' {
            let mut depth = 0;
            loop {
                match (at(i), at(i + 1)) {
                    ('/', '*') => (depth, i) = (depth + 1, i + 2),
                    ('*', '/') => (depth, i) = (depth - 1, i + 2),
                    _ => i += 1,
                }
                if depth == 0 || i >= chars.len() {
                    break;
                }
            }
        } else if let Some(end) = raw_string(&chars, i) {
            i = end;
        } else if c == '"' {
            i += 1;
            while i < chars.len() && chars[i] != '"' {
                i += if chars[i] == '\\' { 2 } else { 1 };
            }
            i += 1;
        } else if c == '\'' && (at(i + 1) == '\\' || at(i + 2) == '\'') {
            // A character literal. Any other quote begins a lifetime.
            i += if at(i + 1) == '\\' { 3 } else { 2 };
            while i < chars.len() && chars[i] != '\'' {
                i += 1;
            }
            i += 1;
        } else if c.is_alphanumeric() || c == '_' {
            while at(i).is_alphanumeric() || at(i) == '_' {
                i += 1;
            }
            tokens.push(Token { text: chars[start..i].iter().collect(), line });
        } else if c == ':' && at(i + 1) == ':' {
            i += 2;
            tokens.push(Token { text: "::".into(), line });
        } else {
            i += 1;
            if !c.is_whitespace() {
                tokens.push(Token { text: c.into(), line });
            }
        }
        line += chars[start..i.min(chars.len())].iter().filter(|c| **c == '\n').count();
    }
    tokens
}

/// Returns the end of a raw string that begins at `i`, such as `r#"…"#`.
fn raw_string(chars: &[char], i: usize) -> Option<usize> {
    let at = |i: usize| chars.get(i).copied().unwrap_or('\0');
    if i > 0 && (at(i - 1).is_alphanumeric() || at(i - 1) == '_') {
        return None;
    }
    let first = if at(i) == 'b' { i + 1 } else { i };
    let hashes = (first + 1..).take_while(|&j| at(j) == '#').count();
    if at(first) != 'r' || at(first + 1 + hashes) != '"' {
        return None;
    }
    let mut end = first + 2 + hashes;
    while end < chars.len() && !(at(end) == '"' && (1..=hashes).all(|j| at(end + j) == '#')) {
        end += 1;
    }
    Some(end + 1 + hashes)
}

/// Token sequences that begin attributes of test-only items.
const FORMS: [&[&str]; 2] = [&["#", "[", "cfg", "(", "test", ")"], &["#", "[", "cfg", "(", "all", "(", "test", ","]];

/// Removes every item under `#[cfg(test)]` or `#[cfg(all(test, …))]`. Returns the rest and the names of test-only
/// modules.
fn without_tests(tokens: &[Token]) -> (Vec<Token>, Vec<String>) {
    let (mut rest, mut modules, mut i) = (Vec::new(), Vec::new(), 0);
    while i < tokens.len() {
        let starts = |with: &[&str]| {
            with.len() <= tokens.len() - i && tokens[i..].iter().zip(with).all(|(t, text)| t.text == *text)
        };
        if !FORMS.iter().any(|form| starts(form)) {
            rest.push(tokens[i].clone());
            i += 1;
            continue;
        }
        let item = i + tokens[i..].iter().take_while(|t| t.text != "]").count() + 1;
        let mut depth = 0;
        i = item;
        while i < tokens.len() {
            match tokens[i].text.as_str() {
                "{" | "(" | "[" => depth += 1,
                "}" | ")" | "]" => depth -= 1,
                _ => {}
            }
            i += 1;
            let ends = matches!(tokens[i - 1].text.as_str(), "}" | ";");
            // In `use a::{b};` the item ends at the semicolon, not at the brace.
            if depth == 0 && ends && tokens.get(i).is_none_or(|next| next.text != ";") {
                break;
            }
        }
        if let Some(at) = tokens[item..i].iter().position(|t| t.text == "mod") {
            modules.push(tokens[item + at + 1].text.clone());
        }
    }
    (rest, modules)
}

/// Finds all paths that begin with one of `roots`, with their lines. Expands the trees of `use` items.
fn paths(tokens: &[Token], roots: &BTreeSet<String>) -> Vec<(Vec<String>, usize)> {
    let mut found = Vec::new();
    for i in 0..tokens.len() {
        let continues = i > 0 && matches!(tokens[i - 1].text.as_str(), "::" | ".");
        let is_path = tokens.get(i + 1).is_some_and(|t| t.text == "::");
        let lone_in_use = i > 0 && tokens[i - 1].text == "use";
        if roots.contains(&tokens[i].text) && !continues && (is_path || lone_in_use) {
            tree(tokens, i, &[], &mut found);
        }
    }
    found
}

/// Reads a path or a tree of paths that begins at `i`. Returns its end.
fn tree(tokens: &[Token], mut i: usize, before: &[String], found: &mut Vec<(Vec<String>, usize)>) -> usize {
    let mut path = before.to_vec();
    let line = tokens[i].line;
    while let Some(token) = tokens.get(i) {
        if token.text == "{" {
            i += 1;
            while i < tokens.len() && tokens[i].text != "}" {
                i = match tokens[i].text.as_str() {
                    "," => i + 1,
                    _ => tree(tokens, i, &path, found),
                };
            }
            return i + 1;
        }
        path.push(token.text.clone());
        i += 1;
        if tokens.get(i).is_none_or(|t| t.text != "::") {
            break;
        }
        i += 1;
    }
    if tokens.get(i).is_some_and(|t| t.text == "as") {
        i += 2;
    }
    found.push((path, line));
    // Moves on past a sign that can't stand in a tree.
    i.max(1)
}

/// Sources of a crate: file and tokens without tests, by module path.
type Sources = BTreeMap<Vec<String>, (PathBuf, Vec<Token>)>;

/// Reads the sources of a crate's library from the folder `src`.
fn sources(src: &Path) -> Sources {
    let mut all: BTreeMap<Vec<String>, (PathBuf, Vec<Token>, Vec<String>)> = BTreeMap::new();
    let mut folders = vec![src.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                // Programs beside the library are crate roots of their own.
                if path != src.join("bin") {
                    folders.push(path);
                }
            } else if path.extension().is_some_and(|e| e == "rs") && path != src.join("main.rs") {
                let mut module: Vec<String> =
                    path.strip_prefix(src).unwrap().iter().map(|p| p.to_str().unwrap().to_owned()).collect();
                let name = module.pop().unwrap().trim_end_matches(".rs").to_owned();
                if !matches!(name.as_str(), "mod" | "lib") {
                    module.push(name);
                }
                let (rest, tests) = without_tests(&tokens(&std::fs::read_to_string(&path).unwrap()));
                all.insert(module, (path, rest, tests));
            }
        }
    }
    let tests: Vec<Vec<String>> = all
        .iter()
        .flat_map(|(module, (_, _, tests))| tests.iter().map(|t| [module.as_slice(), std::slice::from_ref(t)].concat()))
        .collect();
    all.retain(|module, _| !tests.iter().any(|test| module.starts_with(test)));
    all.into_iter().map(|(module, (path, rest, _))| (module, (path, rest))).collect()
}

/// Returns all uses of top-level modules by each other. [`ROOT`] stands for items that the crate's root itself defines.
/// A name that the root re-exports counts as a use of the module that defines it.
fn arrows(sources: &Sources) -> Vec<Arrow> {
    let modules: BTreeSet<String> = sources.keys().filter_map(|m| m.first().cloned()).collect();
    let roots = |module: &[String]| -> BTreeSet<String> {
        let own = ["crate", "super", "self"].map(str::to_owned);
        // Paths in the root may begin with a module's name.
        own.into_iter().chain(modules.iter().filter(|_| module.is_empty()).cloned()).collect()
    };
    let top = |path: &[String]| path.first().filter(|m| modules.contains(*m)).cloned();
    // Names that the root re-exports, with the module that defines them.
    let mut passed: BTreeMap<String, String> = BTreeMap::new();
    if let Some((_, tokens)) = sources.get(&Vec::new()) {
        for (path, _) in paths(tokens, &roots(&[])) {
            let path = absolute(&path, &[]);
            if let (Some(module), Some(name), true) = (top(&path), path.last(), path.len() > 1) {
                passed.insert(name.clone(), module);
            }
        }
    }
    let mut arrows = Vec::new();
    for (module, (file, tokens)) in sources {
        let from = module.first().cloned().unwrap_or_else(|| ROOT.to_owned());
        for (path, line) in paths(tokens, &roots(module)) {
            let path = absolute(&path, module);
            let Some(first) = path.first() else { continue };
            let to = top(&path).or_else(|| passed.get(first).cloned()).unwrap_or_else(|| ROOT.to_owned());
            if to != from {
                arrows.push(Arrow { from: from.clone(), to, file: file.clone(), line });
            }
        }
    }
    arrows
}

/// Returns a path relative to its crate's root. Empty for the root itself.
fn absolute(path: &[String], module: &[String]) -> Vec<String> {
    match path[0].as_str() {
        "crate" => path[1..].to_vec(),
        "self" => [module, &path[1..]].concat(),
        "super" => {
            let up = path.iter().take_while(|p| *p == "super").count();
            [&module[..module.len().saturating_sub(up)], &path[up..]].concat()
        }
        _ => path.to_vec(),
    }
}

/// Returns the arrows that are part of a cycle of modules.
fn circles(arrows: &[Arrow]) -> Vec<&Arrow> {
    let mut uses: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for arrow in arrows {
        uses.entry(&arrow.from).or_default().insert(&arrow.to);
    }
    let reaches = |from: &str, to: &str| {
        let (mut seen, mut todo) = (BTreeSet::new(), vec![from]);
        while let Some(module) = todo.pop() {
            if module == to {
                return true;
            }
            if seen.insert(module) {
                todo.extend(uses.get(module).into_iter().flatten());
            }
        }
        false
    };
    arrows.iter().filter(|arrow| reaches(&arrow.to, &arrow.from)).collect()
}

/// Returns the arrows from a folder to a later one, and those from or to a folder that is not in the order.
fn back<'a>(arrows: &'a [Arrow], order: &[&str]) -> Vec<&'a Arrow> {
    let place = |name: &str| order.iter().position(|o| *o == name);
    let points_back = |arrow: &&Arrow| match (place(&arrow.from), place(&arrow.to)) {
        (Some(from), Some(to)) => to > from,
        // The root only declares the folders.
        _ => arrow.from != ROOT,
    };
    arrows.iter().filter(points_back).collect()
}

fn workspace() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

/// Returns the arrows between the modules of a crate.
fn arrows_of(folder: &str) -> Vec<Arrow> {
    arrows(&sources(&workspace().join(folder).join("src")))
}

fn shown(arrows: &[&Arrow]) -> String {
    arrows.iter().map(|arrow| arrow.show()).collect::<Vec<_>>().join("\n")
}

#[test]
fn folders_of_sim_core_use_only_earlier_folders() {
    let arrows = arrows_of("sim-core");
    let back = back(&arrows, &FOLDERS);
    assert!(back.is_empty(), "a folder of sim-core may use only those before it:\n{}", shown(&back));
    for folder in FOLDERS {
        assert!(workspace().join("sim-core/src").join(folder).is_dir(), "{folder} must be a folder of sim-core");
    }
}

#[test]
fn crates_depend_only_on_allowed_crates() {
    let mut wrong = Vec::new();
    for (folder, package, may) in CRATES {
        let file = workspace().join(folder).join("Cargo.toml");
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(
            text.contains(&format!("name = \"{package}\"")),
            "{} must be the manifest of the package listed in CRATES",
            file.display()
        );
        wrong.extend(
            forbidden(&text, may)
                .into_iter()
                .map(|(line, uses)| format!("{}:{line}: {package} -> {uses}", file.display())),
        );
    }
    assert!(wrong.is_empty(), "a crate may depend only on the packages listed in CRATES:\n{}", wrong.join("\n"));
}

/// Finds dependencies on packages of the workspace that are not in `may`. Returns their lines and names.
fn forbidden(manifest: &str, may: &[&str]) -> Vec<(usize, String)> {
    let mut section = String::new();
    let mut wrong = Vec::new();
    for (line, text) in (1..).zip(manifest.lines()) {
        if let Some(header) = text.trim().strip_prefix('[') {
            section = header.trim_end_matches(']').to_owned();
        }
        let name: String = text.chars().take_while(|c| c.is_alphanumeric() || matches!(c, '-' | '_')).collect();
        let ours = CRATES.iter().any(|(_, package, _)| *package == name);
        let counts = section.ends_with("dependencies") && !section.ends_with("dev-dependencies");
        if counts && ours && !may.contains(&name.as_str()) {
            wrong.push((line, name));
        }
    }
    wrong
}

#[test]
fn modules_of_each_crate_form_no_cycle() {
    let mut found = String::new();
    for folder in WITHOUT_CIRCLES {
        let arrows = arrows_of(folder);
        let circles = circles(&arrows);
        if !circles.is_empty() {
            found += &format!("{folder}:\n{}\n", shown(&circles));
        }
    }
    assert!(found.is_empty(), "modules must not use each other in a cycle:\n{found}");
}

/// Returns the arrows of a crate as (from, to, line). The files are given as (name, text).
fn read(files: &[(&str, &str)]) -> Vec<(String, String, usize)> {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    arrows(&sources(folder.path())).into_iter().map(|a| (a.from, a.to, a.line)).collect()
}

fn arrow(from: &str, to: &str, line: usize) -> (String, String, usize) {
    (from.to_owned(), to.to_owned(), line)
}

#[test]
fn reader_expands_use_trees_and_relative_paths() {
    let found = read(&[
        ("lib.rs", "mod a;\nmod b;\nmod c;\n"),
        ("a/mod.rs", "mod deep;\nuse crate::{b::X,\n    c::{self, Y as Z}};\n"),
        ("a/deep.rs", "use super::super::c::Y;\nfn f() { let x = crate::b::make::<u8>(); self::g(x) }\n"),
        ("b.rs", "use super::c;\n"),
        ("c.rs", "use std::fmt;\nfn crate_b(b: B) { b.crate_c() }\n"),
    ]);
    let expected = [
        arrow("a", "b", 2),
        arrow("a", "c", 3),
        arrow("a", "c", 3),
        arrow("a", "c", 1),
        arrow("a", "b", 2),
        arrow("b", "c", 1),
    ];
    assert_eq!(found, expected);
}

#[test]
fn reader_skips_tests_comments_and_strings() {
    let found = read(&[
        ("lib.rs", "mod a;\nmod b;\n"),
        (
            "a.rs",
            "// use crate::b;\n/* crate::b /* crate::b */ crate::b */\nconst S: &str = \"crate::b \\\" crate::b\";\n\
             const R: &str = r#\"\" crate::b \"#;\nconst C: char = '\"';\nfn f<'a>(x: &'a str) {}\n\
             #[cfg(test)]\nuse crate::b::{X};\n#[cfg(test)]\nmod tests { use crate::b; fn g() { crate::b::h() } }\n\
             #[cfg(test)]\nmod more;\n\
             #[cfg(all(test, unix))]\nmod there { use crate::b; }\n",
        ),
        ("a/more.rs", "use crate::b;\n"),
        ("a/more/still.rs", "use crate::b;\n"),
        ("b.rs", "#[cfg(test)]\nfn f() { crate::a::g() }\nuse crate::a;\n"),
    ]);
    assert_eq!(found, [arrow("b", "a", 3)]);
}

#[test]
fn reexported_names_count_as_their_module() {
    let found = read(&[
        ("lib.rs", "mod a;\nmod b;\npub use b::X;\npub struct Own;\n"),
        ("a.rs", "use crate::X;\nuse crate::Own;\n"),
        ("b.rs", ""),
    ]);
    assert_eq!(found, [arrow("lib", "b", 3), arrow("a", "b", 1), arrow("a", "lib", 2)]);
}

#[test]
fn cycles_and_backward_uses_are_found() {
    let arrow = |from: &str, to: &str| Arrow { from: from.into(), to: to.into(), file: "x.rs".into(), line: 7 };
    let all = [arrow("a", "b"), arrow("b", "c"), arrow("c", "b"), arrow("c", "d"), arrow("lib", "d")];
    assert_eq!(circles(&all), [&all[1], &all[2]]);
    assert!(circles(&[all[0].clone(), all[1].clone(), all[3].clone()]).is_empty());
    assert_eq!(back(&all, &["d", "c", "b", "a"]), [&all[2]]);
    assert_eq!(back(&all[3..], &["c"]), [&all[3]], "a folder that is not in the order must be reported");
    assert_eq!(all[1].show(), "x.rs:7: b -> c");
}

#[test]
fn forbidden_dependency_is_reported_with_its_line() {
    let manifest = "[package]\nname = \"proto\"\n\n[dependencies]\nprost = \"1\"\nsim-core.workspace = true\n\
                    worker.workspace = true\n\n[dev-dependencies]\ncli.workspace = true\n\n\
                    [target.'cfg(unix)'.dependencies]\nstudy = { path = \"../study\" }\n";
    assert_eq!(forbidden(manifest, &["sim-core"]), [(7, "worker".to_owned()), (13, "study".to_owned())]);
}
