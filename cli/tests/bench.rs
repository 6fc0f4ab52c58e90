//! Measurements of `evogait bench`: contents and consistency of the results, independent of this machine's speed.

mod common;

use common::{SMALL_JOB, listing, run};
use serde_json::Value;
use sim_core::engines::fidelity::FidelityTable;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("job.toml"), SMALL_JOB).unwrap();
    folder
}

fn bench(folder: &Path, arguments: &str) -> Value {
    let arguments: Vec<&str> = ["bench"].into_iter().chain(arguments.split(' ')).chain(["--json", "--quiet"]).collect();
    let seen = run(folder, &arguments);
    assert_eq!((seen.code, seen.err.as_str()), (0, ""), "{arguments:?}");
    seen.json()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is not a number"))
}

fn list(value: &Value) -> &[Value] {
    value.as_array().unwrap_or_else(|| panic!("{value} is not a list"))
}

/// Removes the fields that depend on the clock or on the number of threads.
fn without_speed(mut value: Value) -> Value {
    fn strip(value: &mut Value) {
        match value {
            Value::Object(map) => {
                map.retain(|key, _| !["simulated_per_cpu", "reference_speed", "threads"].contains(&key.as_str()));
                map.values_mut().for_each(strip);
            }
            Value::Array(list) => list.iter_mut().for_each(strip),
            _ => {}
        }
    }
    strip(&mut value);
    value
}

#[test]
fn every_setting_is_timed_on_every_gait() {
    let folder = folder();
    let found = bench(folder.path(), "rollout lizard --settings 30x4,60x2,30x4-multibody --gaits 3 --duration 0.5");
    assert_eq!((&found["robot"], &found["gaits"]), (&"lizard".into(), &3.into()));
    let settings = list(&found["settings"]);
    let names: Vec<_> = settings.iter().map(|s| s["setting"].as_str().unwrap()).collect();
    assert_eq!(names, ["30x4", "60x2", "30x4-multibody"]);
    for setting in settings {
        let speed = &setting["simulated_per_cpu"];
        assert!(0.0 < number(&speed["low"]) && number(&speed["low"]) <= number(&speed["high"]), "{setting}");
        // Time per step (µs) × steps per simulated second × simulated s per CPU s is 1e6.
        let rate = if setting["setting"] == "60x2" { 60.0 } else { 30.0 };
        let product = number(&setting["step_us"]) * rate * number(&speed["value"]);
        assert!((product - 1e6).abs() < 1.0, "{product}");
    }
}

#[test]
fn reference_setting_agrees_with_itself_exactly() {
    let folder = folder();
    let found = bench(
        folder.path(),
        "fidelity --settings 60x4,30x2 --reference 60x4 --random 6 --evolved 0 --duration 1 --seed 3",
    );
    let set = &list(&found["sets"])[0];
    let [same, coarse] = list(&set["settings"]) else { panic!("{set}") };
    for error in ["position", "yaw", "x", "y"] {
        for place in ["median", "p95"] {
            let zero = serde_json::json!({ "value": 0.0, "low": 0.0, "high": 0.0 });
            assert_eq!(same["fidelity"][error][place], zero, "{error}");
            assert!(number(&coarse["fidelity"][error][place]["value"]) > 0.0, "{error}");
        }
    }
    assert_eq!(same["fidelity"]["spearman"]["value"], 1.0);
    assert_eq!(same["fidelity"]["gaits"], 6);
    let halved: Vec<_> = list(&set["halved"]).iter().map(|h| h["setting"].as_str().unwrap()).collect();
    assert_eq!(halved, ["60x8", "120x4"]);
    // A start disturbed by 1e-6 has an effect, but a far smaller one than other step sizes.
    let median = |at: &Value| number(&at["fidelity"]["position"]["median"]["value"]);
    assert!(0.0 < median(&set["ceiling"]) && median(&set["ceiling"]) < 0.2 * median(coarse), "{set}");
}

#[test]
fn fidelity_ignores_threads_and_is_stored_as_printed() {
    let folder = folder();
    let arguments =
        "fidelity l-shape --settings 30x2,60x2-multibody --reference 60x4 --random 4 --evolved 0 --duration 0.5";
    let one = bench(folder.path(), arguments);
    let two = bench(folder.path(), &format!("{arguments} --threads 2 --out a/b"));
    assert_eq!(without_speed(one), without_speed(two.clone()));
    let out = folder.path().join("a/b");
    assert_eq!(listing(&out), ["fidelity.json", "fidelity.md", "frontier.png", "frontier.svg"]);
    let stored: Value = serde_json::from_str(&fs::read_to_string(out.join("fidelity.json")).unwrap()).unwrap();
    assert_eq!(stored, two);
    let page = fs::read_to_string(out.join("fidelity.md")).unwrap();
    for row in ["| 30x2 |", "| 60x2-multibody |", "| 60x8 (half", "| 120x4 (half", "| 60x4 (disturbed: the ceiling) |"]
    {
        assert!(page.contains(row), "{row}: {page}");
    }
}

