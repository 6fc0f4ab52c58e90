//! `evogait bench fitness` on a small job.

mod common;

use common::run;
use serde_json::Value;
use std::fs;
use std::path::Path;

const JOB: &str = r#"
name = "small"
robot = "quadropod"
environment = "empty"
gaits = { count = 2, duration = 1.0 }
planner = { iterations = 12 }
fitness = { kind = "coverage", cell = 0.25 }
optimiser = { kind = "ga", population = 4, generations = 3 }
"#;

const LITTLE: &str = "--settings 200x2-lockstep,30x4 --reference 60x8 --seeds 3";

fn bench(folder: &Path, more: &str) -> common::Seen {
    let all: Vec<&str> = ["bench", "fitness", "--quiet"].into_iter().chain(more.split(' ')).collect();
    run(folder, &all)
}

/// Removes the fields that depend on the clock.
fn without_times(mut found: Value) -> Value {
    let rows = found["settings"].as_array().unwrap().len();
    for i in 0..rows {
        found["settings"][i]["cpu_seconds"].take();
    }
    found["ceiling"]["cpu_seconds"].take();
    found
}

#[test]
fn fitness_of_settings_is_independent_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("small.toml"), JOB).unwrap();
    let study = |more: &str| bench(folder.path(), &format!("small.toml --genomes 5 --generations 3 {LITTLE} {more}"));
    let one = without_times(study("--json --threads 1").json());
    let three = without_times(study("--json --threads 3 --out study").json());
    assert_eq!(one, three);

    let genomes = one["genomes"].as_array().unwrap();
    let ages: Vec<_> = genomes.iter().map(|g| g["generation"].as_u64().unwrap()).collect();
    assert_eq!(ages, [0, 0, 1, 1, 2]);
    let names: Vec<_> = one["settings"].as_array().unwrap().iter().map(|s| s["setting"].as_str().unwrap()).collect();
    assert_eq!(names, ["200x2-lockstep", "30x4", "60x8"]);
    // A score is the mean over the trees. The mean of a setting is over the genomes. A setting agrees with itself.
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    for (i, setting) in one["settings"].as_array().unwrap().iter().enumerate() {
        let scores = genomes.iter().map(|g| {
            let trees = g["scores"][i].as_array().unwrap();
            assert_eq!(trees.len(), 3);
            mean(&trees.iter().map(|s| s.as_f64().unwrap()).collect::<Vec<_>>())
        });
        let own = mean(&scores.collect::<Vec<_>>());
        assert!((own - setting["mean"].as_f64().unwrap()).abs() < 1e-9, "{setting}");
        assert_eq!(one["pairs"][i][i]["value"], 1.0);
        assert_eq!(one["pairs"][i][2], one["pairs"][2][i]);
    }
    let itself = &one["settings"][2]["agreement"];
    assert_eq!((&itself["spearman"]["value"], &itself["median_difference"]), (&1.0.into(), &0.0.into()));

    let page = fs::read_to_string(folder.path().join("study/fitness.md")).unwrap();
    for part in
        ["## 5 genomes of all ages against 60x8", "| 60x8 (disturbed: the ceiling) |", "## Spearman of every pair"]
    {
        assert!(page.contains(part), "missing {part:?} in\n{page}");
    }
    for file in ["fitness.json", "scatter.svg", "scatter.png"] {
        assert!(folder.path().join("study").join(file).is_file(), "{file}");
    }
}

#[test]
fn genomes_of_stored_runs_are_scored_with_every_setting() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("small.toml"), JOB).unwrap();
    for (seed, out) in [("1", "one"), ("2", "two")] {
        run(folder.path(), &["run", "small.toml", "--seed", seed, "--out", out, "--quiet"]).success();
    }
    let found = bench(folder.path(), &format!("--runs one,two --genomes 5 {LITTLE} --json")).json();
    let from = |run: u64| found["genomes"].as_array().unwrap().iter().filter(|g| g["run"] == run).count();
    assert_eq!((from(0), from(1)), (3, 2));
    let finalists = found["finalists"].as_array().unwrap();
    let who: Vec<_> = finalists.iter().map(|f| (f["run"].as_str().unwrap(), f["role"].as_str().unwrap())).collect();
    assert_eq!(who, [("one", "winner"), ("one", "search's best"), ("two", "winner"), ("two", "search's best")]);
    for f in finalists {
        let means: Vec<f64> = f["means"].as_array().unwrap().iter().map(|m| m.as_f64().unwrap()).collect();
        assert!((f["kept"].as_f64().unwrap() - means[2] / means[0]).abs() < 1e-12, "{f}");
    }

    // Winners alone are allowed, although there is nothing to rank.
    let told = bench(folder.path(), &format!("--runs one,two --genomes 0 {LITTLE}")).success();
    assert!(told.contains("mean of winners") && !told.contains("Spearman of every pair"), "{told}");

    fs::write(folder.path().join("other.toml"), JOB.replace("0.25", "0.5")).unwrap();
    run(folder.path(), &["run", "other.toml", "--out", "three", "--quiet"]).success();
    let refused = bench(folder.path(), &format!("--runs one,three {LITTLE}"));
    assert!(refused.code == 2 && refused.err.contains("only their seeds may differ"), "{}", refused.err);
    let nothing = bench(folder.path(), &format!("small.toml --genomes 0 {LITTLE}"));
    assert!(nothing.code == 2 && nothing.err.contains("nothing to score"), "{}", nothing.err);
}
