//! Errors of the commands that read or continue a finished run: other jobs, invalid options, damaged files.

mod common;
#[path = "common/transcript.rs"]
mod transcript;

use common::{SMALL_JOB, run};
use serde_json::Value;
use std::fs::{self, File};
use std::path::Path;
use tempfile::TempDir;
use transcript::{errors, without_digests, without_shipped_names};

/// Returns a faster variant of the small job: gaits of 1 s, and no finish.
fn tiny_job() -> String {
    SMALL_JOB.replace("duration = 3.0", "duration = 1.0").replace("[finish]\narchive = 3", "[finish]\nkind = \"none\"")
}

/// Creates a folder with a finished run in `out`, a plan with its gaits in `planned`, and a simulation in `moved`.
fn finished() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs::write(path.join("job.toml"), tiny_job()).unwrap();
    run(path, &["run", "job.toml", "--out", "out", "--quiet"]).success();
    run(path, &["plan", "out", "--environment", "reuse-1", "--seeds", "2", "--out", "planned", "--quiet"]).success();
    run(path, &["simulate", "out", "--gait", "1", "--out", "moved", "--quiet"]).success();
    folder
}

/// Copies a folder of a run without its subfolders.
fn copy(from: &Path, to: &Path) {
    fs::create_dir(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        if entry.path().is_file() {
            fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
        }
    }
}

/// Copies a run and changes a file of JSON in the copy.
fn changed(folder: &Path, from: &str, to: &str, file: &str, change: impl FnOnce(&mut Value)) {
    copy(&folder.join(from), &folder.join(to));
    let path = folder.join(to).join(file);
    let mut value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    change(&mut value);
    fs::write(path, value.to_string()).unwrap();
}

/// Copies a run and removes a file in the copy.
fn without(folder: &Path, from: &str, to: &str, file: &str) {
    copy(&folder.join(from), &folder.join(to));
    fs::remove_file(folder.join(to).join(file)).unwrap();
}

#[test]
fn invalid_plans_of_a_run_are_refused() {
    let folder = finished();
    changed(folder.path(), "out", "no-winner", "result.json", |result| result["winner"] = Value::Null);
    without(folder.path(), "out", "unfinished", "result.json");
    let said = errors(
        folder.path(),
        "
        plan none
        plan job.toml
        plan moved
        plan no-winner
        plan unfinished
        plan out --environment mars
        plan out --environment none.toml
        plan out --algorithm a-star
        plan out --reuse-tolerance -1
        plan out --reuse-tolerance nan
        plan out --environment reuse-1 --out out
        plan out --environment reuse-1 --out job.toml
        ",
    );
    let said = without_digests(&without_shipped_names(&said));
    insta::assert_snapshot!(said);
}

#[test]
fn invalid_simulations_of_a_run_are_refused() {
    let folder = finished();
    changed(folder.path(), "out", "no-plan", "report.json", |report| {
        report["tree"]["best_path"] = vec![report["tree"]["best_path"][0].clone()].into();
    });
    let said = errors(
        folder.path(),
        "
        simulate none --plan
        simulate moved --gait 1
        simulate no-plan --plan
        simulate planned --plan --environment reuse-2
        simulate out --plan --replan --environment empty
        simulate planned --plan --replan --deviation -1
        simulate out --gait 3
        simulate out --stand 1000
        simulate out --targets none.csv
        simulate out --gait 1 --environment mars
        simulate out --gait 1 --repeats 5
        simulate out --gait 1 --friction -1
        simulate out --gait 1 --motor-strength 100
        simulate out --gait 1 --x -10001
        simulate out --gait 1 --yaw 4
        simulate out --gait 1 --dead-joints 9
        simulate out --gait 1 --target-noise -1
        simulate out --gait 1 --out planned
        ",
    );
    let said = without_digests(&without_shipped_names(&said));
    insta::assert_snapshot!(said);
}

