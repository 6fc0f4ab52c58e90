//! Mutation test: puts one known bug at a time into a copy of the code and checks that the tests named for it fail.
//!
//! `tests/bugs.sh` runs it; `tests/bugs.toml` lists the bugs. The copy is in `target/bugs`, so the tree itself does not
//! `tests/bugs.sh` runs it; `tests/bugs.toml` lists the bugs. The copy is in `target/bugs`, so the tree itself does not
//! change. The listed tests must pass on the unchanged copy first.

use cluster_tests::sandbox::cargo;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::fs;
use std::io::Read as _;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

/// Time after which a test run counts as hanging. Most runs take seconds.
const CHECK_WITHIN: Duration = Duration::from_secs(400);
const USAGE: &str = "usage: bugs [--list] [--shard K/N] [WORD...]
Runs the bugs whose name or file contains one of the words (all without a word), of these the K-th of N shards.";

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    bug: Vec<Bug>,
}

/// One known bug: a change of the code that tests must detect.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Bug {
    /// Short description of the wrong behaviour.
    name: String,
    /// File to change, relative to the root of the tree.
    file: PathBuf,
    /// Code to replace. It must stand in the file exactly once.
    find: String,
    /// Code that replaces `find`.
    replace: String,
    /// Checks that must fail: arguments of `cargo test --locked --workspace`, or a script in `tests/` with arguments.
    seen_by: Vec<String>,
}

/// Outcome of a test run.
#[derive(Debug, PartialEq, Eq)]
enum TestOutcome {
    Passed,
    Failed,
    /// The run took longer than [`CHECK_WITHIN`].
    Hangs,
    /// No test ran, or the build failed.
    Nothing,
}

fn main() -> ExitCode {
    let Some(wanted) = Wanted::read(std::env::args().skip(1)) else {
        eprintln!("{USAGE}");
        return ExitCode::from(2);
    };
    match run(root(), &wanted) {
        Ok(0) => ExitCode::SUCCESS,
        Ok(unseen) => {
            eprintln!("bugs: the tests did not detect {unseen} of the bugs; their output is in target/bugs/log");
            ExitCode::FAILURE
        }
        Err(reason) => {
            eprintln!("bugs: {reason}");
            ExitCode::FAILURE
        }
    }
}

/// Parsed command line.
#[derive(Debug, PartialEq, Eq)]
struct Wanted {
    only_list: bool,
    /// (K, N): the K-th of N shards; K counts from 1.
    shard: (usize, usize),
    words: Vec<String>,
}

impl Wanted {
    fn read(arguments: impl IntoIterator<Item = String>) -> Option<Self> {
        let mut wanted = Self { only_list: false, shard: (1, 1), words: Vec::new() };
        let mut arguments = arguments.into_iter();
        while let Some(argument) = arguments.next() {
            match argument.as_str() {
                "--list" => wanted.only_list = true,
                "--shard" => {
                    let shard = arguments.next()?;
                    let (k, n) = shard.split_once('/')?;
                    wanted.shard = (k.parse().ok()?, n.parse().ok()?);
                    if !(1..=wanted.shard.1).contains(&wanted.shard.0) {
                        return None;
                    }
                }
                option if option.starts_with('-') => return None,
                _ => wanted.words.push(argument),
            }
        }
        Some(wanted)
    }

    /// Returns the selected bugs. A shard takes every N-th bug, so that it has some of each file.
    fn of(&self, bugs: Vec<Bug>) -> Vec<Bug> {
        let has = |bug: &Bug, word: &String| bug.name.contains(word) || bug.file.to_string_lossy().contains(word);
        let named =
            bugs.into_iter().filter(|bug| self.words.is_empty() || self.words.iter().any(|word| has(bug, word)));
        named.skip(self.shard.0 - 1).step_by(self.shard.1).collect()
    }
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("tests/ is a folder of the project")
}

