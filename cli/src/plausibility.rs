//! Warnings about a valid job that is probably a mistake: implausible inertias or lengths of its robot, or a goal at
//! which the robot can't stand.

use crate::console;
use sim_core::model::Robot;
use sim_core::problem::Checked;
use sim_core::problem::Job;

/// Returns the warnings that need no simulation: about inertias and lengths of the job's robot.
pub fn warnings(job: &Checked) -> Vec<String> {
    let mut doubts = job.robot().doubts();
    doubts.extend(unit_warning(job.robot(), "FILE"));
    doubts
}

/// Returns the warning about a goal at which the settled robot can't stand.
pub fn goal_warning(job: &Job) -> Option<String> {
    let obstacle = job.blocked_goal()?;
    Some(format!("the robot can't stand at the goal: it touches environment.obstacle[{obstacle}] at every heading"))
}

/// Returns a warning if the robot's lengths may not be in mu, with the command that converts them.
pub fn unit_warning(robot: &Robot, file: &str) -> Option<String> {
    let unit = robot.unit_in_doubt()?;
    Some(format!(
        "the robot's bodies are about {unit} mu long, but a module is 1 mu long: `evogait robot {} --unit {unit} --out {}` \
         writes the robot with lengths divided by {unit}; if the file is in metres, gravity is then {:.1} mu/s²",
        console::quoted(file),
        console::quoted(format!("{}.toml", robot.name)),
        9.81 / unit
    ))
}
