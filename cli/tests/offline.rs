//! Commands that need no coordinator: shipped scenarios, robots, validation.

mod common;

use common::{SMALL_JOB, evogait, listing, run};
use std::fs;
use std::io::Read as _;
use std::process::Stdio;

#[test]
fn shipped_scenarios_are_valid() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let listed = run(path, &["scenarios", "--json"]).json();
    let of_kind = |kind: &str| -> Vec<String> {
        let all = listed.as_array().unwrap().iter();
        all.filter(|e| e["kind"] == kind).map(|e| e["name"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(of_kind("robots").len(), 7);
    for robot in of_kind("robots") {
        let facts = run(path, &["robot", &robot, "--json"]).json();
        let variants = facts["variants"].as_object().unwrap();
        if robot.starts_with("mtran") {
            continue;
        }
        assert!(variants.contains_key("E1") && variants.contains_key("E2"), "{robot}");
        for variant in variants.keys() {
            let damaged = run(path, &["robot", &robot, "--variant", variant, "--json"]).json();
            let lost = damaged["failed_modules"].as_array().unwrap().len();
            let joints = |facts: &serde_json::Value| facts["joints"].as_array().unwrap().len();
            assert_eq!(joints(&damaged) + lost, joints(&facts), "{robot} {variant}");
        }
    }
    for job in of_kind("jobs") {
        let facts = run(path, &["validate", &job, "--no-estimate", "--json"]).json();
        assert_eq!(facts["valid"], true, "{job}");
    }
}

#[test]
fn printed_scenario_has_same_job_digest() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let text = run(path, &["scenarios", "show", "quadropod-empty"]).success();
    fs::write(path.join("mine.toml"), text).unwrap();
    let digest = |job: &str| run(path, &["validate", job, "--no-estimate", "--json"]).json()["job_digest"].clone();
    assert_eq!(digest("mine.toml"), digest("quadropod-empty"));
}

#[test]
fn resolved_job_keeps_digest_and_seed_changes_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::write(path.join("job.toml"), SMALL_JOB).unwrap();
    let validate =
        |file: &str, more: &[&str]| run(path, &[&["validate", file, "--no-estimate", "--json"], more].concat()).json();
    let facts = validate("job.toml", &[]);
    fs::write(path.join("resolved.toml"), facts["job_toml"].as_str().unwrap()).unwrap();
    assert_eq!(validate("resolved.toml", &[])["job_digest"], facts["job_digest"]);
    let other = validate("job.toml", &["--seed", "2"]);
    assert_ne!(other["job_digest"], facts["job_digest"]);
    assert_eq!(other["seed"], 2);
}

#[test]
fn cost_estimate_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("job.toml"), SMALL_JOB).unwrap();
    let facts = run(folder.path(), &["validate", "job.toml", "--json"]).json();
    let estimate = &facts["estimate"];
    assert!(estimate["measured"].as_u64().unwrap() >= 1);
    assert!(estimate["seconds_per_evaluation"].as_f64().unwrap() > 0.0);
    let core = estimate["core_seconds"].as_f64().unwrap();
    assert!((core / 6.0 - estimate["seconds_per_evaluation"].as_f64().unwrap()).abs() < 1e-9);
}

#[test]
fn robots_are_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    run(path, &["robot", "lizard", "--out", "lizard.svg"]).success();
    run(path, &["robot", "lizard", "--out", "lizard.png", "--quiet"]).success();
    assert_eq!(listing(path), ["lizard.png", "lizard.svg"]);
    assert!(fs::read_to_string(path.join("lizard.svg")).unwrap().starts_with("<svg"));
    assert!(fs::read(path.join("lizard.png")).unwrap().starts_with(b"\x89PNG"));
}

#[test]
fn robots_are_exported() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let printed = run(path, &["robot", "lizard", "--format", "mjcf", "--scale", "real"]).success();
    assert!(printed.starts_with("<?xml") && printed.contains("gravity=\"0 0 -93.4\""), "{printed}");
    let told = run(path, &["robot", "lizard", "--scale", "real", "--out", "lizard.xml"]).success();
    assert!(told.contains("export    lizard.xml"), "{told}");
    assert_eq!(fs::read_to_string(path.join("lizard.xml")).unwrap(), printed);
    run(path, &["robot", "lizard", "--variant", "E1", "--out", "lizard.urdf", "--quiet"]).success();
    let urdf = fs::read_to_string(path.join("lizard.urdf")).unwrap();
    assert_eq!(urdf.matches("<joint ").count(), 7, "a stuck joint must not be exported as a joint");
}

#[test]
fn exported_robots_can_be_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let shipped = run(path, &["robot", "quadropod", "--json"]).json();
    for file in ["mine.xml", "mine.urdf"] {
        run(path, &["robot", "quadropod", "--out", file, "--quiet"]).success();
        let facts = run(path, &["robot", file, "--json"]).json();
        for fact in ["name", "joints", "bodies", "mass"] {
            assert_eq!(facts[fact], shipped[fact], "{file} {fact}");
        }
        run(path, &["robot", file, "--out", "mine.svg", "--quiet"]).success();
        let job = SMALL_JOB.replace("robot = \"quadropod\"", &format!("robot = \"{file}\""));
        fs::write(path.join("job.toml"), job).unwrap();
        let valid = run(path, &["validate", "job.toml", "--no-estimate", "--json"]).json();
        fs::write(path.join("resolved.toml"), valid["job_toml"].as_str().unwrap()).unwrap();
        fs::remove_file(path.join(file)).unwrap();
        let again = run(path, &["validate", "resolved.toml", "--no-estimate", "--json"]).json();
        assert_eq!(again["job_digest"], valid["job_digest"], "a resolved job must not need its robot file");
    }
}

#[test]
fn closed_output_pipe_is_not_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = evogait(folder.path(), &["scenarios", "show", "quadropod-empty"]);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let mut said = String::new();
    child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert_eq!((child.wait().unwrap().code(), said.as_str()), (Some(0), ""));
}
