//! Gait set of a run, for a job that plans with it: reads gaits.json by the names of its parameters.

use crate::error::Error;
use crate::inputs;
use serde::Deserialize;
use sim_core::base::error::Invalid;
use sim_core::base::limits::MAX_TOML_LENGTH;
use sim_core::control::GaitsSpec;
use sim_core::genotype::Length;
use sim_core::model::Robot;
use sim_core::problem::GaitSet;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

/// Name of the file in a run's folder.
pub const GAITS: &str = "gaits.json";

#[derive(Deserialize)]
struct GaitFile {
    controller: String,
    gaits: Vec<Gait>,
}

#[derive(Deserialize)]
struct Gait {
    parameters: BTreeMap<String, f64>,
}

/// Reads the gaits of a run's folder or of a gaits.json, and checks them against this robot and controller.
pub fn read(path: &Path, gaits: &GaitsSpec, robot: &Robot) -> Result<GaitSet, Error> {
    let file = if path.is_dir() { path.join(GAITS) } else { path.to_owned() };
    let text = text_of(&file)?;
    inputs::record(&file);
    let refused = |reason: String| Error::Invalid {
        file: file.display().to_string(),
        source: Invalid::Conflict { field: "gaits".into(), reason },
    };
    let set: GaitFile =
        serde_json::from_str(&text).map_err(|e| refused(format!("this is not a {GAITS} of `evogait run`: {e}")))?;
    of_file(set, gaits, robot).map_err(refused)
}

fn of_file(set: GaitFile, spec: &GaitsSpec, robot: &Robot) -> Result<GaitSet, String> {
    let controller = spec.controller.0;
    if set.controller != controller.name() {
        return Err(format!(
            "their controller is \"{}\", but the controller of the job is \"{}\"",
            set.controller,
            controller.name()
        ));
    }
    let space = controller.space(robot);
    if space.length != Length::Fixed {
        return Err(format!("gaits of controller \"{}\" are sequences, which {GAITS} can't hold", set.controller));
    }
    let gait = |(i, gait): (usize, &Gait)| {
        let number = |name: &String| {
            gait.parameters.get(name).copied().ok_or_else(|| {
                format!("gait {} has no parameter {name}: it is not a gait of robot \"{}\"", i + 1, robot.name)
            })
        };
        let names = space.names();
        if let Some(other) = gait.parameters.keys().find(|name| !names.contains(name)) {
            return Err(format!(
                "gait {} has a parameter {other} that robot \"{}\" does not have: its joints are {}",
                i + 1,
                robot.name,
                robot.joint_names().join(", ")
            ));
        }
        names.iter().map(number).collect()
    };
    let genome = set.gaits.iter().enumerate().map(gait).collect::<Result<_, String>>()?;
    Ok(GaitSet { joints: robot.joint_names(), genome })
}

fn text_of(path: &Path) -> Result<String, Error> {
    let read = || -> io::Result<String> {
        let mut text = String::new();
        File::open(path)?.take(MAX_TOML_LENGTH as u64 * 8).read_to_string(&mut text)?;
        Ok(text)
    };
    read().map_err(|source| Error::read(path, source))
}
