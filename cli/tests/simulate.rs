//! `evogait simulate` for motions of a run and of robots: files, repeats, invalid options, verification.

mod common;

use common::{SMALL_JOB, listing, run};
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// Creates a folder with a finished run in `out`, and with plans of its gaits in `p`.
fn planned() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::write(path.join("job.toml"), SMALL_JOB).unwrap();
    run(path, &["run", "job.toml", "--out", "out", "--quiet"]).success();
    run(path, &["plan", "out", "--environment", "reuse-1", "--seeds", "3", "--out", "p", "--quiet"]).success();
    folder
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

fn rows(path: &Path) -> Vec<Vec<String>> {
    let table = fs::read_to_string(path).unwrap();
    table.lines().map(|row| row.split(',').map(str::to_owned).collect()).collect()
}

#[test]
fn simulation_has_same_bits_on_any_worker_count() {
    let folder = planned();
    let path = folder.path();
    let command =
        ["simulate", "p", "--plan", "--repeats", "6", "--friction", "0.6..1.0", "--dead-joints", "1", "--out", "s"];
    let made = run(path, &[&command[..], &["--json"]].concat());
    let printed = made.json();
    assert!(made.err.contains("simulating \"small-plans-reuse-1-plan\" in s: a plan of "), "{}", made.err);
    assert!(made.err.contains("once with nothing varied and in 6 repeats, in 2 ways"), "{}", made.err);
    assert_eq!(printed, json(&path.join("s/result.json")));
    assert_eq!((&printed["procedure"], &printed["ways"][0]["way"]), (&"simulate".into(), &"resimulated".into()));
    let found = listing(&path.join("s"));
    for name in [
        "job.toml",
        "motion-continuous.csv",
        "motion-resimulated.csv",
        "paths-continuous.png",
        "paths-resimulated.svg",
        "paths.csv",
        "result.json",
        "runs.csv",
        "simulation.json",
    ] {
        assert!(found.iter().any(|f| f == name), "{name} is missing in {found:?}");
    }
    // The statistics of the result match the rows of the table.
    let table = rows(&path.join("s/runs.csv"));
    assert_eq!(table.len(), 1 + 2 + 12);
    let column = |name: &str| table[0].iter().position(|head| head == name).unwrap();
    let of_repeats = |name: &str| {
        let rows = table.iter().filter(|row| !row[0].is_empty() && row[1] == "resimulated");
        rows.map(|row| row[column(name)].parse::<f64>().unwrap()).collect::<Vec<_>>()
    };
    let ahead = of_repeats("ahead");
    let told = &printed["ways"][0]["repeats"]["ahead"];
    assert_eq!(told["mean"].as_f64(), Some(ahead.iter().sum::<f64>() / 6.0));
    assert_eq!(told["greatest"].as_f64(), ahead.iter().copied().reduce(f64::max));
    assert!(of_repeats("friction").iter().all(|friction| (0.6..1.0).contains(friction)));
    // The run with nothing varied ends at the end of the plan. Its motion table has a row per sample.
    let last_step = rows(&path.join("p/plan.csv")).pop().unwrap();
    let unvaried = &table[1];
    for (name, planned) in [("end_x", &last_step[4]), ("end_y", &last_step[5])] {
        let (a, b): (f64, f64) = (unvaried[column(name)].parse().unwrap(), planned.parse().unwrap());
        assert!((a - b).abs() < 0.2, "{name}: {a} and {b}");
    }
    let motion = rows(&path.join("s/motion-resimulated.csv"));
    let head = &motion[0];
    assert!(
        head[0] == "time" && head.contains(&"touch_pivot".to_owned()) && motion.iter().all(|r| r.len() == head.len())
    );
    let times: Vec<f64> = motion[1..].iter().map(|row| row[0].parse().unwrap()).collect();
    assert!(times.windows(2).all(|pair| pair[0] < pair[1]), "the times of the samples must increase");

    let alone = run(path, &["run", "s/job.toml", "--out", "again", "--workers", "1", "--json"]).json();
    for field in ["job_digest", "result_digest", "ways"] {
        assert_eq!(alone[field], printed[field], "{field}");
    }
    for full in [&["verify", "s", "--json"][..], &["verify", "s", "--json", "--full"]] {
        assert_eq!(run(path, full).json()["verified"], true);
    }
    let report = fs::read_to_string(path.join("s/simulation.json")).unwrap();
    fs::write(path.join("s/simulation.json"), report.replacen("\"travelled\":", "\"travelled\":1", 1)).unwrap();
    let touched = run(path, &["verify", "s"]);
    assert!(touched.code == 1 && touched.err.contains("the motion with nothing varied differs"), "{}", touched.err);

    let summary = run(path, &command);
    assert!(summary.err.contains("already done: its result is in s"), "{}", summary.err);
    for told in ["of 6 repeats succeed", "95 % interval", "work of motors", "absolute work", "evogait verify s"] {
        assert!(summary.out.contains(told), "{told}:\n{}", summary.out);
    }
    let compared = run(path, &["compare", "p", "s"]).success();
    assert!(compared.contains("simulate.repeats") && compared.contains("0 of 6 repeats"), "{compared}");
}

