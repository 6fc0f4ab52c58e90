//! Upgrades: a job from an older build waits for a worker of that build. Stores of other formats are loaded or refused.

use cluster_tests::sandbox::{Process, Sandbox, output_of, tiny_job, undisturbed, value};
use cluster_tests::scripted::ScriptedWorker;
use coordinator::record::Claimant;
use coordinator::store::{SqliteStore, Store as _, Write};
use proto::v1::job_event::Event;
use proto::v1::{Job, JobState, WatchJobRequest};
use sim_core::base::digest::{Digest, ResultDigest};
use sim_core::problem::Checked;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tonic::Code;

/// Engine digest of the older build.
const OLD: Digest = Digest([7; 32]);

const GENERATIONS: u32 = 12;

/// Changes the stored job as if an older build had accepted it and run it so far.
async fn age(sandbox: &Sandbox, job: &Checked) {
    let store = SqliteStore::open(&sandbox.file("store.db")).await.expect("the store can be opened");
    let mut loaded = store.start().await.expect("an epoch can be started");
    let mut record = loaded.active.remove(0).record;
    record.engine_digest = OLD;
    record.job_digest = job.digest_on(OLD);
    record.version = "0.0.9".to_owned();
    let mut folded = ResultDigest::start(&record.job_digest);
    for round in 0..record.rounds_sealed {
        let digests =
            store.digests(&record.id, round).await.expect("the digests can be read").expect("the round is sealed");
        folded.round(round, &digests);
    }
    record.results_digest = folded.value();
    store.commit(loaded.epoch, vec![Write::Note { record }]).await.expect("the record can be written");
    store.close().await.expect("the store can be closed");
}

/// Runs a job until some of its rounds are sealed, then changes it as if an older build had run it. Returns its id.
async fn run_by_older_build(sandbox: &mut Sandbox, toml: &str) -> String {
    let job = Checked::from_toml(toml).expect("the job is valid");
    let coordinator = sandbox.coordinator();
    let worker = sandbox.worker(1);
    let id = sandbox.submit("r", toml).await.id;
    sandbox.until(&id, |job| job.rounds_sealed > 2).await;
    assert_eq!(coordinator.terminate(), Some(0));
    drop(worker);
    age(sandbox, &job).await;
    id
}

/// Asserts that the watch and `evogait show` name the build that a waiting job needs.
async fn shows_needed_build(sandbox: &Sandbox, job: &Job) {
    let request = WatchJobRequest { id: job.id.clone(), after: job.last_event - 1 };
    let mut events = sandbox.client().watch_job(request).await.expect("the watch starts").into_inner();
    let told = events.message().await.expect("the stream is open").expect("the stream has the last event").event;
    assert!(matches!(&told, Some(Event::Waits(reason)) if reason.contains("070707070707")), "{told:?}");
    let shown = sandbox.told(&["show", &job.id]);
    for part in ["waits for a worker of the build", "evogait 0.0.9 with engine 070707070707", "none of those connected"]
    {
        assert!(shown.contains(part), "missing \"{part}\" in\n{shown}");
    }
    let here = sim_core::engines::engine_digests().into_iter().map(|(_, digest)| digest.short());
    assert!(here.into_iter().all(|digest| shown.contains(&digest)), "missing digest of an offered engine in\n{shown}");
}

/// Asserts that a worker with an engine that no job needs is refused.
async fn worker_of_third_build_is_refused(sandbox: &Sandbox) {
    let refused =
        ScriptedWorker::of_another_build(sandbox, "other", Digest([8; 32])).await.err().expect("the worker is refused");
    assert_eq!(refused.code(), Code::FailedPrecondition);
    assert!(refused.message().contains("080808080808") && refused.message().contains("no active job"), "{refused}");
}

/// Asserts that the worker of the new build, which has two slots, computed the tasks of the job `beside` alone.
async fn new_worker_computed_only(sandbox: &Sandbox, beside: &str) {
    let workers = sandbox.workers().await;
    let new = workers.iter().find(|w| w.slots == 2).expect("the new worker is still connected");
    let of_beside = sandbox.job(beside).await;
    // Tasks of the other job: the preparation and one generation. Its finish takes fewer than 30 more.
    let tasks_of_beside = 1.0 + value(&of_beside, "evaluations");
    assert!(new.tasks as f64 >= tasks_of_beside, "{workers:?}");
    assert!(
        (new.tasks as f64) < tasks_of_beside + 30.0,
        "the new worker must compute no task of the old job: {workers:?}"
    );
}

// The scripted worker computes in this process.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn job_of_older_build_waits_for_its_workers() {
    let toml = tiny_job(41, GENERATIONS);
    let mut sandbox = Sandbox::new();
    let id = run_by_older_build(&mut sandbox, &toml).await;

    let coordinator = sandbox.coordinator();
    let before = sandbox.job(&id).await;
    assert!(
        before.rounds_sealed > 2 && before.rounds_sealed < GENERATIONS,
        "the job must be incomplete: {} rounds are sealed",
        before.rounds_sealed
    );
    let _new = sandbox.worker(2);
    let beside = sandbox.submit("beside", &tiny_job(42, 1)).await;
    sandbox.result(&beside.id).await;
    tokio::time::sleep(Duration::from_secs(1)).await;
    let waits = sandbox.job(&id).await;
    assert_eq!(
        (waits.state(), waits.last_event),
        (JobState::Running, before.last_event),
        "the waiting job must not progress"
    );
    shows_needed_build(&sandbox, &waits).await;
    worker_of_third_build_is_refused(&sandbox).await;

    let old = ScriptedWorker::of_another_build(&sandbox, "old", OLD)
        .await
        .expect("the worker is accepted because a job needs its engine");
    let works = tokio::spawn(old.works());
    let result = sandbox.result(&id).await;
    works.abort();
    new_worker_computed_only(&sandbox, &beside.id).await;
    assert_eq!(result.job.as_ref().map(|job| job.engine_digest.clone()), Some(OLD.0.to_vec()));
    sandbox.told(&["fetch", &id, "--out", "fetched"]);
    let file = fs::read_to_string(sandbox.file("fetched").join("result.json")).expect("the result file exists");
    assert!(file.contains(&OLD.to_string()), "the result must name the engine that computed it: {file}");
    assert_eq!(coordinator.terminate(), Some(0));

    let mut undisturbed = Sandbox::new();
    let _coordinator = undisturbed.coordinator();
    let _worker = undisturbed.worker(2);
    let same = undisturbed.submit("r", &toml).await;
    let same = undisturbed.result(&same.id).await;
    assert_eq!((result.artefacts, result.history), (same.artefacts, same.history));
}