#[test]
fn folders_of_others_are_refused_for_output() {
    let folder = finished();
    let at = |name: &str| folder.path().join(name);
    for name in ["notes", "foreign", "busy"] {
        fs::create_dir(at(name)).unwrap();
    }
    fs::write(at("notes/thesis.tex"), "").unwrap();
    fs::write(at("foreign/job.toml"), format!("# my notes\n{}", tiny_job())).unwrap();
    fs::write(at("robot.toml"), run(folder.path(), &["scenarios", "show", "robots/lizard"]).success()).unwrap();
    without(folder.path(), "out", "damaged", "result.json");
    fs::write(at("damaged/job.toml"), "seed = one\n").unwrap();
    let lock = File::create(at("busy/.lock")).unwrap();
    lock.lock().unwrap();
    let said = errors(
        folder.path(),
        "
        run job.toml --out .
        run job.toml --out job.toml
        run job.toml --out job.toml/out
        run job.toml --out notes
        run job.toml --out foreign
        run job.toml --out planned
        run job.toml --out damaged
        run job.toml --out busy
        run job.toml --seed 2 --out out
        run out/job.toml --seed 2 --out out
        robot robot.toml --out robot.toml
        replay out --gait 1 --out out/report.json
        replay out --gait 1 --out none/gait.csv
        compare out out --out none/curves.svg
        ",
    );
    let said = without_digests(&said);
    insta::assert_snapshot!(said);
}

#[test]
fn changed_or_damaged_runs_are_reported() {
    let folder = finished();
    let path = folder.path();
    let result: Value = serde_json::from_str(&fs::read_to_string(path.join("out/result.json")).unwrap()).unwrap();
    let score = result["winner"]["fitness"].to_string();
    for (name, file) in [
        ("unfinished", "result.json"),
        ("no-job", "job.toml"),
        ("no-report", "report.json"),
        ("no-curve", "history.csv"),
    ] {
        without(path, "out", name, file);
    }
    for (name, file, content) in [
        ("broken", "result.json", "{"),
        ("old-job", "job.toml", "name = \"small\"\n"),
        ("curve", "history.csv", "generation,min\n0,low\n"),
    ] {
        copy(&path.join("out"), &path.join(name));
        fs::write(path.join(name).join(file), content).unwrap();
    }
    let zeros = || Value::from("0".repeat(64));
    changed(path, "out", "no-winner", "result.json", |result| result["winner"] = Value::Null);
    changed(path, "out", "score", "result.json", |result| result["winner"]["fitness"] = 1.5.into());
    changed(path, "out", "digest", "result.json", |result| result["job_digest"] = zeros());
    changed(path, "out", "engine", "result.json", |result| {
        (result["winner"]["fitness"], result["engine_digest"]) = (1.5.into(), zeros());
    });
    changed(path, "out", "short", "result.json", |result| {
        result["winner"]["genome"].as_array_mut().unwrap().pop();
    });
    changed(path, "planned", "tree", "plans.json", |plans| plans["best"] = 9.into());
    changed(path, "moved", "shifted", "simulation.json", |report| report["unvaried"] = Value::Array(Vec::new()));
    without(path, "planned", "half-plan", "plans.json");
    without(path, "moved", "half-motion", "simulation.json");
    let said = errors(
        path,
        "
        verify none
        verify job.toml
        verify unfinished
        verify no-job
        verify no-report
        verify broken
        verify old-job
        verify no-winner
        verify short
        verify score --quiet
        verify digest --quiet
        verify engine --quiet
        verify tree --quiet
        verify shifted --quiet
        verify half-plan
        verify half-motion
        replay out --gait 3
        replay planned --plan
        replay moved --gait 1
        replay no-winner --plan
        compare out none
        compare out no-curve --out curves.svg
        compare out curve --out curves.svg
        compare out planned --out curves.svg
        compare out moved --out curves.svg
        ",
    );
    let said = said.replace(&score, "SCORE").replace(env!("CARGO_PKG_VERSION"), "VERSION");
    let said = without_digests(&said);
    insta::assert_snapshot!(said);
}

#[test]
fn curves_of_different_scores_are_refused() {
    let folder = finished();
    let job = tiny_job().replace("\"empty\"", "\"reuse-1\"").replace("\"coverage\"\ncell = 0.5", "\"path-length\"");
    fs::write(folder.path().join("other.toml"), job).unwrap();
    run(folder.path(), &["run", "other.toml", "--out", "other", "--quiet"]).success();
    let said = errors(folder.path(), "compare out other --out curves.svg");
    insta::assert_snapshot!(said);
}

