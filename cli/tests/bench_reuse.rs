//! `evogait bench reuse` on a small job.

mod common;

use common::run;
use std::fs;

const JOB: &str = r#"
name = "small"
robot = "quadropod"
environment = "empty"
gaits = { count = 2, duration = 2.0 }
planner = { iterations = 12 }
fitness = { kind = "coverage", cell = 0.25 }
optimiser = { kind = "ga", population = 4, generations = 3 }
"#;

const LITTLE: [&str; 12] = [
    "--genomes",
    "6",
    "--tolerances",
    "0,0.1",
    "--variants",
    "1,3",
    "--seeds",
    "2",
    "--repeats",
    "1,2",
    "--gait-seconds",
    "1",
];

#[test]
fn reuse_study_ignores_threads_and_writes_its_files() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("small.toml"), JOB).unwrap();
    let study = |more: &[&str]| {
        let all = [&["bench", "reuse", "small.toml", "--generations", "2", "--quiet"], &LITTLE[..], more].concat();
        run(folder.path(), &all)
    };
    let one = study(&["--json", "--threads", "1"]).json();
    let three = study(&["--json", "--threads", "3", "--out", "study"]).json();
    assert_eq!(one, three);
    for (found, name) in one["environments"].as_array().unwrap().iter().zip(["empty", "column"]) {
        assert_eq!(found["environment"], name);
        let genomes = found["genomes"].as_array().unwrap();
        assert_eq!(genomes.iter().filter(|g| g["generation"] == 0).count(), 3);
        assert_eq!(genomes.len(), 6);
        let plain = &found["rows"][0];
        assert_eq!((&plain["tolerance"], &plain["median_difference"]), (&0.0.into(), &0.0.into()));
        assert_eq!(plain["fewer_than_plain"], 1.0);
        for g in genomes {
            assert_eq!(g["measured"].as_array().unwrap().len(), found["columns"].as_array().unwrap().len());
        }
    }
    let page = fs::read_to_string(folder.path().join("study/reuse.md")).unwrap();
    for part in [
        "## empty: 3 random and 3 evolved genomes",
        "| plain | ",
        "tolerance 0.05 (the job's)",
        ", 3 variants",
        ", 2 trees",
    ] {
        assert!(page.contains(part), "missing {part:?} in\n{page}");
    }
    for file in ["reuse.json", "scatter-empty.svg", "scatter-empty.png", "scatter-column.svg"] {
        assert!(folder.path().join("study").join(file).is_file(), "{file}");
    }
}

#[test]
fn genomes_of_stored_run_are_recovered() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("small.toml"), JOB).unwrap();
    run(folder.path(), &["run", "small.toml", "--out", "kept", "--quiet"]).success();
    let study =
        [&["bench", "reuse", "--run", "kept", "--environments", "empty", "--quiet", "--json"], &LITTLE[..]].concat();
    let found = run(folder.path(), &study).json();
    let genomes = found["environments"][0]["genomes"].as_array().unwrap().clone();
    let from = |generation: u32| genomes.iter().filter(|g| g["generation"] == generation).count();
    // An unchanged elite in a later generation does not count as a second genome.
    assert_eq!((from(0), from(1) + from(2)), (3, 3));
    assert!(from(2) >= 2);

    fs::remove_file(folder.path().join("kept/store.sqlite")).unwrap();
    let refused = run(folder.path(), &study);
    assert_eq!(refused.code, 2);
    assert!(refused.err.contains("has no store.sqlite"), "{}", refused.err);
    let wrong = run(folder.path(), &["bench", "reuse", "--tolerances", "0.05,2"]);
    assert!(wrong.err.contains("allowed is 0 to 1 rad"), "{}", wrong.err);
}
