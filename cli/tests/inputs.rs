//! Output never replaces an input file, under any of its names.

mod common;

use common::{SMALL_JOB, run};
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

/// Returns a faster variant of the small job: gaits of 1 s, and no finish.
fn tiny_job() -> String {
    SMALL_JOB.replace("duration = 3.0", "duration = 1.0").replace("[finish]\narchive = 3", "[finish]\nkind = \"none\"")
}

/// Returns every file below a folder with its content, sorted.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let paths = common::listing(folder).into_iter().map(|name| folder.join(name)).filter(|path| path.is_file());
    paths.map(|path| (path.clone(), fs::read(&path).unwrap())).collect()
}

/// Runs a command that must fail and leave every file unchanged; returns its error text.
fn refused(folder: &Path, arguments: &[&str]) -> String {
    let before = contents(folder);
    let seen = run(folder, arguments);
    assert_eq!((seen.code, seen.out.as_str()), (1, ""), "{arguments:?}: {}", seen.err);
    assert_eq!(contents(folder), before, "{arguments:?}");
    assert!(seen.err.contains("choose another"), "{}", seen.err);
    seen.err
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("job.toml"), tiny_job()).unwrap();
    folder
}

/// Returns the resolved job, as evogait writes it.
fn resolved(folder: &Path) -> String {
    let seen = run(folder, &["validate", "job.toml", "--no-estimate", "--json"]);
    seen.json()["job_toml"].as_str().unwrap().to_owned()
}

#[test]
fn run_beside_its_job_file_is_refused() {
    let folder = folder();
    let said = refused(folder.path(), &["run", "job.toml", "--out", "."]);
    assert!(said.contains("job.toml is a file that this command reads as job.toml"), "{said}");
    symlink(".", folder.path().join("here")).unwrap();
    for out in ["./", "here", "here/./here", folder.path().to_str().unwrap()] {
        let said = refused(folder.path(), &["run", "./job.toml", "--out", out]);
        assert!(said.contains("would replace it"), "{out}: {said}");
    }
}

#[test]
fn run_into_folder_with_linked_job_is_refused() {
    let folder = folder();
    for name in ["hard", "soft", "other"] {
        fs::create_dir(folder.path().join(name)).unwrap();
    }
    fs::hard_link(folder.path().join("job.toml"), folder.path().join("hard/job.toml")).unwrap();
    symlink("../job.toml", folder.path().join("soft/job.toml")).unwrap();
    for out in ["hard", "soft"] {
        assert!(refused(folder.path(), &["run", "job.toml", "--out", out]).contains("would replace it"));
    }
    // A job with a relative path to its robot: it can't be read as a resolved job.
    fs::write(folder.path().join("other/worm.toml"), run(folder.path(), &["scenarios", "show", "lizard"]).out).unwrap();
    let job = tiny_job().replace("\"quadropod\"", "\"worm.toml\"");
    fs::write(folder.path().join("other/job.toml"), job).unwrap();
    assert!(refused(folder.path(), &["run", "other/job.toml", "--out", "other"]).contains("would replace it"));
}

#[test]
fn robot_linked_into_own_folder_is_refused() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    run(folder.path(), &["run", "job.toml", "--out", "out", "--quiet"]).success();
    let robot = run(folder.path(), &["scenarios", "show", "robots/quadropod"]).success();
    fs::write(at("robot.toml"), robot).unwrap();
    fs::write(at("mine.toml"), tiny_job().replace("\"quadropod\"", "\"robot.toml\"")).unwrap();
    fs::remove_file(at("out/map.svg")).unwrap();
    fs::remove_file(at("out/result.json")).unwrap();
    fs::hard_link(at("robot.toml"), at("out/map.svg")).unwrap();
    let said = refused(folder.path(), &["run", "mine.toml", "--out", "out"]);
    assert!(said.contains("out/map.svg is a file that this command reads as robot.toml"), "{said}");
}

#[test]
fn folder_with_foreign_job_file_is_refused() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("mine")).unwrap();
    fs::write(at("mine/job.toml"), format!("# my notes\n{}", tiny_job())).unwrap();
    let said = refused(folder.path(), &["run", "job.toml", "--out", "mine"]);
    assert!(said.contains("mine/job.toml is not a job file that evogait wrote"), "{said}");
    // A resolved job with a comment, then a resolved job beside files of the user.
    let resolved = resolved(folder.path());
    fs::write(at("mine/job.toml"), format!("{resolved}# seen\n")).unwrap();
    assert!(refused(folder.path(), &["run", "job.toml", "--out", "mine"]).contains("is not a job file"));
    fs::write(at("mine/job.toml"), &resolved).unwrap();
    for name in ["map.png", "result.json"] {
        fs::write(at("mine").join(name), "precious").unwrap();
        let said = refused(folder.path(), &["run", "job.toml", "--out", "mine"]);
        assert!(said.contains("not empty and holds no run of this job"), "{said}");
        fs::remove_file(at("mine").join(name)).unwrap();
    }
}

