//! What is acknowledged survives the death of the coordinator at every commit.

use cluster_tests::crashes::{POINTS, through_crashes};
use cluster_tests::sandbox::{Sandbox, tiny_job};

#[tokio::test]
async fn a_coordinator_that_dies_at_every_commit_loses_nothing_and_changes_no_bit() {
    let job = tiny_job(21, 1);
    let (digest, lives) = through_crashes(&mut Sandbox::new(), &[], &job, false).await;
    println!("it died {lives} times");
    assert!(lives >= 2 * POINTS.len(), "it died {lives} times");

    let mut undisturbed = Sandbox::new();
    let _coordinator = undisturbed.coordinator();
    let _worker = undisturbed.worker(1);
    let job = undisturbed.submit("r", &job).await;
    assert_eq!(undisturbed.result(&job.id).await.result_digest, digest);
}

#[tokio::test]
async fn a_cancel_that_was_answered_stays_whatever_dies() {
    let (digest, lives) = through_crashes(&mut Sandbox::new(), &[], &tiny_job(22, 1000), true).await;
    assert!(digest.is_empty() && lives >= POINTS.len(), "it died {lives} times");
}
