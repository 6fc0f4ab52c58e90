//! Errors of commands for invalid input. No command panics, and none leaves files behind.

mod common;

use common::{SMALL_JOB, listing, run};
use std::fs;
use std::net::TcpListener;
use std::path::Path;
use tempfile::TempDir;

/// Creates a temporary folder with files.
fn folder(files: &[(&str, &str)]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, content) in files {
        fs::write(folder.path().join(name), content).unwrap();
    }
    folder
}

/// Runs a command that must fail and leave the folder unchanged; returns its error text.
fn failure(folder: &Path, code: i32, arguments: &[&str]) -> String {
    let before = listing(folder);
    let seen = run(folder, arguments);
    assert_eq!(seen.code, code, "{arguments:?}: {}{}", seen.out, seen.err);
    assert_eq!(seen.out, "", "{arguments:?}");
    assert_eq!(listing(folder), before, "{arguments:?}");
    seen.err
}

/// Returns the error of `validate` for the small job after replacements; `run` must give the same error.
fn refused_with(files: &[(&str, &str)], replacements: &[(&str, &str)]) -> String {
    let (said, ran) = validated_and_run(files, replacements);
    assert_eq!(ran, said);
    said
}

/// Returns the error of `validate` for the small job after replacements. A run must fail with the same reason when it
/// prepares the job.
fn unprepared_with(files: &[(&str, &str)], replacements: &[(&str, &str)]) -> String {
    let (said, ran) = validated_and_run(files, replacements);
    let (_, reason) =
        said.strip_prefix("error: ").and_then(|text| text.split_once(": ")).expect("the error has a file and a reason");
    assert!(ran.contains("error: job \"small\" (j1-") && ran.ends_with(&format!(") failed: {reason}")), "{said}{ran}");
    said
}

/// Returns the errors of `validate` and `run` for the small job after replacements.
fn validated_and_run(files: &[(&str, &str)], replacements: &[(&str, &str)]) -> (String, String) {
    let mut job = SMALL_JOB.to_owned();
    for (from, to) in replacements {
        assert!(job.contains(from), "{from}");
        job = job.replace(from, to);
    }
    let folder = folder(files);
    fs::write(folder.path().join("job.toml"), job).unwrap();
    let said = failure(folder.path(), 1, &["validate", "job.toml"]);
    (said, failure(folder.path(), 1, &["run", "job.toml", "--out", "out"]))
}

fn refused(replacements: &[(&str, &str)]) -> String {
    refused_with(&[], replacements)
}

const ROBOT: &str = r#"
name = "worm"
pivot = "a"

[[module]]
name = "a"
kind = "cosmo"

[[module]]
name = "b"
kind = "cosmo"
attach = { to = "a", port = "front" }
"#;

/// Returns the error for a robot file after replacements. It must be the same for a job's robot and for `evogait
/// robot`.
fn robot_refused(replacements: &[(&str, &str)]) -> String {
    let mut robot = ROBOT.to_owned();
    for (from, to) in replacements {
        assert!(robot.contains(from), "{from}");
        robot = robot.replace(from, to);
    }
    let said = refused_with(&[("worm.toml", &robot)], &[("\"quadropod\"", "\"worm.toml\"")]);
    let folder = folder(&[("worm.toml", &robot)]);
    assert_eq!(failure(folder.path(), 1, &["robot", "worm.toml", "--out", "worm.svg"]), said);
    said
}

const ENVIRONMENT: &str = r#"
name = "yard"
size = [20.0, 10.0]
start = { x = -5.0, y = 0.0 }
goal = { x = 5.0, y = 0.0 }

[[obstacle]]
center = [0.0, 0.0]
size = [2.0, 2.0]
top = 1.0
"#;

fn environment_refused(replacements: &[(&str, &str)]) -> String {
    refused_with(&[("yard.toml", &environment(replacements))], &[("\"empty\"", "\"yard.toml\"")])
}

