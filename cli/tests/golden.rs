//! Golden jobs: small jobs with recorded scores and winners; and the recorded digests of all shipped jobs.
//!
//! The files are in `tests/golden`: a resolved job `NAME.toml`, and its recorded result `NAME.json`. A change of one of
//! these numbers changes the results of every user. Explain it in the commit, then record the new numbers with
//! `EVOGAIT_RECORD=1 cargo test -p cli --test golden`.

mod common;

use common::run;
use serde_json::{Value, json};
use sim_core::model::catalogue;
use std::fs;
use std::path::{Path, PathBuf};

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden")
}

/// Compares a value with the recorded one; with EVOGAIT_RECORD set, records it first.
fn compare(file: &str, found: &Value) {
    let path = golden().join(file);
    if std::env::var_os("EVOGAIT_RECORD").is_some() {
        fs::write(&path, serde_json::to_string_pretty(found).unwrap() + "\n").unwrap();
    }
    let recorded: Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    assert_eq!(*found, recorded, "{file}");
}

/// Runs a golden job and compares its result. The result digest covers the bits of every score of search and finish.
fn check(name: &str) {
    let folder = tempfile::tempdir().unwrap();
    let job = golden().join(format!("{name}.toml"));
    run(folder.path(), &["run", job.to_str().unwrap(), "--out", "out", "--quiet"]).success();
    let out = folder.path().join("out");
    let result: Value = serde_json::from_str(&fs::read_to_string(out.join("result.json")).unwrap()).unwrap();
    let history = fs::read_to_string(out.join("history.csv")).unwrap();
    let winner = |field: &str| result["winner"][field].clone();
    let found = json!({
        "job_digest": result["job_digest"],
        "result_digest": result["result_digest"],
        "winner": {
            "generation": winner("generation"),
            "candidate": winner("candidate"),
            "fitness": winner("fitness"),
            "fresh": winner("fresh"),
            "reference": winner("reference"),
            "genome": winner("genome"),
        },
        "history": history.lines().collect::<Vec<_>>(),
    });
    compare(&format!("{name}.json"), &found);
}

macro_rules! golden_jobs {
    ($($test:ident: $name:literal),* $(,)?) => {
        $(
            #[test]
            fn $test() {
                check($name);
            }
        )*

        #[test]
        fn every_golden_job_is_run() {
            let files = fs::read_dir(golden()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
            let mut jobs: Vec<String> = files.filter_map(|f| Some(f.strip_suffix(".toml")?.to_owned())).collect();
            jobs.sort();
            assert_eq!(jobs, [$($name),*]);
        }
    };
}

golden_jobs! {
    lizard_coverage_in_three_dimensions_keeps_its_scores: "lizard-coverage-3d",
    lizard_coverage_by_pso_on_rapier_keeps_its_scores: "lizard-pso-rapier",
    lizard_sine_at_real_scale_on_lockstep_keeps_its_scores: "lizard-sine-lockstep-real",
    lizard_on_stairs_keeps_its_scores: "lizard-stairs-rapier",
    quadropod_distance_with_original_planner_keeps_its_scores: "quadropod-constriction-goal",
    quadropod_with_reference_finish_keeps_its_scores: "quadropod-finish",
    quadropod_coverage_by_ga_on_lockstep_keeps_its_scores: "quadropod-ga-lockstep",
}

#[test]
fn shipped_jobs_keep_their_digests() {
    let folder = tempfile::tempdir().unwrap();
    let digest = |name: &str| {
        let checked = run(folder.path(), &["validate", name, "--no-estimate", "--json"]).json();
        (name.to_owned(), checked["job_digest"].clone())
    };
    let digests: serde_json::Map<String, Value> = catalogue::jobs().iter().map(|job| digest(job.name)).collect();
    compare("shipped-jobs.json", &digests.into());
}