/// Runs the checks of all selected bugs and returns the number of bugs that no check detected.
fn run(root: &Path, wanted: &Wanted) -> Result<usize, String> {
    let bugs = wanted.of(list(root)?);
    if bugs.is_empty() {
        return Err(format!("no bug matches {wanted:?}\n{USAGE}"));
    }
    if wanted.only_list {
        for bug in &bugs {
            println!("{}\n    in {}, detected by {}", bug.name, bug.file.display(), bug.seen_by.join(", "));
        }
        return Ok(0);
    }

    let work = root.join("target/bugs");
    let tree = Tree { root: work.join("tree"), target: work.join("target"), log: work.join("log") };
    fs::create_dir_all(&tree.log).map_err(|e| format!("{}: {e}", tree.log.display()))?;
    copy(root, &tree.root)?;
    println!("bugs: checking the unchanged code");
    tree.build()?;
    let checks: BTreeSet<&String> = bugs.iter().flat_map(|bug| &bug.seen_by).collect();
    for check in checks {
        let outcome = tree.check("unchanged", check)?;
        if outcome != TestOutcome::Passed {
            return Err(format!(
                "{check}: {outcome:?} on the unchanged code, but it must pass; see {}",
                tree.log.display()
            ));
        }
    }
    println!("bugs: the unchanged code passes; now checking {} bugs", bugs.len());

    let mut unseen = 0;
    for bug in &bugs {
        let file = tree.root.join(&bug.file);
        let right = read(&file)?;
        write(&file, &broken(bug, &right)?)?;
        let start = Instant::now();
        let mut told = Vec::new();
        for check in &bug.seen_by {
            told.push((check.as_str(), tree.check(&bug.name, check)?));
        }
        write(&file, &right)?;
        let seen = told.iter().all(|(_, outcome)| *outcome == TestOutcome::Failed);
        unseen += usize::from(!seen);
        println!(
            "{} {} ({:.0} s)",
            if seen { "detected" } else { "MISSED  " },
            bug.name,
            start.elapsed().as_secs_f64()
        );
        for (check, outcome) in told.iter().filter(|(_, outcome)| !seen || *outcome != TestOutcome::Failed) {
            println!("         {outcome:?}: {check}");
        }
    }
    println!("bugs: {} of {} detected", bugs.len() - unseen, bugs.len());
    Ok(unseen)
}

/// Reads the list and checks that each bug's `find` stands in its file once.
fn list(root: &Path) -> Result<Vec<Bug>, String> {
    let text = read(&root.join("tests/bugs.toml"))?;
    let List { bug: bugs } = toml::from_str(&text).map_err(|e| format!("tests/bugs.toml: {e}"))?;
    for bug in &bugs {
        broken(bug, &read(&root.join(&bug.file))?)?;
    }
    Ok(bugs)
}

/// Returns the file's text with the bug put in.
fn broken(bug: &Bug, text: &str) -> Result<String, String> {
    let Bug { name, file, find, replace, seen_by } = bug;
    let wrong = |what: &str| Err(format!("tests/bugs.toml, {name:?}: {what} in {}", file.display()));
    match text.matches(find.as_str()).count() {
        _ if seen_by.is_empty() => wrong("`seen_by` names no test; the bug is"),
        1 => Ok(text.replacen(find.as_str(), replace, 1)),
        0 => wrong("`find` is missing"),
        _ => wrong("`find` must stand once, but stands more than once"),
    }
}

/// Copy of the code that the checks run on.
struct Tree {
    root: PathBuf,
    target: PathBuf,
    log: PathBuf,
}

impl Tree {
    fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new(program);
        command.current_dir(&self.root).env("CARGO_TARGET_DIR", &self.target).stdin(Stdio::null());
        // Debug info is not needed, and building without it is faster.
        command.env("CARGO_PROFILE_DEV_DEBUG", "0");
        command
    }

    /// Builds all tests once, without a time limit.
    fn build(&self) -> Result<(), String> {
        let mut cargo = self.command(cargo());
        let built = cargo.args(["test", "--locked", "--quiet", "--workspace", "--no-run"]).status();
        match built.map_err(|e| format!("cargo: {e}"))?.success() {
            true => Ok(()),
            false => Err("the unchanged code does not build".to_owned()),
        }
    }

    /// Runs a check in its own process group. A check that hangs is killed.
    fn check(&self, name: &str, check: &str) -> Result<TestOutcome, String> {
        let mut words = check.split_whitespace();
        let mut command = if check.starts_with("tests/") {
            let script = words.next().unwrap_or_default();
            self.command(self.root.join(script))
        } else {
            let mut cargo = self.command(cargo());
            cargo.args(["test", "--locked", "--workspace"]);
            cargo
        };
        command.args(words).process_group(0);
        let (mut reader, writer) = std::io::pipe().map_err(|e| format!("can't create a pipe: {e}"))?;
        command.stdout(writer.try_clone().map_err(|e| format!("can't copy the pipe: {e}"))?).stderr(writer);
        let mut child = command.spawn().map_err(|e| format!("{check}: {e}"))?;
        // `command` holds the pipe's writing end. Without this drop the reader would never see the end.
        drop(command);
        let reading = std::thread::spawn(move || {
            let mut said = Vec::new();
            // Output after a read error is lost; the exit code still counts.
            let _ = reader.read_to_end(&mut said);
            said
        });
        let start = Instant::now();
        let status = loop {
            match child.try_wait().map_err(|e| format!("{check}: {e}"))? {
                Some(status) => break Some(status),
                None if start.elapsed() > CHECK_WITHIN => break None,
                None => std::thread::sleep(Duration::from_millis(50)),
            }
        };
        // The check's child processes would keep the pipe open: kill the whole group.
        let _ = Command::new("kill").args(["-9", "--", &format!("-{}", child.id())]).stderr(Stdio::null()).status();
        let _ = child.wait();
        let said = reading.join().map_err(|_| format!("{check}: reading its output failed"))?;
        self.keep(name, check, &said)?;
        let said = String::from_utf8_lossy(&said);
        // A bug that does not compile tests nothing.
        let ran =
            !said.contains("error: could not compile") && (check.starts_with("tests/") || said.lines().any(ran_some));
        Ok(match status {
            None => TestOutcome::Hangs,
            Some(_) if !ran => TestOutcome::Nothing,
            Some(status) if status.success() => TestOutcome::Passed,
            Some(_) => TestOutcome::Failed,
        })
    }

    fn keep(&self, name: &str, check: &str, said: &[u8]) -> Result<(), String> {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
        let file: String = format!("{name}--{check}").chars().map(plain).take(200).collect();
        let file = self.log.join(file + ".txt");
        fs::write(&file, said).map_err(|e| format!("{}: {e}", file.display()))
    }
}