/// Same as [`environment_refused`], for faults that only the settled robot shows.
fn start_refused(replacements: &[(&str, &str)]) -> String {
    unprepared_with(&[("yard.toml", &environment(replacements))], &[("\"empty\"", "\"yard.toml\"")])
}

fn environment(replacements: &[(&str, &str)]) -> String {
    let mut environment = ENVIRONMENT.to_owned();
    for (from, to) in replacements {
        assert!(environment.contains(from), "{from}");
        environment = environment.replace(from, to);
    }
    environment
}

#[test]
fn unchanged_test_files_are_valid() {
    let folder = folder(&[("worm.toml", ROBOT), ("yard.toml", ENVIRONMENT)]);
    let job = SMALL_JOB.replace("\"quadropod\"", "\"worm.toml\"").replace("\"empty\"", "\"yard.toml\"");
    fs::create_dir(folder.path().join("jobs")).unwrap();
    fs::write(folder.path().join("job.toml"), job).unwrap();
    run(folder.path(), &["validate", "job.toml", "--no-estimate"]).success();
    run(folder.path(), &["robot", "worm.toml"]).success();
}

#[test]
fn unknown_names_are_refused() {
    let said = [
        refused(&[("\"quadropod\"", "\"quadroped\"")]),
        refused(&[("\"empty\"", "\"emty\"")]),
        refused(&[("seed = 1", "seed = 1\nvariant = \"E9\"")]),
        refused(&[("\"quadropod\"", "\"robots/mine.toml\"")]),
        refused(&[("kind = \"coverage\"\ncell = 0.5", "kind = \"speed\"")]),
        refused(&[("count = 2", "count = 2\nbounds = { my = [0.0, 1.0] }")]),
        failure(folder(&[]).path(), 1, &["run", "quadropod"]),
        failure(folder(&[]).path(), 1, &["robot", "quadroped"]),
        failure(folder(&[]).path(), 1, &["robot", "quadropod", "--variant", "E9"]),
        failure(folder(&[]).path(), 1, &["scenarios", "show", "quadroped"]),
    ];
    // Shortens the lists of shipped jobs and scenarios, so that new ones do not change the snapshot.
    let jobs = ["jobs that ship are ", "scenarios that ship are "];
    let shortened = said.map(|text| match jobs.iter().find_map(|list| text.find(list).map(|at| at + list.len())) {
        Some(end) => format!("{}NAMES\n", &text[..end]),
        None => text,
    });
    insta::assert_snapshot!(shortened.join("\n"));
}

