//! Facts of a valid job that are hardly meant: inertias of its robot, and a goal that the robot can't stand at.

use crate::console;
use sim_core::model::Robot;
use sim_core::problem::Checked;
use sim_core::problem::Job;

/// Warnings about a job that need no simulation.
pub fn of(job: &Checked) -> Vec<String> {
    let mut doubts = job.robot().doubts();
    doubts.extend(of_unit(job.robot(), "FILE"));
    doubts
}

/// The warning about a goal at which the settled robot can't stand.
pub fn of_goal(job: &Job) -> Option<String> {
    let obstacle = job.blocked_goal()?;
    Some(format!(
        "at the goal the robot touches environment.obstacle[{obstacle}] at every heading: it can't stand there"
    ))
}

/// A remark on a robot whose lengths may not be in mu, with the command that writes it with other ones.
pub fn of_unit(robot: &Robot, file: &str) -> Option<String> {
    let unit = robot.unit_in_doubt()?;
    Some(format!(
        "the robot's bodies are about {unit} mu long, modules 1 mu: `evogait robot {} --unit {unit} --out {}` writes it with \
         lengths divided by {unit}; gravity is then {:.1} mu/s² if the file is in metres",
        console::quoted(file),
        console::quoted(format!("{}.toml", robot.name)),
        9.81 / unit
    ))
}