/// Returns the path of a file in `tests/fixtures`.
fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name)
}

/// The fixture was written by the last release before jobs consisted of rounds: a job of 400 generations, one of them
/// sealed.
#[test]
fn store_of_older_format_is_refused_and_unchanged() {
    let sandbox = Sandbox::new();
    let before = fs::read(fixture("store-v3.sqlite")).expect("the fixture exists");
    fs::write(sandbox.file("store.db"), &before).expect("the fixture can be copied");
    let output = output_of(&mut sandbox.coordinator_command());
    let text = String::from_utf8(output.stderr).expect("error messages are UTF-8");
    assert_eq!(output.status.code(), Some(1), "{text}");
    assert!(text.contains("store.db") && text.contains("an older version of evogait"), "{text}");
    assert_eq!(text.lines().count(), 1, "{text}");
    assert!(fs::read(sandbox.file("store.db")).expect("the store exists") == before, "the file must not change");
}

/// Returns the jobs of the recorded store: one has ended, one is in its search.
fn recorded_jobs() -> [String; 2] {
    let cheap = |seed, generations| tiny_job(seed, generations).replace("\"rapier\"", "\"lockstep\"");
    [cheap(61, 2), cheap(62, 40)]
}

/// Records the store and the result digests again: `EVOGAIT_RECORD=1 cargo test -p cluster-tests --test upgrade
/// recorded`.
async fn record() {
    let [ended, unfinished] = recorded_jobs();
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let mut worker = sandbox.worker_command(&sandbox.url(), 1);
    let worker = Process::start(worker.args(["--grace", "0.1"]).env("EVOGAIT_FAULT", "slow@ms=20"));
    let id = sandbox.submit("ended", &ended).await.id;
    let of_ended = sandbox.result(&id).await.result_digest;
    let id = sandbox.submit("unfinished", &unfinished).await.id;
    let half_done = |job: &Job| job.rounds_sealed > 3 && job.tasks_done > 0;
    sandbox.until(&id, half_done).await;
    assert_eq!(coordinator.terminate(), Some(0));
    drop(worker);
    fs::copy(sandbox.file("store.db"), fixture("store-v4.sqlite")).expect("the fixture can be written");
    let hex = |digest: Vec<u8>| digest.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    let of_unfinished = undisturbed(&unfinished).await;
    let digests = format!("ended = \"{}\"\nunfinished = \"{}\"\n", hex(of_ended), hex(of_unfinished));
    fs::write(fixture("store-v4.toml"), digests).expect("the digests can be written");
}

#[tokio::test]
async fn recorded_store_loads_and_gives_recorded_digests() {
    if std::env::var_os("EVOGAIT_RECORD").is_some() {
        record().await;
    }
    let text = fs::read_to_string(fixture("store-v4.toml")).expect("the fixture exists");
    let digests: toml::Table = toml::from_str(&text).expect("the fixture is valid TOML");
    let mut sandbox = Sandbox::new();
    fs::copy(fixture("store-v4.sqlite"), sandbox.file("store.db")).expect("the fixture can be copied");
    let _coordinator = sandbox.coordinator();
    // Repeats the recorded requests, so no new job is created.
    let [ended, unfinished] = recorded_jobs();
    let (ended, unfinished) = (sandbox.submit("ended", &ended).await, sandbox.submit("unfinished", &unfinished).await);
    assert_eq!(ended.state(), JobState::Succeeded);
    assert!(unfinished.rounds_sealed > 3 && unfinished.ended_at_ms == 0, "{unfinished:?}");
    let _worker = sandbox.worker(2);
    for (name, id) in [("ended", ended.id), ("unfinished", unfinished.id)] {
        let result = sandbox.result(&id).await.result_digest;
        let result: String = result.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(digests[name].as_str(), Some(result.as_str()), "{name}");
    }
}

#[tokio::test]
async fn invalid_stored_result_fails_its_job() {
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let id = sandbox.submit("r", &tiny_job(63, 1)).await.id;
    assert_eq!(coordinator.terminate(), Some(0));
    let store = SqliteStore::open(&sandbox.file("store.db")).await.expect("the store can be opened");
    let loaded = store.start().await.expect("an epoch can be started");
    let job = loaded.active[0].record.id.clone();
    let ranges = vec![(0, vec![[1, 2, 3].as_slice().into()])];
    let write = Write::Results { job, round: 0, ranges, finder: Claimant::default() };
    store.commit(loaded.epoch, vec![write]).await.expect("the result can be written");
    store.close().await.expect("the store can be closed");

    let _coordinator = sandbox.coordinator();
    let job = sandbox.job(&id).await;
    assert_eq!(job.state(), JobState::Failed);
    assert!(job.reason.contains("stored results of round 0 from task 0 on are invalid"), "{}", job.reason);
}
