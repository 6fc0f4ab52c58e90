//! What was found as a row of the table that ships.

use super::view::{Set, View};
use crate::error::Error;
use crate::output::atomic::write_file;
use crate::setting::Setting;
use sim_core::job::{EngineKind, Job, Scale};
use sim_core::lockstep;
use sim_core::measure::known::{Agreement, Known, Row};
use std::fs;
use std::io::ErrorKind;
use std::path::Path;

/// Refuses, before anything is measured, what could not make a row.
pub fn check(reference: Setting, settings: &[Setting], scale: Scale, gaits: [u32; 2]) -> Result<(), Error> {
    let own = Setting::own(EngineKind::Lockstep, scale);
    if reference.engine != EngineKind::Lockstep {
        return Err(refused(format!("the reference {reference} is not one of the lockstep engine")));
    }
    if !settings.contains(&own) {
        return Err(refused(format!("{own}, the scale's own setting, is not among those compared")));
    }
    if gaits.iter().any(|n| *n < 2) {
        return Err(refused("a row needs at least two random and two evolved gaits".to_owned()));
    }
    Ok(())
}

fn refused(what: String) -> Error {
    Error::Usage { message: format!("--table can't be written: {what}") }
}

/// The row of the lockstep engine's own setting. Refuses measurements that don't tell what a row needs.
pub fn of(job: &Job, variant: Option<&str>, scale: Scale, view: &View) -> Result<Row, Error> {
    let own = Setting::own(EngineKind::Lockstep, scale);
    let agreement = |gaits: &str| {
        let set = view.sets.iter().find(|set| set.gaits == gaits);
        set.and_then(|set| agreement(set, own))
            .ok_or_else(|| refused(format!("too few {gaits} gaits completed with {own} and with the reference")))
    };
    Ok(Row {
        robot: job.robot_spec().name.clone(),
        variant: variant.unwrap_or("none").to_owned(),
        mechanics: job.robot().mechanics(),
        scale,
        revision: lockstep::REVISION,
        steps_per_second: own.steps_per_second,
        substeps: own.substeps,
        reference: format!("{}x{}", view.reference.steps_per_second, view.reference.substeps),
        random: agreement("random")?,
        evolved: agreement("evolved")?,
    })
}

fn agreement(set: &Set, own: Setting) -> Option<Agreement> {
    let row = set.settings.iter().find(|row| row.setting == own)?.against.fidelity.as_ref()?;
    let ceiling = set.ceiling.against.fidelity.as_ref()?.spearman?.value;
    Some(Agreement { gaits: row.gaits as u32, spearman: rounded(row.spearman?.value), ceiling: rounded(ceiling) })
}

/// To four digits: more would be noise.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

/// Adds a row to a table's file, in the place of one of the same robot and setting; makes the file if there is none.
pub fn keep(path: &Path, row: Row) -> Result<(), Error> {
    let mut known = match fs::read_to_string(path) {
        Ok(text) => {
            Known::from_toml(&text).map_err(|source| Error::Invalid { file: path.display().to_string(), source })?
        }
        Err(e) if e.kind() == ErrorKind::NotFound => Known::default(),
        Err(e) => return Err(Error::read(path, e)),
    };
    // A robot that changed leaves no row behind.
    let same_name = |r: &Row| (&r.robot, &r.variant, r.scale) == (&row.robot, &row.variant, row.scale);
    known.rows.retain(|r| !row.replaces(r) && !same_name(r));
    known.rows.push(row);
    write_file(path, known.to_toml().as_bytes())
}
