//! Breaks the code on purpose, one way at a time, and demands that the tests named for it fail: a law that no test holds up
//! is only a wish.
//!
//! `tests/bugs.sh` runs it. The list is `tests/bugs.toml`. It works on a copy of the tree in `target/bugs`, so that nothing of
//! the tree itself is touched. Every test of the list has to pass there first, as the code is.

use cluster_tests::sandbox::cargo;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::fs;
use std::io::Read as _;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

/// A run of tests that takes longer hangs. Most take seconds.
const CHECK_WITHIN: Duration = Duration::from_secs(400);
const USAGE: &str = "usage: bugs [--list] [--shard K/N] [WORD...]
bugs whose names or files contain one of the words, all if none is given; of those the K-th of N shards";

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct List {
    bug: Vec<Bug>,
}

/// One way to break the code.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Bug {
    /// What is wrong with it then.
    name: String,
    /// In which file of the tree.
    file: PathBuf,
    /// What stands there, once, ...
    find: String,
    /// ... and what is put in its place.
    replace: String,
    /// What has to fail: arguments of `cargo test --locked --workspace`, or a script in `tests/` with arguments.
    seen_by: Vec<String>,
}

/// What came of a run of tests.
#[derive(Debug, PartialEq, Eq)]
enum Outcome {
    Passed,
    Failed,
    /// Neither, within [`CHECK_WITHIN`].
    Hangs,
    /// No test ran, or it could not even be built.
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
            eprintln!("bugs: {unseen} not seen as they should be; what the tests said is in target/bugs/log");
            ExitCode::FAILURE
        }
        Err(reason) => {
            eprintln!("bugs: {reason}");
            ExitCode::FAILURE
        }
    }
}

/// What was asked for.
#[derive(Debug, PartialEq, Eq)]
struct Wanted {
    only_list: bool,
    /// K of N, from 1.
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

    /// Those that are wanted: every N-th, so that a shard has some of each file.
    fn of(&self, bugs: Vec<Bug>) -> Vec<Bug> {
        let has = |bug: &Bug, word: &String| bug.name.contains(word) || bug.file.to_string_lossy().contains(word);
        let named =
            bugs.into_iter().filter(|bug| self.words.is_empty() || self.words.iter().any(|word| has(bug, word)));
        named.skip(self.shard.0 - 1).step_by(self.shard.1).collect()
    }
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package is in the tree")
}

/// How many bugs were not seen.
fn run(root: &Path, wanted: &Wanted) -> Result<usize, String> {
    let bugs = wanted.of(list(root)?);
    if bugs.is_empty() {
        return Err(format!("there is none for {wanted:?}; {USAGE}"));
    }
    if wanted.only_list {
        for bug in &bugs {
            println!("{}\n    in {}, seen by {}", bug.name, bug.file.display(), bug.seen_by.join(", "));
        }
        return Ok(0);
    }

    let work = root.join("target/bugs");
    let tree = Tree { root: work.join("tree"), target: work.join("target"), log: work.join("log") };
    fs::create_dir_all(&tree.log).map_err(|e| format!("{}: {e}", tree.log.display()))?;
    copy(root, &tree.root)?;
    println!("bugs: the code as it is");
    tree.build()?;
    let checks: BTreeSet<&String> = bugs.iter().flat_map(|bug| &bug.seen_by).collect();
    for check in checks {
        let outcome = tree.check("as it is", check)?;
        if outcome != Outcome::Passed {
            return Err(format!("{check}: {outcome:?} on the code as it is; see {}", tree.log.display()));
        }
    }
    println!("bugs: the code as it is passes; now {} ways to break it", bugs.len());

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
        let seen = told.iter().all(|(_, outcome)| *outcome == Outcome::Failed);
        unseen += usize::from(!seen);
        println!(
            "{} {} ({:.0} s)",
            if seen { "seen    " } else { "NOT SEEN" },
            bug.name,
            start.elapsed().as_secs_f64()
        );
        for (check, outcome) in told.iter().filter(|(_, outcome)| !seen || *outcome != Outcome::Failed) {
            println!("         {outcome:?}: {check}");
        }
    }
    println!("bugs: {} of {} seen", bugs.len() - unseen, bugs.len());
    Ok(unseen)
}

/// All bugs, each of which finds its place in the code.
fn list(root: &Path) -> Result<Vec<Bug>, String> {
    let text = read(&root.join("tests/bugs.toml"))?;
    let List { bug: bugs } = toml::from_str(&text).map_err(|e| format!("tests/bugs.toml: {e}"))?;
    for bug in &bugs {
        broken(bug, &read(&root.join(&bug.file))?)?;
    }
    Ok(bugs)
}