#[test]
fn settings_of_both_engines_compare_with_either_reference() {
    let folder = folder();
    let arguments = "fidelity --settings 200x2-lockstep,30x8 --random 4 --evolved 0 --duration 1";
    for (reference, halved) in [("60x4", ["60x8", "120x4"]), ("200x2-lockstep", ["200x4-lockstep", "400x2-lockstep"])] {
        let found = bench(folder.path(), &format!("{arguments} --reference {reference}"));
        let set = &list(&found["sets"])[0];
        let names: Vec<_> = list(&set["halved"]).iter().map(|h| h["setting"].as_str().unwrap()).collect();
        assert_eq!((&found["reference"], names.as_slice()), (&reference.into(), halved.as_slice()));
        let off = |i: usize| number(&set["settings"][i]["fidelity"]["position"]["median"]["value"]);
        assert_eq!(off(0) == 0.0, reference == "200x2-lockstep");
        assert!(off(1) > 0.0);
    }
    let found = bench(folder.path(), "rollout --settings 200x2-lockstep,30x8 --gaits 3 --duration 0.5");
    assert_eq!(list(&found["settings"])[0]["setting"], "200x2-lockstep");
}

#[test]
fn table_rows_are_replaced_per_robot_variant() {
    let folder = folder();
    let table = folder.path().join("table.toml");
    let measure = |more: &str| {
        let arguments = "fidelity l-shape --reference 400x2-lockstep --random 6 --evolved 2 --duration 0.5";
        bench(folder.path(), &format!("{arguments} --table table.toml{more}"));
        FidelityTable::from_toml(&fs::read_to_string(&table).unwrap()).unwrap().rows
    };
    let first = measure("");
    let settings: Vec<_> = first.iter().map(|row| (row.steps_per_second, row.substeps)).collect();
    assert_eq!(settings, [(200, 2), (400, 2), (800, 2), (1600, 2)]);
    assert_eq!((first[0].robot.as_str(), first[0].variant.as_str()), ("l-shape", "none"));
    assert_eq!((first[0].random.gaits, first[0].reference.as_str()), (6, "400x2"));
    assert_eq!(measure(" --settings 200x2-lockstep").len(), 1, "the row of the same robot must be replaced");
    let both = measure(" --settings 200x2-lockstep --variant E1");
    assert_eq!(both.len(), 2);
    assert_ne!(both[0].mechanics, both[1].mechanics);
}

#[test]
fn useful_lanes_are_reported_for_lockstep() {
    let folder = folder();
    fs::write(folder.path().join("fast.toml"), format!("{SMALL_JOB}\n[physics]\nengine = \"lockstep\"\n")).unwrap();
    let found = bench(folder.path(), "evaluate fast.toml --evaluations 3");
    assert_eq!(found["engine"], "200x2-lockstep");
    assert!((0.0..=1.0).contains(&number(&found["useful_lanes"])) && number(&found["useful_lanes"]) > 0.0);
}

#[test]
fn gaits_of_stored_run_are_measured() {
    let folder = folder();
    run(folder.path(), &["run", "job.toml", "--out", "run", "--quiet"]).success();
    let found = bench(folder.path(), "fidelity --gaits run --settings 30x4 --reference 60x4 --random 2");
    let sets = list(&found["sets"]);
    let of = |i: usize| (sets[i]["gaits"].as_str().unwrap(), &sets[i]["settings"][0]["fidelity"]["gaits"]);
    assert_eq!((of(0), of(1)), (("random", &2.into()), ("evolved", &2.into())));
    assert_eq!((&found["duration"], &found["evolved"]), (&3.0.into(), &"the winner of a stored run".into()));
}

#[test]
fn time_shares_of_evaluation_sum_to_one() {
    let folder = folder();
    let found = bench(folder.path(), "evaluate job.toml --evaluations 4");
    assert_eq!(found["evaluations"], 4, "more evaluations than one generation has");
    let shares: Vec<f64> = found["shares"].as_object().unwrap().values().map(number).collect();
    assert_eq!(shares.len(), 4);
    assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-9 && shares.iter().all(|s| *s >= 0.0), "{shares:?}");
    assert_eq!(number(&found["rollouts_per_evaluation"]) * 4.0, number(&found["counts"]["rollouts"]));
}

