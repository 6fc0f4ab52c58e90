//! `evogait plan` with the gaits of a run: other environments, invalid options, verification; and `evogait compare`.

mod common;

use common::{SMALL_JOB, listing, run};
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// Creates a folder with a finished run in `out`.
fn evolved() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("job.toml"), SMALL_JOB).unwrap();
    run(folder.path(), &["run", "job.toml", "--out", "out", "--quiet"]).success();
    folder
}

const NEAR: &str = "name = \"near\"\nsize = [20.0, 20.0]\nstart = { x = 0.0, y = 0.0 }\n\
                    goal = { x = 0.3, y = 0.3, radius = 1.0 }\n";

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn plan_has_same_bits_on_any_worker_count() {
    let folder = evolved();
    let path = folder.path();
    let planned = run(path, &["plan", "out", "--environment", "reuse-2", "--seeds", "5", "--out", "plans", "--json"]);
    let printed = planned.json();
    assert!(planned.err.contains("planning \"small-plans-reuse-2\" in plans: 5 trees of at most 4 iterations"));
    assert_eq!(printed, json(&path.join("plans/result.json")));
    assert_eq!((&printed["procedure"], &printed["trees"]), (&"plan".into(), &5.into()));
    assert!(printed["distance"]["mean"].as_f64().is_some_and(|mean| (0.0..31.0).contains(&mean)), "{printed}");
    let found = listing(&path.join("plans"));
    for name in [
        "gaits.json",
        "gaits.png",
        "gaits.svg",
        "job.toml",
        "map.png",
        "map.svg",
        "paths.csv",
        "plan.csv",
        "plans.csv",
        "plans.json",
        "result.json",
        "trajectories/gait-2.csv",
        "tree.json",
    ] {
        assert!(found.iter().any(|f| f == name), "{name} is missing in {found:?}");
    }
    let table = fs::read_to_string(path.join("plans/plans.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + 5, "{table}");
    let distances: Vec<f64> =
        table.lines().skip(1).map(|row| row.split(',').nth(3).unwrap().parse().unwrap()).collect();
    assert_eq!(printed["distance"]["mean"].as_f64(), Some(distances.iter().sum::<f64>() / 5.0));
    let plan = fs::read_to_string(path.join("plans/plan.csv")).unwrap();
    assert_eq!(plan.lines().count(), 1 + printed["best"]["gaits"].as_array().unwrap().len());

    // The written job file gives the same bits, on one worker and on three.
    let again = run(path, &["run", "plans/job.toml", "--out", "again", "--workers", "3", "--json"]).json();
    let alone = run(path, &["run", "plans/job.toml", "--out", "alone", "--workers", "1", "--json"]).json();
    for field in ["job_digest", "result_digest", "best", "distance", "coverage"] {
        assert_eq!((&again[field], &alone[field]), (&printed[field], &printed[field]), "{field}");
    }
    let summary = run(path, &["plan", "out", "--environment", "reuse-2", "--seeds", "5", "--out", "plans"]);
    assert!(summary.err.contains("already done: its result is in plans"), "{}", summary.err);
    for told in ["0 of 5 trees reached the goal", "distance to goal", "coverage", "best plan", "evogait verify plans"] {
        assert!(summary.out.contains(told), "{told}:\n{}", summary.out);
    }
}

#[test]
fn changed_plan_fails_verification() {
    let folder = evolved();
    let path = folder.path();
    fs::write(path.join("near.toml"), NEAR).unwrap();
    let made = run(path, &["plan", "out", "--environment", "near.toml", "--seeds", "3", "--out", "p", "--json"]).json();
    assert_eq!(made["reached"], 3, "every tree must reach the goal: the start is within its radius");
    for full in [&["verify", "p", "--json"][..], &["verify", "p", "--json", "--full"][..]] {
        let verified = run(path, full).json();
        assert_eq!(verified["verified"], true, "{verified}");
    }
    let plans = fs::read_to_string(path.join("p/plans.json")).unwrap();
    fs::write(path.join("p/plans.json"), plans.replacen("\"coverage\":", "\"coverage\":1", 1)).unwrap();
    let touched = run(path, &["verify", "p", "--full"]);
    assert_eq!(touched.code, 1);
    assert!(touched.err.contains("all trees and plans differs"), "{}", touched.err);
}

#[test]
fn plan_job_reads_run_and_refuses_other_robot() {
    let folder = evolved();
    let path = folder.path();
    let job = |robot: &str, gaits: &str| {
        format!(
            "name = \"p\"\nprocedure = \"plan\"\nrobot = \"{robot}\"\nenvironment = \"reuse-1\"\n\
             gaits = {{ count = 2, duration = 3.0 }}\nplanner = {{ iterations = 3 }}\n\
             [plan]\nseeds = 2\ngaits = \"{gaits}\"\n"
        )
    };
    for (name, robot, gaits) in
        [("good", "quadropod", "out"), ("other", "lizard", "out/gaits.json"), ("none", "quadropod", "nowhere")]
    {
        fs::write(path.join(format!("{name}.toml")), job(robot, gaits)).unwrap();
    }
    assert_eq!(run(path, &["run", "good.toml", "--out", "p", "--json"]).json()["trees"], 2);
    let checked = run(path, &["validate", "good.toml"]).success();
    assert!(checked.contains("plan           2 trees"), "{checked}");

    let other = run(path, &["validate", "other.toml"]);
    assert_eq!(other.code, 1);
    assert!(other.err.contains("gaits.json: gaits: gait 1 has a parameter "), "{}", other.err);
    assert!(other.err.contains("that robot \"lizard\" does not have: its joints are "), "{}", other.err);
    let none = run(path, &["run", "none.toml"]);
    assert_eq!((none.code, none.err.contains("can't read nowhere")), (1, true), "{}", none.err);

    // Commands for jobs that evolve refuse a job that plans.
    for command in [
        &["evaluate", "good.toml", "--genome", "1"][..],
        &["bench", "evaluate", "good.toml"],
        &["bench", "dispatch", "good.toml"],
        &["replay", "p", "--plan"],
    ] {
        let refused = run(path, command);
        assert_eq!(refused.code, 2, "{command:?}: {}", refused.err);
        assert!(refused.err.contains("plans with gaits that are given"), "{command:?}: {}", refused.err);
    }
    for (options, said) in [
        (
            &["--algorithm", "a-star"][..],
            "--algorithm: unknown variant `a-star`, expected one of `flood-fill`, `original`",
        ),
        (&["--environment", "mars"], "there is no file and no environment named \"mars\""),
        (&["--seeds", "0"], "whole numbers from 1 to 1000 are allowed"),
        (&["--reuse-tolerance", "-1"], "planner.reuse_tolerance = -1 is out of range"),
        (&["--out", "out"], "out holds another job, \"small\""),
    ] {
        let refused = run(path, &[&["plan", "out"], options].concat());
        assert_ne!(refused.code, 0);
        assert!(refused.err.contains(said), "{options:?}: {}", refused.err);
    }
}

#[test]
fn runs_are_compared_by_settings_results_and_curves() {
    let folder = evolved();
    let path = folder.path();
    run(path, &["run", "job.toml", "--seed", "2", "--out", "other", "--quiet"]).success();
    run(path, &["run", "out/job.toml", "--out", "same", "--workers", "1", "--quiet"]).success();
    let compared = run(path, &["compare", "out", "other", "--out", "curves.png", "--json"]).json();
    assert_eq!(compared["settings"], serde_json::json!({ "seed": ["1", "2"] }), "{compared}");
    assert_eq!((&compared["same_job"], &compared["same_result"]), (&false.into(), &false.into()));
    assert!(fs::read(path.join("curves.png")).unwrap().starts_with(b"\x89PNG"));
    let same = run(path, &["compare", "out", "same"]).success();
    assert!(same.contains("all settings are the same") && same.contains("the same job with the same bits"), "{same}");

    run(path, &["plan", "out", "--environment", "reuse-1", "--seeds", "2", "--out", "p", "--quiet"]).success();
    let mixed = run(path, &["compare", "out", "p"]).success();
    for told in ["winner, fresh seeds", "distance to goal", "plan.seeds", "different jobs", "environment"] {
        assert!(mixed.contains(told), "{told}:\n{mixed}");
    }
    for (arguments, said) in [
        (&["compare", "out"][..], "2 values required"),
        (&["compare", "out", "p", "--out", "c.png"], "p plans with gaits that are given, so it has no curve"),
        (&["compare", "out", "other", "--out", "c.pdf"], "a picture ends with .svg or .png"),
        (&["compare", "out", "nowhere"], "can't read nowhere/job.toml"),
    ] {
        let refused = run(path, arguments);
        assert_ne!(refused.code, 0, "{arguments:?}");
        assert!(refused.err.contains(said), "{arguments:?}: {}", refused.err);
    }
}
