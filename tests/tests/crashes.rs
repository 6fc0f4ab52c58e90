//! What is acknowledged survives the death of the coordinator at every commit.

use cluster_tests::crashes::{POINTS, Wish, cancelled_through_crashes, paused_through_crashes, through_crashes};
use cluster_tests::sandbox::{Sandbox, tiny_job, undisturbed};

#[tokio::test]
async fn coordinator_killed_at_every_commit_loses_nothing() {
    let job = tiny_job(21, 1);
    let passed = through_crashes(&mut Sandbox::new(), &[], &job, Wish::Result, POINTS).await;
    println!("it died {} times", passed.lives);
    assert!(passed.lives >= 2 * POINTS.len(), "it died {} times", passed.lives);
    assert_eq!(undisturbed(&job).await, passed.digest);
}

#[tokio::test]
async fn answered_cancel_survives_every_kill() {
    cancelled_through_crashes(Sandbox::new, &[], &tiny_job(22, 1000)).await;
}

#[tokio::test]
async fn answered_pause_survives_every_kill() {
    let job = tiny_job(23, 20);
    assert_eq!(paused_through_crashes(&mut Sandbox::new(), &[], &job).await, undisturbed(&job).await);
}