#[test]
fn gaits_tables_and_robots_are_simulated() {
    let folder = planned();
    let path = folder.path();
    let gait = run(path, &["simulate", "out", "--gait", "2", "--out", "g", "--json"]).json();
    let gaits = json(&path.join("out/gaits.json"));
    // The displacement matches that of the run that evolved the gait.
    for (name, told) in [("x", "ahead"), ("y", "left"), ("yaw", "turned")] {
        let (a, b) = (&gaits["gaits"][1]["displacement"][name], &gait["ways"][0]["unvaried"][told]);
        let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
        assert!((a - b).abs() < 1e-5, "{name}: {a} and {b}");
    }
    // The run's table of the gait's targets gives nearly the same displacement: its samples are 0.05 s apart.
    let table = ["simulate", "out", "--targets", "out/trajectories/gait-2.csv", "--out", "t", "--json"];
    let of_table = run(path, &table).json();
    let ahead = |result: &serde_json::Value| result["ways"][0]["unvaried"]["ahead"].as_f64().unwrap();
    assert!((ahead(&gait) - ahead(&of_table)).abs() < 0.3, "{} and {}", ahead(&gait), ahead(&of_table));
    let stand = run(path, &["simulate", "--robot", "lizard", "--stand", "1", "--out", "st"]).success();
    assert!(stand.contains("lizard-stand: success") && stand.contains("ahead              0 mu"), "{stand}");
    let checked = run(path, &["validate", "st/job.toml"]).success();
    for told in ["motion         standing, 1.00 s", "runs           1, seed 1", "a run (mean of 1 timed here)"] {
        assert!(checked.contains(told), "{told}:\n{checked}");
    }
    // A table of targets for another robot is refused because of a missing column.
    let other = run(path, &["simulate", "--robot", "lizard", "--targets", "out/trajectories/gait-1.csv"]);
    assert_eq!(other.code, 1);
    assert!(other.err.contains("gait-1.csv: targets: line 1: there is no column for joint "), "{}", other.err);
}

#[test]
fn invalid_options_are_refused_before_simulation() {
    let folder = planned();
    let path = folder.path();
    fs::write(path.join("missing.csv"), "time,hip-front\n0,0\n1,0\n").unwrap();
    for (arguments, said) in [
        (&["simulate", "out"][..], "required arguments were not provided"),
        (&["simulate", "--gait", "1"], "required arguments were not provided"),
        (&["simulate", "out", "--gait", "3"], "simulate.steps[0] = 3 is out of range: allowed is 1 to 2"),
        (&["simulate", "out", "--gait", "1", "--plan"], "cannot be used with"),
        (&["simulate", "out", "--gait", "1", "--repeats", "5"], "simulate.repeats: nothing varies"),
        (&["simulate", "out", "--gait", "1", "--friction", "1.0..0.6"], "the range begins at 1, above its end 0.6"),
        (
            &["simulate", "out", "--gait", "1", "--friction", "high"],
            "a range is two numbers with two dots between them",
        ),
        (&["simulate", "out", "--gait", "1", "--friction", "-1"], "simulate.vary.friction[0] = -1 is out of range"),
        (&["simulate", "out", "--gait", "1", "--dead-joints", "9"], "simulate.vary.dead_joints = 9 is out of range"),
        (&["simulate", "p", "--plan", "--environment", "reuse-2"], "the plan of p is for environment \"reuse-1\""),
        (&["simulate", "p", "--plan", "--deviation", "1"], "required arguments were not provided"),
        (
            &["simulate", "out", "--plan", "--replan", "--environment", "empty"],
            "plans lead to a goal, and the environment",
        ),
        (&["simulate", "--robot", "lizard", "--gait", "1"], "--gait and --plan need a run"),
        (&["simulate", "--robot", "lizard", "--stand", "1", "--replan"], "--replan plans with the gaits of a run"),
        (&["simulate", "--robot", "mars", "--stand", "1"], "there is no file and no robot named \"mars\""),
        (
            &["simulate", "out", "--targets", "missing.csv"],
            "missing.csv: targets: line 1: there is no column for joint",
        ),
        (&["simulate", "out", "--targets", "nowhere.csv"], "can't read nowhere.csv"),
        (&["simulate", "nowhere", "--plan"], "can't read nowhere"),
        (&["simulate", "out", "--gait", "1", "--out", "p"], "p holds another job"),
    ] {
        let refused = run(path, arguments);
        assert_ne!(refused.code, 0, "{arguments:?}: {}", refused.out);
        assert!(refused.err.contains(said), "{arguments:?}: {}", refused.err);
    }
    assert!(!path.join("runs").exists(), "no run must have started");
    // A simulated run has no gaits for planning.
    run(path, &["simulate", "out", "--gait", "1", "--out", "g", "--quiet"]).success();
    let refused = run(path, &["plan", "g"]);
    assert!(refused.code == 2 && refused.err.contains("simulates a motion that is given"), "{}", refused.err);
}

#[test]
fn replan_option_replans_after_deviation() {
    let folder = planned();
    let path = folder.path();
    let near = "name = \"near\"\nsize = [20.0, 20.0]\nstart = { x = 0.0, y = 0.0 }\n\
                goal = { x = 0.3, y = 0.3, radius = 1.0 }\n";
    fs::write(path.join("near.toml"), near).unwrap();
    let there =
        run(path, &["simulate", "out", "--plan", "--replan", "--environment", "near.toml", "--out", "n", "--json"]);
    let result = there.json();
    let unvaried = &result["ways"][0]["unvaried"];
    assert_eq!(
        (&unvaried["success"], &unvaried["replans"]),
        (&true.into(), &0.into()),
        "no replanning: the start is within the radius of the goal"
    );
    assert!(result["planning"].is_string() && result["engine"].as_str().unwrap().contains("60x16"), "{result}");
    let astray =
        ["simulate", "p", "--plan", "--replan", "--deviation", "0", "--friction", "0.5..0.6", "--repeats", "2"];
    let result = run(path, &[&astray[..], &["--out", "a", "--json"]].concat()).json();
    assert!(result["ways"][0]["repeats"]["replans"]["mean"].as_f64().is_some_and(|mean| mean >= 1.0), "{result}");
}
