//! Acknowledged states survive a crash of the coordinator at every commit.

use cluster_tests::crashes::{ClientGoal, POINTS, cancelled_through_crashes, paused_through_crashes, through_crashes};
use cluster_tests::sandbox::{Sandbox, tiny_job, undisturbed};

#[tokio::test]
async fn job_survives_coordinator_crash_at_every_commit() {
    let job = tiny_job(21, 1);
    let passed = through_crashes(&mut Sandbox::new(), &[], &job, ClientGoal::Result, POINTS).await;
    println!("the coordinator crashed {} times", passed.lives);
    assert!(passed.lives >= 2 * POINTS.len(), "too few crashes: {}", passed.lives);
    assert_eq!(undisturbed(&job).await, passed.digest);
}

#[tokio::test]
async fn acknowledged_cancel_survives_every_crash() {
    cancelled_through_crashes(Sandbox::new, &[], &tiny_job(22, 1000)).await;
}

#[tokio::test]
async fn acknowledged_pause_survives_every_crash() {
    let job = tiny_job(23, 20);
    assert_eq!(paused_through_crashes(&mut Sandbox::new(), &[], &job).await, undisturbed(&job).await);
}
