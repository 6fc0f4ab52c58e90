//! Facts of a valid job that are hardly meant: inertias of its robot, and a goal that the robot can't stand at.

use sim_core::job::Job;

/// Warnings about a job that need no evaluation.
pub fn of(job: &Job) -> Vec<String> {
    let mut doubts = job.robot().doubts();
    doubts.extend(job.blocked_goal().map(|i| {
        format!("at the goal the robot touches environment.obstacle[{i}] at every heading: it can't stand there")
    }));
    doubts
}
