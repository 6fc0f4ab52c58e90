//! `evogait sequence`, robots of M-TRAN modules, and jobs that evolve motion sequences.

mod common;
#[path = "common/transcript.rs"]
mod transcript;

use common::run;
use std::fs;
use std::path::Path;
use tempfile::TempDir;
use transcript::errors;

const WALK: &str = "# Modules 1 and 2 lift their free ends.\n\
    { m [1 0] 0, 60 m [2 0] 0, 60 }\nL 2 { { m [0 0] 0, 30 c [0 1] 1 c [0 1] 2 } { m [0 0] 0, 0 c [0 1] 1 c [0 1] 2 } }\n\
    { m [1 0] 0, 0 m [2 0] 0, 0 }\n";

/// The state of Fig. 2 of Yoshida et al. 2003.
const FIGURE_2: &str = "ID 0 p(0,0,0) z(0,1,0) y(-1,0,0) (0, 0)\n\
    ID 1 p(-1,1,0) z(-1,0,0) y(0,1,0) (0, 0)\nID 2 p(-1,-1,0) z(-1,0,0) y(0,-1,0) (0, 0)\n";

fn folder(files: &[(&str, &str)]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, content) in files {
        fs::write(folder.path().join(name), content).unwrap();
    }
    folder
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn feasible_sequence_is_described_by_segment() {
    let folder = folder(&[("walk.seq", WALK), ("figure-2.mtran", FIGURE_2)]);
    let check = |robot: &str| run(folder.path(), &["sequence", "check", "walk.seq", "--robot", robot]).success();
    let shown = check("mtran-three");
    insta::assert_snapshot!(shown);
    // The initial states of the paper are the same robot.
    assert_eq!(check("figure-2.mtran").replace("mtran:", "mtran-three:"), shown);
    let view = run(folder.path(), &["sequence", "check", "walk.seq", "--robot", "mtran-three", "--json"]).json();
    assert_eq!((&view["duration"], &view["segments"][0]["duration"]), (&8.0.into(), &2.0.into()));
}

#[test]
fn infeasible_sequences_and_robots_are_refused() {
    let folder = folder(&[
        ("walk.seq", WALK),
        ("open.seq", "{ m [0 0] 30, 0"),
        ("odd.seq", "{ m [0 0] 30, 0 }\n{ m [0 0] 45, 0 }"),
        ("module.seq", "{ } { m [3 0] 30, 0 }"),
        ("pieces.seq", "{ m [0 0] 0, 30 }"),
        ("collision.seq", "{ m [1 0] -90, 60 } { m [0 1] 0, -90 }"),
        ("turned.mtran", "ID 0 p(0,0,0) z(0,1,0) y(-1,0,0) (0, 30)"),
        ("apart.mtran", "ID 0 p(0,0,0) z(0,1,0) y(-1,0,0) (0, 0)\nID 1 p(9,0,0) z(0,1,0) y(-1,0,0) (0, 0)"),
        ("text.mtran", "ID 0 p(0,0) z(0,1,0) y(-1,0,0) (0, 0)"),
    ]);
    let said = errors(
        folder.path(),
        "
        sequence check none.seq --robot mtran-three
        sequence check open.seq --robot mtran-three
        sequence check odd.seq --robot mtran-three
        sequence check module.seq --robot mtran-three
        sequence check pieces.seq --robot mtran-three
        sequence check collision.seq --robot mtran-three
        sequence check walk.seq --robot quadropod
        sequence targets walk.seq --robot quadropod
        sequence targets walk.seq --robot mtran-three --duration 0
        sequence check walk.seq --robot turned.mtran
        sequence check walk.seq --robot apart.mtran
        sequence check walk.seq --robot text.mtran
        sequence check walk.seq --robot random:mtran
        sequence check walk.seq --robot random:cosmo:3:1
        sequence check walk.seq --robot random:mtran:0:1
        sequence check walk.seq --robot random:mtran:1000:1
        robot mtran-three --format urdf
        ",
    );
    insta::assert_snapshot!(said);
}

#[test]
fn targets_of_sequence_are_simulated() {
    let folder = folder(&[("walk.seq", WALK)]);
    let of = ["walk.seq", "--robot", "mtran-three", "--duration", "6"];
    run(folder.path(), &[&["sequence", "targets"], &of[..], &["--out", "walk.csv"]].concat()).success();
    let table = fs::read_to_string(folder.path().join("walk.csv")).unwrap();
    let times: Vec<&str> = table.lines().skip(1).filter_map(|line| line.split(',').next()).collect();
    assert_eq!(times, ["0", "2", "3", "4", "5", "6"], "a row where a servo starts or stops");
    let simulate = ["simulate", "--robot", "mtran-three", "--targets", "walk.csv", "--quiet", "--out", "targets"];
    run(folder.path(), &simulate).success();
    run(folder.path(), &[&["sequence", "run"], &of[..], &["--quiet", "--out", "run"]].concat()).success();
    let digest = |out: &str| json(&folder.path().join(out).join("result.json"))["result_digest"].clone();
    assert_eq!(digest("targets"), digest("run"));
}

#[test]
fn random_robots_of_modules_can_be_written_and_read() {
    let folder = folder(&[]);
    run(folder.path(), &["robot", "random:mtran:4:7", "--out", "four.toml", "--quiet"]).success();
    let view = |robot: &str| run(folder.path(), &["robot", robot, "--json"]).json();
    assert_eq!(view("four.toml"), view("random:mtran:4:7"));
    assert_eq!(view("four.toml")["joints"].as_array().unwrap().len(), 8);
}

/// Evolves a few short sequences, on 1 and on 2 workers, and verifies the result.
#[test]
fn sequences_evolve_with_same_bits_on_any_worker_count() {
    let job = "name = \"tiny\"\nseed = 1\nrobot = \"mtran-three\"\nenvironment = \"plain\"\n\
        [gaits]\ncount = 1\nduration = 3.0\ncontroller = \"sequence\"\nsegments = [2, 4]\n[planner]\niterations = 1\n\
        [fitness]\nkind = \"travel\"\ny = 1.0\n\
        [optimiser]\nkind = \"sequence-ga\"\npopulation = 4\ngenerations = 3\nelite = 1\nranked = 1\nrandom = 2\n\
        [finish]\narchive = 2\nseeds = 2\n";
    let folder = folder(&[("job.toml", job)]);
    let evolved = |workers: &str| {
        let out = format!("out-{workers}");
        run(folder.path(), &["run", "job.toml", "--workers", workers, "--out", &out, "--quiet"]).success();
        run(folder.path(), &["verify", &out]).success();
        json(&folder.path().join(out).join("result.json"))
    };
    let (one, two) = (evolved("1"), evolved("2"));
    assert_eq!(one["result_digest"], two["result_digest"]);
    assert!(one["winner"]["fitness"].as_f64().unwrap() > 0.0);
    let program = "out-1/trajectories/gait-1.seq";
    run(folder.path(), &["sequence", "check", program, "--robot", "mtran-three"]).success();
}
