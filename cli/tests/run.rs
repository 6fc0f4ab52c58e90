//! Whole jobs with `evogait run`: results, resuming, verification, replay; and jobs on a separate coordinator.

mod common;

use common::{SMALL_JOB, Seen, evogait, listing, run};
use std::fs;
use std::path::Path;
use std::process::Stdio;
use tempfile::TempDir;

fn folder(job: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("job.toml"), job).unwrap();
    folder
}

fn result(folder: &Path) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(folder.join("result.json")).unwrap()).unwrap()
}

const RESULT_FILES: [&str; 16] = [
    "archive.csv",
    "audits.csv",
    "convergence.png",
    "convergence.svg",
    "gaits.json",
    "gaits.png",
    "gaits.svg",
    "history.csv",
    "job.toml",
    "map.png",
    "map.svg",
    "primitives.png",
    "primitives.svg",
    "report.json",
    "result.json",
    "tree.json",
];

fn assert_complete(folder: &Path) {
    let found = listing(folder);
    for name in RESULT_FILES.iter().chain(&["trajectories/gait-1.csv", "trajectories/gait-2.csv"]) {
        assert!(found.iter().any(|f| f == name), "{name} is missing in {found:?}");
    }
    assert!(!found.iter().any(|f| f.ends_with(".tmp")), "{found:?}");
}

#[test]
fn run_writes_its_files_and_is_not_repeated() {
    let folder = folder(SMALL_JOB);
    let path = folder.path();
    let first = run(path, &["run", "job.toml", "--out", "out", "--json"]);
    let out = path.join("out");
    let printed = first.json();
    assert_complete(&out);
    assert_eq!(printed, result(&out));
    assert_eq!(printed["counts"]["evaluations"], 6);
    assert_eq!(printed["winner"]["fresh"].as_array().unwrap().len(), 20);
    let history = fs::read_to_string(out.join("history.csv")).unwrap();
    assert_eq!(history.lines().count(), 1 + 2, "a head and two generations:\n{history}");
    let best: f64 = history.lines().last().unwrap().split(',').nth(7).unwrap().parse().unwrap();
    assert_eq!(Some(best), printed["best_fitness"].as_f64());

    // The published winner is the best of the archive on the reference setting. Every new best was audited.
    let archive = fs::read_to_string(out.join("archive.csv")).unwrap();
    let rows: Vec<Vec<&str>> = archive.lines().skip(1).map(|line| line.split(',').collect()).collect();
    let of = |what: &str| printed["winner"][what].to_string();
    assert_eq!(rows[0][1..3], [of("generation"), of("candidate")]);
    let reference: Vec<f64> = rows.iter().map(|row| row[4].parse().unwrap()).collect();
    assert!(reference.len() == 3 && reference.is_sorted_by(|a, b| a >= b), "{archive}");
    assert_eq!(printed["winner"]["reference"], reference[0]);
    assert!(printed["first"]["reference"].is_f64() && printed["first"]["without_reuse"].is_f64());
    assert!(printed["winner"]["less_friction"].is_f64() && printed["winner"]["more_friction"].is_f64());
    let audits = printed["audits"]["bests"].as_array().unwrap();
    assert_eq!(audits.last().unwrap()["with_reuse"], printed["best_fitness"]);
    for audit in audits {
        let [with, without, gap] = ["with_reuse", "without_reuse", "gap"].map(|f| audit[f].as_f64().unwrap());
        assert_eq!(with - without, gap);
    }
    let summary = run(path, &["run", "job.toml", "--out", "out"]).success();
    for told in
        ["reference", "20 fresh seeds", "without reuse", "friction ± 10 %", "best of 3 on the reference", "audit"]
    {
        assert!(summary.contains(told), "{told}:\n{summary}");
    }

    let second = run(path, &["run", "job.toml", "--out", "out", "--json"]);
    assert!(second.err.contains("already done: its result is in out"), "{}", second.err);
    assert_eq!(second.json(), printed);

    // Neither the number of workers nor the use of the resolved job changes a bit.
    let alone = run(path, &["run", "out/job.toml", "--out", "alone", "--workers", "1", "--json"]).json();
    for field in ["job_digest", "result_digest", "winner", "first"] {
        assert_eq!(alone[field], printed[field], "{field}");
    }

    // The folder is refused to another job.
    let other = run(path, &["run", "job.toml", "--seed", "2", "--out", "out"]);
    let digest = &printed["job_digest"].as_str().unwrap()[..12];
    let said = format!("error: out holds another job, \"small\" ({digest}): choose another folder with --out\n");
    assert_eq!((other.code, other.err), (1, said));
    assert_eq!(result(&out), printed);
}