#[test]
fn trees_grow_with_iterations() {
    let folder = folder();
    let found = bench(folder.path(), "plan job.toml --iterations 300 --candidates 2");
    let trees = list(&found["trees"]);
    let sizes: Vec<_> = trees.iter().map(|t| t["iterations"].as_u64().unwrap()).collect();
    assert_eq!(sizes, [100, 200, 300]);
    assert!(trees.windows(2).all(|w| number(&w[0]["nodes"]) <= number(&w[1]["nodes"])), "{trees:?}");
}

#[test]
fn dispatch_measures_every_load_and_slot_count() {
    let folder = folder();
    let found = bench(folder.path(), "dispatch job.toml --seed 5 --slots 1,2 --evaluations 4 --plain 1 --trivial 20");
    let lines: Vec<_> = list(&found["lines"])
        .iter()
        .map(|l| (l["load"].as_str().unwrap(), l["slots"].as_u64().unwrap(), l["evaluations"].as_u64().unwrap()))
        .collect();
    let expected =
        [("job", 1, 4), ("job", 2, 4), ("plain", 1, 1), ("plain", 2, 1), ("trivial", 1, 20), ("trivial", 2, 20)];
    assert_eq!(lines, expected);
    for line in list(&found["lines"]) {
        assert!(number(&line["seconds"]) > 0.0 && number(&line["efficiency"]) > 0.0, "{line}");
        if cfg!(target_os = "linux") {
            assert!(number(&line["peak_mib"]) > 1.0, "{line}");
        }
    }
    assert!(number(&found["direct_us"]) > 0.0);
    assert_eq!(listing(folder.path()), ["job.toml"], "no other file must remain");
}

#[test]
fn fleet_measures_every_job_count_without_leftovers() {
    let folder = folder();
    let found = bench(
        folder.path(),
        "fleet job.toml --workers 4 --slots 2 --jobs 0,1,6 --population 4 --median 0.05 --warm-up 1 --seconds 1",
    );
    let [idle, one, six] = list(&found["lines"]) else { panic!("{found}") };
    assert_eq!((&idle["evaluations"], &idle["generations"], &idle["efficiency"]), (&0.into(), &0.into(), &0.0.into()));
    for line in [one, six] {
        let (efficiency, ideal) = (number(&line["efficiency"]), number(&line["ideal"]));
        assert!(0.0 < efficiency && efficiency < ideal + 0.1 && ideal <= 1.0, "{line}");
        assert!(number(&line["evaluations"]) >= number(&line["generations"]), "{line}");
        assert!(number(&line["commits_per_s"]) > 0.0 && number(&line["changes_per_s"]) > 0.0, "{line}");
    }
    assert!(number(&one["efficiency"]) <= number(&one["fill"]) && one["fill"] == 0.5, "{one}");
    assert!(number(&six["ideal"]) > number(&one["ideal"]) && six["fill"] == 1.0, "{six}");
    assert_eq!(listing(folder.path()), ["job.toml"]);
}

#[test]
fn invalid_measurements_are_refused() {
    let folder = folder();
    let said = [
        "rollout --settings 30y8",
        "rollout --settings 7x8 --duration 0.5",
        "rollout --duration 0.01",
        "rollout --duration long",
        "rollout nosuch",
        "rollout --variant E9",
        "fidelity --random 0 --evolved 0",
        "fidelity --reference 6000x8",
        "fidelity --gaits nowhere",
        "fidelity --gaits nowhere --scale real",
        "fidelity --evolved 0 --table t.toml",
        "fidelity --table t.toml --reference 60x4",
        "fidelity --table t.toml --settings 30x8",
        "rollout --settings 200x2-lockstep-multibody",
        "evaluate nosuch",
        "evaluate job.toml --evaluations 0",
        "plan lizard-stairs",
        "dispatch job.toml --slots 0",
        "fleet job.toml --workers 9000",
        "fleet job.toml --median 4000",
        "fleet job.toml --fail often",
    ]
    .map(|arguments| {
        let seen = run(folder.path(), &["bench"].into_iter().chain(arguments.split(' ')).collect::<Vec<_>>());
        assert!(seen.code == 1 || seen.code == 2, "{arguments}");
        assert_eq!(seen.out, "", "{arguments}");
        format!("$ evogait bench {arguments}\n{}→ {}\n", seen.err, seen.code)
    });
    insta::assert_snapshot!(said.join("\n"));
}