/// Returns true for a line of cargo's output that reports at least one running test.
fn ran_some(line: &str) -> bool {
    line.strip_prefix("running ").is_some_and(|rest| !rest.starts_with("0 "))
}

/// Makes `to` a copy of `from`. Files that are equal already stay untouched, because cargo compares modification times.
fn copy(from: &Path, to: &Path) -> Result<(), String> {
    let mut git = Command::new("git");
    git.args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"]).current_dir(from);
    let output = git.output().map_err(|e| format!("git: {e}"))?;
    if !output.status.success() {
        return Err(format!("git: {}", String::from_utf8_lossy(&output.stderr)));
    }
    let names =
        String::from_utf8(output.stdout).map_err(|_| "`git ls-files`: a file name is not valid UTF-8".to_owned())?;
    let mut wanted = BTreeSet::new();
    for name in names.split_terminator('\0') {
        let (source, target) = (from.join(name), to.join(name));
        // Deleted in the tree, but not yet in git's index.
        if !source.exists() {
            continue;
        }
        wanted.insert(target.clone());
        let content = |path: &Path| fs::read(path).map_err(|e| format!("{}: {e}", path.display()));
        if !target.exists() || content(&target)? != content(&source)? {
            let folder = target.parent().unwrap_or(to);
            fs::create_dir_all(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
            fs::copy(&source, &target).map_err(|e| format!("{}: {e}", target.display()))?;
        }
    }
    remove_others(to, &wanted)
}

fn remove_others(folder: &Path, wanted: &BTreeSet<PathBuf>) -> Result<(), String> {
    let failed = |e: std::io::Error| format!("{}: {e}", folder.display());
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.is_dir() {
            remove_others(&path, wanted)?;
        } else if !wanted.contains(&path) {
            fs::remove_file(&path).map_err(failed)?;
        }
    }
    Ok(())
}

fn read(path: &Path) -> Result<String, String> {
    fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    fs::write(path, text).map_err(|e| format!("{}: {e}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_find_string_stands_once_in_its_file() {
        assert!(!list(root()).unwrap().is_empty());
    }

    /// Without this test, only the run that needs a filter would find that it matches no test.
    #[test]
    fn each_listed_test_exists() {
        let mut names = String::new();
        let mut open = vec![root().to_owned()];
        while let Some(next) = open.pop() {
            for entry in fs::read_dir(&next).unwrap() {
                let path = entry.unwrap().path();
                let name = path.file_name().unwrap().to_string_lossy().into_owned();
                if path.is_dir() && name != "target" && !name.starts_with('.') {
                    names += &format!("mod {name};\n");
                    open.push(path);
                } else if name.ends_with(".rs") {
                    names += &format!("mod {};\n{}", name.trim_end_matches(".rs"), read(&path).unwrap());
                }
            }
        }
        let named = |word: &str| {
            let of = |line: &str, what: &str| line.split_once(what).is_some_and(|(_, name)| name.contains(word));
            names.lines().any(|line| of(line, "fn ") || of(line, "mod "))
        };
        for check in list(root()).unwrap().iter().flat_map(|bug| &bug.seen_by) {
            let words = check.split_whitespace().filter(|word| !word.starts_with("--") && !word.starts_with("tests/"));
            let missing: Vec<&str> = words.flat_map(|word| word.split("::")).filter(|word| !named(word)).collect();
            assert!(missing.is_empty(), "{check}: no test, module or file is named {missing:?}");
        }
    }

    #[test]
    fn each_bug_is_in_exactly_one_shard() {
        let wanted = |line: &str| Wanted::read(line.split_whitespace().map(str::to_owned));
        let names = |line: &str| wanted(line).unwrap().of(list(root()).unwrap()).into_iter().map(|bug| bug.name);
        let mut of_shards: Vec<String> = (1..=7).flat_map(|k| names(&format!("--shard {k}/7"))).collect();
        let mut all: Vec<String> = names("").collect();
        of_shards.sort();
        all.sort();
        assert_eq!(of_shards, all);
        for wrong in ["--shard", "--shard 0/3", "--shard 4/3", "--shard 3", "--shard a/b", "--other"] {
            assert_eq!(wanted(wrong), None, "{wrong}");
        }
    }
}