#[test]
fn runs_without_store_or_winner_are_refused() {
    let folder = finished();
    let path = folder.path();
    fs::write(path.join("other.toml"), tiny_job().replace("iterations = 4", "iterations = 5")).unwrap();
    run(path, &["run", "other.toml", "--out", "other", "--quiet"]).success();
    without(path, "out", "fetched", "store.sqlite");
    without(path, "out", "foreign", "store.sqlite");
    fs::write(path.join("foreign/store.sqlite"), "no store").unwrap();
    changed(path, "out", "no-winner", "result.json", |result| result["winner"] = Value::Null);
    let said = errors(
        path,
        "
        bench reuse --run none
        bench reuse --run planned
        bench reuse --run fetched
        bench reuse --run foreign
        bench fitness --runs out,moved
        bench fitness --runs out,other
        bench fitness --runs fetched
        bench fidelity --gaits none
        bench fidelity --gaits no-winner
        ",
    );
    insta::assert_snapshot!(said);
}

#[test]
fn gaits_of_another_robot_are_refused() {
    let folder = finished();
    let path = folder.path();
    let job = |robot: &str, controller: &str, gaits: &str| {
        format!(
            "name = \"p\"\nprocedure = \"plan\"\nrobot = \"{robot}\"\nenvironment = \"reuse-1\"\n\
             gaits = {{ count = 2, duration = 1.0, controller = \"{controller}\" }}\nplanner = {{ iterations = 3 }}\n\
             [plan]\nseeds = 2\ngaits = \"{gaits}\"\n"
        )
    };
    let gaits = fs::read_to_string(path.join("out/gaits.json")).unwrap();
    let mut few: Value = serde_json::from_str(&gaits).unwrap();
    few["gaits"][0]["parameters"].as_object_mut().unwrap().clear();
    fs::write(path.join("few.json"), few.to_string()).unwrap();
    fs::write(path.join("broken.json"), "{").unwrap();
    for (name, robot, controller, gaits) in [
        ("none", "quadropod", "hopf", "none"),
        ("broken", "quadropod", "hopf", "broken.json"),
        ("few", "quadropod", "hopf", "few.json"),
        ("lizard", "lizard", "hopf", "out"),
        ("sine", "quadropod", "sine", "out/gaits.json"),
    ] {
        fs::write(path.join(format!("{name}.toml")), job(robot, controller, gaits)).unwrap();
    }
    let said = errors(
        path,
        "
        validate none.toml
        validate broken.toml
        validate few.toml
        validate lizard.toml
        validate sine.toml
        ",
    );
    insta::assert_snapshot!(said);
}

/// Faults are built into debug builds only.
#[cfg(debug_assertions)]
#[test]
fn repeated_panic_of_task_names_next_command() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("job.toml"), tiny_job()).unwrap();
    let failed = |fault: &str, out: &str| {
        let mut command = common::evogait(folder.path(), &["run", "job.toml", "--out", out, "--quiet"]);
        let output = command.env("EVOGAIT_FAULT", fault).output().unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        let error = text.find("error: ").map_or("", |at| &text[at..]);
        assert_eq!(output.status.code(), Some(1), "{text}");
        // The numbers of the candidate are results of the physics.
        let said = error.split("--genome=").next().unwrap_or_default().trim_end();
        format!("$ EVOGAIT_FAULT={fault} evogait run job.toml --out {out}\n{said}\n")
    };
    let said = [failed("panic@round=0", "preparation"), failed("panic@round=1,index=2", "search")].join("\n");
    let said = without_digests(&said);
    insta::assert_snapshot!(said);
}

/// A limit on the size of files simulates a disk without room for the store.
#[cfg(target_os = "linux")]
#[test]
fn run_without_room_for_its_store_fails() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("job.toml"), tiny_job()).unwrap();
    let script =
        format!("trap '' XFSZ; ulimit -f 20; exec '{}' run job.toml --out out --quiet", env!("CARGO_BIN_EXE_evogait"));
    let mut limited = std::process::Command::new("sh");
    let seen = common::Seen::of(limited.args(["-c", &script]).current_dir(folder.path()).output().unwrap());
    assert_eq!((seen.code, seen.out.as_str()), (1, ""), "{}", seen.err);
    let said = seen.err;
    insta::assert_snapshot!(said);
}
