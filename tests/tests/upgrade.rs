//! An upgrade in mid-job: a job that an older build took in is kept, waits for a worker of that build, and says so.

use cluster_tests::sandbox::{Sandbox, tiny_job};
use cluster_tests::scripted::Scripted;
use coordinator::store::{SqliteStore, Store as _, Write};
use proto::v1::job_event::Event;
use proto::v1::{JobState, ListWorkersRequest, WatchJobRequest};
use sim_core::base::digest::{Digest, ResultDigest};
use sim_core::problem::Job;
use std::time::Duration;
use tonic::Code;

/// The engine of the older build.
const OLD: Digest = Digest([7; 32]);

const GENERATIONS: u32 = 12;

/// Makes the stored job one that an older build took in, as if that one had run it so far.
async fn age(sandbox: &Sandbox, job: &Job) {
    let store = SqliteStore::open(&sandbox.file("store.db")).await.expect("nobody has it open");
    let mut loaded = store.start().await.expect("an epoch");
    let mut record = loaded.active.remove(0).record;
    record.engine_digest = OLD;
    record.job_digest = job.digest_on(OLD);
    record.version = "0.0.9".to_owned();
    record.scores_digest = ResultDigest::start(&record.job_digest);
    for generation in 0..record.generations_done {
        let scores = store.scores(&record.id, generation).await.expect("it can be read").expect("it is sealed");
        record.scores_digest.generation(generation, &scores);
    }
    store.commit(loaded.epoch, vec![Write::Note { record }]).await.expect("it is written");
    store.close().await.expect("it closes");
}

// The worker that the test plays computes here.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_job_goes_on_with_workers_of_the_build_that_took_it_in_and_with_no_others() {
    let toml = tiny_job(41, GENERATIONS);
    let job = Job::from_toml(&toml).expect("a valid job");
    let mut sandbox = Sandbox::new();
    let coordinator = sandbox.coordinator();
    let worker = sandbox.worker(1);
    let id = sandbox.submit("r", &toml).await.id;
    sandbox.until(&id, |job| job.generations_done >= 2).await;
    assert_eq!(coordinator.terminate(), Some(0));
    drop(worker);
    age(&sandbox, &job).await;

    let coordinator = sandbox.coordinator();
    let before = sandbox.job(&id).await;
    assert!(
        before.generations_done >= 2 && before.generations_done < GENERATIONS,
        "in mid-job: {}",
        before.generations_done
    );
    let _new = sandbox.worker(2);
    let beside = sandbox.submit("beside", &tiny_job(42, 1)).await;
    sandbox.result(&beside.id).await;
    tokio::time::sleep(Duration::from_secs(1)).await;
    let waits = sandbox.job(&id).await;
    assert_eq!((waits.state(), waits.last_event), (JobState::Running, before.last_event), "nothing happens to it");
    let request = WatchJobRequest { id: id.clone(), after: before.last_event - 1 };
    let mut events = sandbox.client().watch_job(request).await.expect("a stream").into_inner();
    let told = events.message().await.expect("it stands").expect("what happened last").event;
    assert!(matches!(&told, Some(Event::Waits(reason)) if reason.contains("070707070707")), "{told:?}");
    let shown = sandbox.told(&["show", &id]);
    for part in ["waits for a worker of the build", "evogait 0.0.9 with engine 070707070707", "none of those connected"]
    {
        assert!(shown.contains(part), "{part} is not in\n{shown}");
    }
    let here = sim_core::engines::engine_digests().into_iter().map(|(_, digest)| digest.short());
    assert!(here.into_iter().all(|digest| shown.contains(&digest)), "what is offered is not in\n{shown}");

    // Who computes yet other bits is of no use.
    let refused = Scripted::of_another_build(&sandbox, "other", Digest([8; 32])).await.err().expect("nobody needs it");
    assert_eq!(refused.code(), Code::FailedPrecondition);
    assert!(refused.message().contains("080808080808") && refused.message().contains("no job"), "{refused}");

    let old = Scripted::of_another_build(&sandbox, "old", OLD).await.expect("a job needs it");
    let works = tokio::spawn(old.works(job.clone()));
    let result = sandbox.result(&id).await;
    works.abort();
    let workers = sandbox.client().list_workers(ListWorkersRequest {}).await.expect("an answer").into_inner().workers;
    let new = workers.iter().find(|w| w.slots == 2).expect("it is still there");
    let of_beside = sandbox.job(&beside.id).await;
    assert!(new.evaluations >= of_beside.evaluations, "{workers:?}");
    assert!(new.evaluations < of_beside.evaluations + 30, "the new one had no part in it: {workers:?}");
    assert_eq!(result.job.as_ref().map(|job| job.engine_digest.clone()), Some(OLD.0.to_vec()));
    sandbox.told(&["fetch", &id, "--out", "fetched"]);
    let file = std::fs::read_to_string(sandbox.file("fetched").join("result.json")).expect("it was written");
    assert!(file.contains(&OLD.to_string()), "the result says on which engine it was computed: {file}");
    assert_eq!(coordinator.terminate(), Some(0));

    let mut undisturbed = Sandbox::new();
    let _coordinator = undisturbed.coordinator();
    let _worker = undisturbed.worker(2);
    let same = undisturbed.submit("r", &toml).await;
    let same = undisturbed.result(&same.id).await;
    assert_eq!((result.winner, result.first, result.history), (same.winner, same.first, same.history));
}
