//! Rust side of `tests/peers/import_check.py`: imports MJCF and URDF files. Their paths stand on standard input, one a
//! line. For each file it prints a line of JSON: the imported robot, or the reason of the refusal.

use serde::Serialize;
use sim_core::base::error::Invalid;
use sim_core::exchange;
use sim_core::model::{Robot, RobotSpec};
use std::io::BufRead;

#[derive(Serialize)]
#[serde(untagged)]
enum Answer {
    Imported { file: String, spec: Box<RobotSpec> },
    Refused { file: String, refused: String },
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for file in std::io::stdin().lock().lines() {
        let file = file?;
        let text = std::fs::read_to_string(&file).map_err(|e| format!("{file}: {e}"))?;
        let answer = match import(&text) {
            Ok(spec) => Answer::Imported { file, spec: Box::new(spec) },
            Err(invalid) => Answer::Refused { file, refused: invalid.to_string() },
        };
        println!("{}", serde_json::to_string(&answer)?);
    }
    Ok(())
}

fn import(text: &str) -> Result<RobotSpec, Invalid> {
    let spec = exchange::read(text)?.robot;
    Robot::compile(&spec)?;
    Ok(spec)
}