#[test]
fn run_in_own_folder_keeps_its_files() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let resolved = resolved(folder.path());
    fs::create_dir(at("out")).unwrap();
    fs::write(at("out/job.toml"), resolved.replace("\"small\"", "\"renamed\"")).unwrap();
    let before = fs::read(at("out/job.toml")).unwrap();
    run(folder.path(), &["run", "out/job.toml", "--out", "out", "--quiet"]).success();
    assert_eq!(fs::read(at("out/job.toml")).unwrap(), before);
    let again = run(folder.path(), &["run", "out/job.toml", "--out", "out"]);
    assert!(again.err.contains("already done"), "{}", again.err);
    // Without its result, the job is computed again.
    fs::remove_file(at("out/result.json")).unwrap();
    run(folder.path(), &["run", "out/job.toml", "--out", "out", "--quiet"]).success();
    assert_eq!(fs::read(at("out/job.toml")).unwrap(), before);
    // A copy without hidden files is still recognised as a folder of the run.
    fs::create_dir(at("copy")).unwrap();
    for name in ["job.toml", "result.json", "report.json"] {
        fs::copy(at("out").join(name), at("copy").join(name)).unwrap();
    }
    assert!(run(folder.path(), &["run", "job.toml", "--out", "copy"]).err.contains("already done"));
    // Files that a replay reads are not replaced either.
    for name in ["job.toml", "result.json", "report.json"] {
        let path = format!("out/{name}");
        assert!(refused(folder.path(), &["replay", "out", "--gait", "1", "--out", &path]).contains("would replace it"));
    }
    symlink("out/result.json", at("linked.csv")).unwrap();
    refused(folder.path(), &["replay", "out", "--plan", "--out", "linked.csv"]);
}

#[test]
fn robot_is_not_exported_or_drawn_onto_itself() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    run(folder.path(), &["robot", "lizard", "--out", "r.xml"]).success();
    let toml = run(folder.path(), &["scenarios", "show", "robots/lizard"]).success();
    fs::write(at("r.toml"), toml).unwrap();
    symlink("r.toml", at("soft.svg")).unwrap();
    fs::hard_link(at("r.toml"), at("hard.urdf")).unwrap();
    for (robot, out) in [("r.xml", "r.xml"), ("./r.xml", "r.xml"), ("r.toml", "soft.svg"), ("r.toml", "hard.urdf")] {
        assert!(refused(folder.path(), &["robot", robot, "--out", out]).contains("would replace it"), "{robot} {out}");
    }
    let said = refused(folder.path(), &["robot", "r.toml", "--format", "mjcf", "--out", "r.toml"]);
    assert!(said.starts_with("error: r.toml is a file that this command reads, and"), "{said}");
}

#[test]
fn tables_of_bench_never_replace_the_job() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("out")).unwrap();
    for (bench, name) in [("fitness", "fitness.md"), ("reuse", "reuse.json")] {
        fs::hard_link(at("job.toml"), at("out").join(name)).unwrap();
        let said = refused(folder.path(), &["bench", bench, "job.toml", "--out", "out"]);
        assert!(said.contains(&format!("out/{name} is a file that this command reads as job.toml")), "{said}");
    }
    let robot = run(folder.path(), &["scenarios", "show", "robots/quadropod"]).success();
    fs::write(at("robot.toml"), robot).unwrap();
    fs::hard_link(at("robot.toml"), at("out/frontier.svg")).unwrap();
    refused(folder.path(), &["bench", "fidelity", "robot.toml", "--out", "out"]);
}

#[test]
fn renewed_certificate_never_replaces_its_authority() {
    let folder = tempfile::tempdir().unwrap();
    run(folder.path(), &["certs", "init", "certs"]).success();
    let at = |name: &str| folder.path().join("certs").join(name);
    fs::remove_file(at("worker.pem")).unwrap();
    symlink("ca.pem", at("worker.pem")).unwrap();
    let said = refused(folder.path(), &["certs", "renew", "certs"]);
    assert!(said.contains("worker.pem is a file that this command reads as certs/ca.pem"), "{said}");
}