#[test]
fn unknown_and_missing_fields_are_refused() {
    let said = [
        refused(&[("seed = 1", "seeds = 1")]),
        refused(&[("count = 2", "")]),
        refused(&[("iterations = 4", "iteration = 4")]),
        refused(&[("count = 2", "count = \"two\"")]),
        robot_refused(&[("pivot = \"a\"", "pivott = \"a\"")]),
        environment_refused(&[("top = 1.0", "height = 1.0")]),
        // For tables with several kinds, the error also has the line, and the kind that a foreign field belongs to.
        refused(&[("particles = 3", "particles = -3")]),
        refused(&[("cell = 0.5", "cell = \"wide\"")]),
        refused(&[("particles = 3", "particles = 3\nelite = 1")]),
        refused(&[("kind = \"coverage\"", "kind = \"distance\"")]),
        refused(&[("kind = \"pso\"", "")]),
    ];
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn impossible_robots_are_refused() {
    let said = [
        robot_refused(&[("kind = \"cosmo\"\nattach", "kind = \"cosmos\"\nattach")]),
        robot_refused(&[("to = \"a\"", "to = \"c\"")]),
        robot_refused(&[("port = \"front\"", "port = \"bow\"")]),
        robot_refused(&[("pivot = \"a\"", "pivot = \"c\"")]),
        robot_refused(&[("name = \"b\"", "name = \"a\"")]),
        robot_refused(&[("attach = { to = \"a\", port = \"front\" }", "")]),
        robot_refused(&[("to = \"a\"", "to = \"b\"")]),
        // A third module that overlaps the first.
        robot_refused(&[(
            "port = \"front\" }\n",
            "port = \"front\" }\n\n[[module]]\nname = \"c\"\nkind = \"cosmo\"\npose = { position = [0.3, 0.0, 0.0] }\n",
        )]),
    ];
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn overlapping_modules_are_refused() {
    // Each block turns left, so the fifth block overlaps the first.
    let mut robot = "name = \"square\"\npivot = \"m0\"\n\n[[module]]\nname = \"m0\"\nkind = \"block\"\n".to_owned();
    for i in 1..=4 {
        let attach = format!("{{ to = \"m{}\", port = \"left\" }}", i - 1);
        robot += &format!("\n[[module]]\nname = \"m{i}\"\nkind = \"block\"\nattach = {attach}\n");
    }
    let folder = folder(&[("square.toml", &robot)]);
    insta::assert_snapshot!(failure(folder.path(), 1, &["robot", "square.toml"]));
}

#[test]
fn numbers_out_of_range_are_refused() {
    let said = [
        refused(&[("count = 2", "count = 0")]),
        refused(&[("count = 2", "count = -1")]),
        refused(&[("iterations = 4", "iterations = 0")]),
        refused(&[("duration = 3.0", "duration = nan")]),
        refused(&[("duration = 3.0", "duration = inf")]),
        refused(&[("duration = 3.0", "duration = -3.0")]),
        refused(&[("iterations = 4", "iterations = 4\nreuse_tolerance = nan")]),
        refused(&[("particles = 3", "particles = 0")]),
        refused(&[("particles = 3", "particles = 10000"), ("count = 2", "count = 32")]),
        refused(&[("generations = 2", "generations = 0")]),
        refused(&[("seed = 1", "seed = -1")]),
        refused(&[("name = \"small\"", "name = \"../small\"")]),
        environment_refused(&[("size = [2.0, 2.0]", "size = [2.0, nan]")]),
    ];
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn faults_of_several_files_are_listed_together() {
    let bad_robot = ROBOT.replace("port = \"front\"", "port = \"bow\"");
    let said = [
        refused(&[
            ("count = 2", "count = 0"),
            ("iterations = 4", "iterations = 0"),
            ("particles = 3", "particles = 0"),
        ]),
        refused_with(
            &[("worm.toml", &bad_robot)],
            &[
                ("\"quadropod\"", "\"worm.toml\""),
                ("seed = 1", "seed = 9223372036854775807"),
                ("count = 2", "count = 0"),
            ],
        ),
        environment_refused(&[("size = [2.0, 2.0]", "size = [2.0, nan]"), ("top = 1.0", "top = -1.0")]),
        refused(&[("seed = 1", "sed = 1"), ("count = 2", "cuont = 2"), ("cell = 0.5", "cels = 0.5")]),
    ];
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn invalid_start_or_goal_is_refused() {
    let said = [
        environment_refused(&[("start = { x = -5.0", "start = { x = 0.5")]),
        start_refused(&[("start = { x = -5.0", "start = { x = -1.5")]),
        environment_refused(&[("start = { x = -5.0", "start = { x = -50.0")]),
        environment_refused(&[("goal = { x = 5.0", "goal = { x = 50.0")]),
        environment_refused(&[("goal = { x = 5.0", "goal = { x = 0.0")]),
        refused(&[("kind = \"coverage\"\ncell = 0.5", "kind = \"distance\"")]),
    ];
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn unreadable_files_are_refused() {
    let folder = folder(&[("job.toml", SMALL_JOB), ("empty.toml", ""), ("broken.toml", "name = \n")]);
    let path = folder.path();
    fs::create_dir(path.join("folder.toml")).unwrap();
    fs::write(path.join("bytes.toml"), [b'n', 0xff]).unwrap();
    fs::write(path.join("long.toml"), "#".repeat(300_000)).unwrap();
    let said: Vec<String> = ["none.toml", "folder.toml", "bytes.toml", "long.toml", "empty.toml", "broken.toml"]
        .into_iter()
        .map(|name| failure(path, 1, &["validate", name]))
        .chain([
            failure(path, 1, &["verify", "none"]),
            failure(path, 1, &["replay", "job.toml", "--plan"]),
            failure(path, 1, &["robot", "none.toml"]),
        ])
        .collect();
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn wrong_usage_exits_with_code_2() {
    let path = folder(&[("job.toml", SMALL_JOB)]);
    let path = path.path();
    let said = [
        failure(path, 2, &["run"]),
        failure(path, 2, &["evolve"]),
        failure(path, 2, &["run", "job.toml", "--workers", "0"]),
        failure(path, 2, &["run", "job.toml", "--seed", "-1"]),
        failure(path, 2, &["run", "job.toml", "--seed", "9223372036854775808"]),
        failure(path, 2, &["evaluate", "job.toml", "--generation", "first"]),
        failure(path, 2, &["run", "job.toml", "--workers", "2", "--coordinator", "http://127.0.0.1:1"]),
        failure(path, 2, &["list", "--coordinator", "127.0.0.1:7077"]),
        failure(path, 2, &["list", "--coordinator", "https://127.0.0.1:7077"]),
        failure(path, 2, &["submit", "job.toml", "--priority", "101"]),
        failure(path, 2, &["replay", "runs/x"]),
        failure(path, 2, &["robot", "lizard", "--out", "lizard.pdf"]),
    ];
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn unreachable_coordinator_is_reported() {
    // A free port: its listener is closed at once.
    let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let url = format!("http://127.0.0.1:{port}");
    let folder = folder(&[("job.toml", SMALL_JOB)]);
    let path = folder.path();
    let said = failure(path, 1, &["list", "--coordinator", &url]).replace(&port.to_string(), "PORT");
    insta::assert_snapshot!(said);
    for arguments in [
        vec!["submit", "job.toml"],
        vec!["watch", "1"],
        vec!["show", "1"],
        vec!["cancel", "1"],
        vec!["fetch", "1", "--out", "out"],
        vec!["workers"],
    ] {
        let arguments = [arguments, vec!["--coordinator", &url]].concat();
        assert_eq!(failure(path, 1, &arguments).replace(&port.to_string(), "PORT"), said);
    }
}

#[test]
fn unwritable_output_is_refused() {
    let folder = folder(&[("job.toml", SMALL_JOB), ("file", "")]);
    let path = folder.path();
    fs::create_dir(path.join("full")).unwrap();
    fs::write(path.join("full/thesis.tex"), "").unwrap();
    let mut said = vec![
        failure(path, 1, &["run", "job.toml", "--out", "file/out"]),
        failure(path, 1, &["run", "job.toml", "--out", "file"]),
        failure(path, 1, &["run", "job.toml", "--out", "full"]),
        failure(path, 1, &["robot", "lizard", "--out", "none/lizard.svg"]),
    ];
    if cfg!(target_os = "linux") {
        said.push(failure(path, 1, &["run", "job.toml", "--out", "/proc/evogait/out"]));
    }
    insta::assert_snapshot!(said.join("\n"));
}

/// A limit on the size of files simulates a full disk: writing beyond the limit fails in the same way.
#[cfg(target_os = "linux")]
#[test]
fn full_disk_fails_without_partial_files() {
    use common::Seen;
    use std::process::{Command, Stdio};

    let folder = folder(&[("job.toml", SMALL_JOB)]);
    let path = folder.path();
    let program = env!("CARGO_BIN_EXE_evogait");
    let limited = |command: &str| {
        let script = format!("trap '' XFSZ; ulimit -f 4; exec '{program}' {command}");
        Seen::of(Command::new("sh").args(["-c", &script]).current_dir(path).stdin(Stdio::null()).output().unwrap())
    };
    let before = listing(path);
    let drawn = limited("robot lizard --out lizard.svg");
    assert_eq!((drawn.code, drawn.out.as_str()), (1, ""));
    assert_eq!(listing(path), before);

    let full = |arguments: &str| {
        let script = format!("exec '{program}' {arguments} > /dev/full");
        Seen::of(Command::new("sh").args(["-c", &script]).current_dir(path).stdin(Stdio::null()).output().unwrap())
    };
    let listed = full("scenarios");
    assert_eq!(listed.code, 1);
    assert_eq!(listing(path), before);
    insta::assert_snapshot!([drawn.err, listed.err].join("\n"));
}

/// The disk becomes full at different times of a run: the run fails with an error, and resumes when there is room.
#[cfg(target_os = "linux")]
#[test]
fn run_on_full_disk_fails_and_can_resume() {
    use common::Seen;
    use std::process::{Command, Stdio};

    for blocks in [20, 200, 400] {
        let folder = folder(&[("job.toml", SMALL_JOB)]);
        let path = folder.path();
        let program = env!("CARGO_BIN_EXE_evogait");
        let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec '{program}' run job.toml --out out --quiet");
        let mut limited = Command::new("sh");
        let seen = Seen::of(limited.args(["-c", &script]).current_dir(path).stdin(Stdio::null()).output().unwrap());
        assert_eq!((seen.code, seen.out.as_str()), (1, ""), "{blocks} blocks: {}", seen.err);
        assert!(seen.err.lines().any(|line| line.starts_with("error: ")), "{}", seen.err);
        let left = listing(&path.join("out"));
        assert!(!left.iter().any(|f| f.ends_with(".tmp") || f == "result.json" || f.ends_with(".csv")), "{left:?}");
        run(path, &["run", "job.toml", "--out", "out", "--quiet"]).success();
        assert!(path.join("out/result.json").is_file());
    }
}

/// Returns a genome of the small job with one number replaced.
fn genome_with(i: usize, number: &str) -> String {
    let folder = folder(&[("job.toml", SMALL_JOB)]);
    let length =
        run(folder.path(), &["validate", "job.toml", "--json", "--no-estimate"]).json()["genome_length"].clone();
    let mut numbers = vec!["0.4".to_owned(); length.as_u64().unwrap() as usize];
    numbers[i] = number.to_owned();
    numbers.join(",")
}

#[test]
fn genomes_out_of_range_are_refused() {
    let mut said = Vec::new();
    for (i, number) in [(0, "NaN"), (1, "inf"), (7, "-infinity"), (2, "1e999"), (3, "-1000.5"), (4, "5e10")] {
        let genome = genome_with(i, number);
        let folder = folder(&[("job.toml", SMALL_JOB), ("genome.txt", &genome)]);
        let given = failure(folder.path(), 2, &["evaluate", "job.toml", &format!("--genome={genome}")]);
        let in_file = failure(folder.path(), 2, &["evaluate", "job.toml", "--genome-file", "genome.txt"]);
        assert_eq!(given, in_file);
        said.push(given);
    }
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn integers_out_of_range_are_reported_with_all_digits() {
    let seed = |seed: &str| refused(&[("seed = 1", &format!("seed = {seed}"))]);
    let said = [
        seed("9223372036854775808"),
        seed("18446744073709551615"),
        seed("18446744073709551616"),
        seed("-1"),
        seed("-9223372036854775809"),
        refused(&[("iterations = 4", "iterations = 4\nmax_rollouts = 9007199254740993")]),
        refused(&[("iterations = 4", "iterations = 4\nmax_rollouts = 9223372036854775808")]),
        refused(&[("iterations = 4", "iterations = 4\nmax_rollouts = 10000000001")]),
        refused(&[("iterations = 4", "iterations = 4294967296")]),
        failure(folder(&[]).path(), 2, &["run", "quadropod-empty", "--seed", "9223372036854775808"]),
    ];
    insta::assert_snapshot!(said.join("\n"));
    let job = SMALL_JOB.replace("seed = 1", "seed = 9223372036854775807");
    let folder = folder(&[("job.toml", &job)]);
    let valid = run(folder.path(), &["validate", "job.toml", "--json", "--no-estimate"]).json();
    assert_eq!(valid["seed"].as_u64(), Some(i64::MAX as u64));
}