#[test]
fn changed_result_fails_verification() {
    let folder = folder(SMALL_JOB);
    let path = folder.path();
    run(path, &["run", "job.toml", "--out", "out", "--quiet"]).success();
    let verified = run(path, &["verify", "out", "--json"]).json();
    assert_eq!(verified["verified"], true);
    run(path, &["verify", "out/result.json", "--full"]).success();

    let gait = run(path, &["replay", "out", "--gait", "2", "--out", "gait.csv"]).success();
    assert!(gait.contains("the same bits as stored"), "{gait}");
    let stored = fs::read_to_string(path.join("out/trajectories/gait-2.csv")).unwrap();
    assert_eq!(fs::read_to_string(path.join("gait.csv")).unwrap(), stored);
    let plan = run(path, &["replay", "out", "--plan"]).success();
    assert!(plan.contains("the same bits as stored"), "{plan}");
    let beyond = run(path, &["replay", "out", "--gait", "3"]);
    assert_eq!(beyond.err, "error: --gait 3 is out of range: out has gaits 1 to 2\n");
    assert_eq!(beyond.code, 2);

    // A wrong score, one bit above the computed one.
    let mut touched = result(&path.join("out"));
    let fitness = touched["winner"]["fitness"].as_f64().unwrap();
    touched["winner"]["fitness"] = fitness.next_up().into();
    fs::write(path.join("out/result.json"), touched.to_string()).unwrap();
    let refused = run(path, &["verify", "out"]);
    assert_eq!(refused.code, 1);
    let expected = format!("stored is {}, recomputed {fitness}", fitness.next_up());
    assert!(refused.err.contains("the winner's score differs") && refused.err.contains(&expected), "{}", refused.err);

    fs::write(path.join("out/result.json"), "{").unwrap();
    let damaged = run(path, &["verify", "out"]);
    assert_eq!(damaged.code, 1);
    assert!(damaged.err.starts_with("error: out/result.json is damaged: "), "{}", damaged.err);
}

#[test]
fn search_without_finish_publishes_its_best() {
    let folder = folder(&SMALL_JOB.replace("archive = 3", "kind = \"none\""));
    let path = folder.path();
    let result = run(path, &["run", "job.toml", "--out", "out", "--json"]).json();
    assert_eq!(result["winner"]["fitness"], result["best_fitness"]);
    assert!(result["winner"]["reference"].is_null() && result["audits"].is_null());
    assert_eq!(result["winner"]["fresh"].as_array().unwrap().len(), 20);
    assert!(result["winner"]["without_reuse"].is_f64());
    assert!(!path.join("out/archive.csv").exists() && !path.join("out/audits.csv").exists());
    run(path, &["verify", "out", "--full"]).success();
}