/// The file with the bug in it.
fn broken(bug: &Bug, text: &str) -> Result<String, String> {
    let Bug { name, file, find, replace, seen_by } = bug;
    let wrong = |what: &str| Err(format!("tests/bugs.toml, {name:?}: {what} in {}", file.display()));
    match text.matches(find.as_str()).count() {
        _ if seen_by.is_empty() => wrong("nobody is asked to see it"),
        1 => Ok(text.replacen(find.as_str(), replace, 1)),
        0 => wrong("`find` does not stand"),
        _ => wrong("`find` stands more than once"),
    }
}

/// The copy of the code.
struct Tree {
    root: PathBuf,
    target: PathBuf,
    log: PathBuf,
}

impl Tree {
    fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new(program);
        command.current_dir(&self.root).env("CARGO_TARGET_DIR", &self.target).stdin(Stdio::null());
        // It is built again and again, and nobody debugs it.
        command.env("CARGO_PROFILE_DEV_DEBUG", "0");
        command
    }

    /// Builds everything once, however long that takes.
    fn build(&self) -> Result<(), String> {
        let mut cargo = self.command(cargo());
        let built = cargo.args(["test", "--locked", "--quiet", "--workspace", "--no-run"]).status();
        match built.map_err(|e| format!("cargo: {e}"))?.success() {
            true => Ok(()),
            false => Err("the code as it is does not build".to_owned()),
        }
    }

    /// Runs a check in a process group of its own, which is killed if it hangs.
    fn check(&self, name: &str, check: &str) -> Result<Outcome, String> {
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
        let (mut reader, writer) = std::io::pipe().map_err(|e| format!("a pipe: {e}"))?;
        command.stdout(writer.try_clone().map_err(|e| format!("a pipe: {e}"))?).stderr(writer);
        let mut child = command.spawn().map_err(|e| format!("{check}: {e}"))?;
        // It holds the pipe's other end.
        drop(command);
        let reading = std::thread::spawn(move || {
            let mut said = Vec::new();
            // What can't be read any more was said to nobody.
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
        // Also what it left behind, which would hold the pipe.
        let _ = Command::new("kill").args(["-9", "--", &format!("-{}", child.id())]).stderr(Stdio::null()).status();
        let _ = child.wait();
        let said = reading.join().map_err(|_| format!("{check}: it can't be read"))?;
        self.keep(name, check, &said)?;
        let said = String::from_utf8_lossy(&said);
        // What does not compile is no bug.
        let ran =
            !said.contains("error: could not compile") && (check.starts_with("tests/") || said.lines().any(ran_some));
        Ok(match status {
            None => Outcome::Hangs,
            Some(_) if !ran => Outcome::Nothing,
            Some(status) if status.success() => Outcome::Passed,
            Some(_) => Outcome::Failed,
        })
    }

    fn keep(&self, name: &str, check: &str, said: &[u8]) -> Result<(), String> {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
        let file: String = format!("{name}--{check}").chars().map(plain).take(200).collect();
        let file = self.log.join(file + ".txt");
        fs::write(&file, said).map_err(|e| format!("{}: {e}", file.display()))
    }
}

/// Whether a line of cargo's says that tests ran.
fn ran_some(line: &str) -> bool {
    line.strip_prefix("running ").is_some_and(|rest| !rest.starts_with("0 "))
}

/// Makes a copy the same as the tree, without touching what is the same already: cargo goes by the time of a file.
fn copy(from: &Path, to: &Path) -> Result<(), String> {
    let mut git = Command::new("git");
    git.args(["ls-files", "-z", "--cached", "--others", "--exclude-standard"]).current_dir(from);
    let output = git.output().map_err(|e| format!("git: {e}"))?;
    if !output.status.success() {
        return Err(format!("git: {}", String::from_utf8_lossy(&output.stderr)));
    }
    let names = String::from_utf8(output.stdout).map_err(|_| "git names a file that is no text".to_owned())?;
    let mut wanted = BTreeSet::new();
    for name in names.split_terminator('\0') {
        let (source, target) = (from.join(name), to.join(name));
        // Deleted, and not yet told to git.
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
    fn every_bug_of_the_list_finds_its_place_in_the_code() {
        assert!(!list(root()).unwrap().is_empty());
    }

    /// A filter that matches no test would only be found by the run that needs it.
    #[test]
    fn every_test_of_the_list_is_there() {
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
            assert!(missing.is_empty(), "{check}: there is no test, module or file named {missing:?}");
        }
    }

    #[test]
    fn every_bug_is_in_one_shard() {
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