#[cfg(unix)]
#[test]
fn interrupted_run_resumes_with_same_command() {
    use std::io::{BufRead as _, BufReader};

    let long = SMALL_JOB.replace("generations = 2", "generations = 12");
    let folder = folder(&long);
    let path = folder.path();
    let whole = run(path, &["run", "job.toml", "--out", "whole", "--json"]).json();

    let mut child = evogait(path, &["run", "job.toml", "--out", "out"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    // Waits until the first generation is sealed.
    lines
        .by_ref()
        .map(Result::unwrap)
        .find(|line| line.starts_with("gen 1/12"))
        .expect("no line of progress for generation 1");
    let busy = run(path, &["run", "job.toml", "--out", "out"]);
    assert_eq!(busy.err, "error: another evogait process uses out: wait until it ends, or stop it\n");
    let id = child.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let rest: Vec<String> = lines.map(Result::unwrap).collect();
    let said = rest.join("\n");
    assert_eq!(child.wait().unwrap().code(), Some(130), "{said}");
    assert!(said.contains("error: interrupted after "), "{said}");
    assert!(said.contains("the same command continues from there"), "{said}");
    assert!(!path.join("out/result.json").exists());
    let unfinished = run(path, &["verify", "out"]);
    assert_eq!((unfinished.code, unfinished.err.contains("has no result yet")), (1, true), "{}", unfinished.err);

    let resumed = run(path, &["run", "job.toml", "--out", "out", "--json"]);
    assert!(resumed.err.contains("continuing \"small\""), "{}", resumed.err);
    let resumed = resumed.json();
    for field in ["job_digest", "result_digest", "winner", "first"] {
        assert_eq!(resumed[field], whole[field], "{field}");
    }
    assert_complete(&path.join("out"));
}

/// Coordinator with a worker, in this process.
struct Cluster {
    url: String,
    runtime: tokio::runtime::Runtime,
    coordinator: Option<coordinator::Running>,
}

impl Cluster {
    fn start(slots: usize) -> Self {
        let runtime = tokio::runtime::Runtime::new().unwrap();
        let metrics = Some(telemetry::Bind { addr: ([127, 0, 0, 1], 0).into(), beyond_loopback: false });
        let config = coordinator::Config { metrics, ..coordinator::Config::embedded(coordinator::StoreUrl::Memory) };
        let coordinator = runtime.block_on(coordinator::serve(config)).unwrap();
        let url = format!("http://{}", coordinator.local_addr());
        if slots > 0 {
            let config = worker::Config { name: "test".to_owned(), ..worker::Config::new(url.clone(), slots) };
            runtime.spawn(worker::run(config, std::future::pending()));
        }
        Self { url, runtime, coordinator: Some(coordinator) }
    }

    fn run(&self, folder: &Path, arguments: &[&str]) -> Seen {
        let output = evogait(folder, arguments).env("EVOGAIT_COORDINATOR", &self.url).output().unwrap();
        Seen::of(output)
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        if let Some(coordinator) = self.coordinator.take() {
            self.runtime.block_on(coordinator.shutdown()).unwrap();
        }
    }
}

#[test]
fn coordinator_and_local_run_give_same_bits() {
    let folder = folder(SMALL_JOB);
    let path = folder.path();
    let cluster = Cluster::start(2);
    let submitted = cluster.run(path, &["submit", "job.toml", "--priority", "20"]).success();
    let id = submitted.trim();
    assert_eq!(
        cluster.run(path, &["submit", "job.toml", "--priority", "20"]).success().trim(),
        id,
        "the same job must keep its id"
    );

    let watched = cluster.run(path, &["watch", id, "--json"]).success();
    let events: Vec<serde_json::Value> = watched.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let sealed = events.iter().filter(|e| e["event"] == "generation").count();
    assert_eq!((sealed, events.last().unwrap()["state"].as_str()), (2, Some("succeeded")));
    assert!(cluster.run(path, &["watch", id]).success().contains(&format!("evogait fetch {id}")));

    let listed = cluster.run(path, &["list", "--json", "--state", "succeeded"]).json();
    assert_eq!(listed[0]["id"], id);
    assert_eq!(cluster.run(path, &["list", "--json", "--state", "queued"]).json(), serde_json::json!([]));
    let shown = cluster.run(path, &["show", id, "--json"]).json();
    assert_eq!((&shown["priority"], &shown["evaluations"]), (&20.into(), &6.into()));
    assert!(cluster.run(path, &["show", id]).success().contains("succeeded"));
    assert!(cluster.run(path, &["list"]).success().contains(id));
    assert_eq!(cluster.run(path, &["workers", "--json"]).json()[0]["name"], "test");
    assert!(cluster.run(path, &["workers"]).success().contains("test"));

    let fetched = cluster.run(path, &["fetch", id, "--out", "fetched", "--json"]).json();
    assert_complete(&path.join("fetched"));
    run(path, &["verify", "fetched"]).success();
    let remote = run(path, &["run", "job.toml", "--coordinator", &cluster.url, "--out", "remote", "--json"]);
    let here = run(path, &["run", "job.toml", "--out", "here", "--json"]).json();
    for field in ["job_digest", "result_digest", "winner", "first"] {
        assert_eq!(fetched[field], here[field], "{field}");
    }
    // The coordinator already has the job with another priority, which does not make it another job.
    assert_eq!(remote.json()["result_digest"], here["result_digest"]);
}

#[test]
fn coordinator_health_is_reported_by_exit_code() {
    let folder = tempfile::tempdir().unwrap();
    let mut cluster = Cluster::start(0);
    let process = cluster.coordinator.as_ref().unwrap().metrics_addr().unwrap().to_string();
    assert_eq!(run(folder.path(), &["health", "--process", &process]).success(), "active\n");
    let by_name = process.replace("127.0.0.1", "localhost");
    assert_eq!(run(folder.path(), &["health", "--process", &by_name]).success(), "active\n");
    let other = run(folder.path(), &["health", "--process", cluster.url.strip_prefix("http://").unwrap()]);
    assert_eq!((other.code, other.err.contains("is not healthy: ")), (1, true), "{}", other.err);
    assert_eq!(cluster.run(folder.path(), &["health"]).success(), "serving\n");
    assert_eq!(cluster.run(folder.path(), &["health", "--alive", "--quiet"]).success(), "");
    let says = serde_json::json!({"well": true, "says": "serving"});
    assert_eq!(cluster.run(folder.path(), &["health", "--json"]).json(), says);
    cluster.runtime.block_on(cluster.coordinator.take().unwrap().shutdown()).unwrap();
    let gone = cluster.run(folder.path(), &["health", "--alive"]);
    assert_eq!((gone.code, gone.err.contains("can't reach a coordinator")), (1, true), "{}", gone.err);
}

#[test]
fn cancelled_job_can_be_submitted_again() {
    let folder = folder(SMALL_JOB);
    let path = folder.path();
    let cluster = Cluster::start(0);
    assert!(cluster.run(path, &["workers"]).success().contains("no workers"));
    assert_eq!(cluster.run(path, &["demand"]).success(), "0 slots wanted, 0 connected, 0 busy\n");
    let id = cluster.run(path, &["submit", "job.toml"]).success().trim().to_owned();
    assert_ne!(cluster.run(path, &["demand", "--json"]).json()["wanted"], 0);
    let early = cluster.run(path, &["fetch", &id, "--out", "out"]);
    assert_eq!(early.code, 1);
    assert!(early.err.contains("has not ended"), "{}", early.err);
    assert!(cluster.run(path, &["cancel", &id]).success().contains("is cancelled"));
    let watched = cluster.run(path, &["watch", &id]);
    assert_eq!(watched.code, 1);
    assert!(watched.err.contains(&format!("job \"small\" ({id}) was cancelled")), "{}", watched.err);
    let fetched = cluster.run(path, &["fetch", &id, "--out", "out"]);
    assert_eq!(fetched.code, 1);
    assert!(!path.join("out").exists());

    assert_eq!(cluster.run(path, &["submit", "job.toml"]).success().trim(), id);
    let again = cluster.run(path, &["submit", "job.toml", "--again"]).success();
    assert_ne!(again.trim(), id);
    let unknown = cluster.run(path, &["show", "no-such-job"]);
    let said = format!(
        "error: the coordinator at {} has no job \"no-such-job\": `evogait list` lists its jobs\n",
        cluster.url
    );
    assert_eq!((unknown.code, unknown.err), (1, said));
}

/// Returns a job with cells so large that the robot never leaves its first one: every candidate scores 0.
fn useless_job() -> String {
    let environment = "[environment]\nname = \"wide\"\nsize = [40.0, 40.0]\nstart = { x = 0.5, y = 0.5 }\n";
    let job = SMALL_JOB.replace("environment = \"empty\"\n", "").replace("cell = 0.5", "cell = 20.0");
    format!("{}\n{environment}", job.replace("duration = 3.0", "duration = 0.5"))
}

#[test]
fn run_with_equal_scores_warns_once() {
    let folder = folder(&useless_job());
    let warned = |seen: &common::Seen| seen.err.matches("warning: all 3 candidates").count();
    let cold = run(folder.path(), &["run", "job.toml", "--out", "out"]);
    assert_eq!((cold.code, warned(&cold)), (0, 1), "{}", cold.err);
    assert!(cold.err.contains("score the same, 0 %") && cold.err.contains("a cell 20.00 mu wide"), "{}", cold.err);
    // A resumed run warns, too: its search has ended, and the result is in the store.
    fs::remove_file(folder.path().join("out/result.json")).unwrap();
    let resumed = run(folder.path(), &["run", "job.toml", "--out", "out"]);
    assert!(resumed.err.contains("continuing"), "{}", resumed.err);
    assert_eq!((resumed.code, warned(&resumed)), (0, 1), "{}", resumed.err);
    let quiet = run(folder.path(), &["run", "job.toml", "--out", "quiet", "--quiet"]);
    assert_eq!((quiet.code, quiet.err.as_str()), (0, ""));
}

#[test]
fn validate_warns_about_equal_scores() {
    let folder = folder(&useless_job());
    let warnings = |arguments: &[&str]| run(folder.path(), arguments).json()["warnings"].as_array().unwrap().clone();
    let found = warnings(&["validate", "job.toml", "--json"]);
    assert!(found.len() == 1 && found[0].as_str().unwrap().contains("score the same, 0 %"), "{found:?}");
    assert!(warnings(&["validate", "job.toml", "--json", "--no-estimate"]).is_empty());
    let text = run(folder.path(), &["validate", "job.toml"]).success();
    assert!(text.contains("  warning        all 3 candidates"), "{text}");
    assert!(warnings(&["validate", "quadropod-empty", "--json"]).is_empty());
}

#[test]
fn run_uses_coordinator_of_environment_variable() {
    let folder = folder(SMALL_JOB);
    let path = folder.path();
    let cluster = Cluster::start(2);
    let there = cluster.run(path, &["run", "job.toml", "--out", "there"]);
    assert!(there.err.contains("from EVOGAIT_COORDINATOR; to run on this machine add --workers N"), "{}", there.err);
    assert!(!path.join("there/store.sqlite").exists());
    assert_eq!(cluster.run(path, &["list", "--json"]).json().as_array().unwrap().len(), 1);
    there.success();
    let here = cluster.run(path, &["run", "job.toml", "--out", "here", "--workers", "1"]);
    assert!(!here.err.contains("EVOGAIT_COORDINATOR") && path.join("here/store.sqlite").exists(), "{}", here.err);
    // An empty variable counts as unset. An empty option is an error.
    let unset =
        evogait(path, &["run", "job.toml", "--out", "unset", "-q"]).env("EVOGAIT_COORDINATOR", "").output().unwrap();
    assert!(unset.status.success() && path.join("unset/store.sqlite").exists());
    for command in [&["run", "job.toml", "--coordinator", ""][..], &["list", "--coordinator="]] {
        let seen = cluster.run(path, command);
        assert_eq!((seen.code, seen.err.contains("--coordinator is empty: give a URL")), (2, true), "{}", seen.err);
    }
}

/// Starts a run through a command (such as `nohup`) and waits for its first generation.
fn started(path: &Path, through: &[&str]) -> std::process::Child {
    use std::io::{BufRead as _, BufReader};
    let run = [env!("CARGO_BIN_EXE_evogait"), "run", "job.toml", "--out", "out"];
    let all: Vec<&str> = through.iter().copied().chain(run).collect();
    let mut command = std::process::Command::new(all[0]);
    command.args(&all[1..]).current_dir(path).env_remove("EVOGAIT_COORDINATOR").stdin(Stdio::null());
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let stderr = child.stderr.as_mut().unwrap();
    let mut lines = BufReader::with_capacity(1, stderr).lines().map(Result::unwrap);
    lines.find(|line| line.starts_with("gen 1/")).expect("no line of progress for generation 1");
    child
}

#[test]
fn hangup_interrupts_run_unless_ignored() {
    let folder = folder(&SMALL_JOB.replace("generations = 2", "generations = 12"));
    let path = folder.path();
    let hang_up = |child: &std::process::Child| {
        let id = child.id().to_string();
        assert!(std::process::Command::new("kill").args(["-HUP", &id]).status().unwrap().success());
    };
    let child = started(path, &[]);
    hang_up(&child);
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(130), "{said}");
    assert!(
        said.contains("error: interrupted after ") && said.contains("the same command continues from there"),
        "{said}"
    );

    fs::remove_dir_all(path.join("out")).unwrap();
    let child = started(path, &["nohup"]);
    hang_up(&child);
    assert!(child.wait_with_output().unwrap().status.success());
}

#[test]
fn printed_commands_are_quoted_for_the_shell() {
    let folder = folder(SMALL_JOB);
    let out = "my runs/it's";
    let said = run(folder.path(), &["run", "job.toml", "--out", out]).success();
    let printed = said
        .lines()
        .find_map(|line| line.trim().strip_prefix("evogait verify "))
        .expect("no next command in the summary");
    let command = format!("{} verify {printed}", env!("CARGO_BIN_EXE_evogait"));
    let shell = std::process::Command::new("sh").args(["-c", &command]).current_dir(folder.path()).output().unwrap();
    let verified = Seen::of(shell).success();
    let full = verified
        .lines()
        .find_map(|line| line.trim().strip_prefix("next: evogait verify "))
        .expect("no next command in the output of verify");
    assert!(full.starts_with(r"'my runs/it'\''s' --full"), "{full}");
}
