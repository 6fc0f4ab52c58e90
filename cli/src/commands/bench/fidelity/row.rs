//! What was found as a row of the table that ships.

use super::view::{Set, View};
use crate::error::Error;
use crate::output::atomic::write_file;
use sim_core::engines::known::{Agreement, Known, Row};
use sim_core::physics::{EngineKind, Scale, lockstep};
use sim_core::problem::Job;
use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use study::setting::Setting;

/// Refuses, before anything is measured, what could not make a row.
pub fn check(reference: Setting, settings: &[Setting], gaits: [u32; 2]) -> Result<(), Error> {
    if reference.engine != EngineKind::Lockstep {
        return Err(refused(format!("the reference {reference} is not one of the lockstep engine")));
    }
    if !settings.iter().any(|s| s.engine == EngineKind::Lockstep) {
        return Err(refused("none of the settings compared is one of the lockstep engine".to_owned()));
    }
    if gaits.iter().any(|n| *n < 2) {
        return Err(refused("a row needs at least two random and two evolved gaits".to_owned()));
    }
    Ok(())
}

/// What is compared for the table unless it is said: the scale's own setting, and finer ones for robots that it is too
/// coarse for.
pub fn settings(scale: Scale) -> Vec<Setting> {
    let own = Setting::own(EngineKind::Lockstep, scale);
    [1, 2, 4, 8].map(|finer| Setting { steps_per_second: finer * own.steps_per_second, ..own }).to_vec()
}

fn refused(what: String) -> Error {
    Error::Usage { message: format!("--table can't be written: {what}") }
}

/// The rows of the lockstep engine's settings. Refuses measurements that don't tell what a row needs.
pub fn of(job: &Job, variant: Option<&str>, scale: Scale, view: &View) -> Result<Vec<Row>, Error> {
    let row = |setting: Setting| {
        let agreement = |gaits: &str| {
            let set = view.sets.iter().find(|set| set.gaits == gaits);
            set.and_then(|set| agreement(set, setting)).ok_or_else(|| {
                refused(format!("too few {gaits} gaits completed with {setting} and with the reference"))
            })
        };
        Ok(Row {
            robot: job.robot_spec().name.clone(),
            variant: variant.unwrap_or("none").to_owned(),
            mechanics: job.robot().mechanics(),
            scale,
            revision: lockstep::REVISION,
            steps_per_second: setting.steps_per_second,
            substeps: setting.substeps,
            reference: format!("{}x{}", view.reference.steps_per_second, view.reference.substeps),
            random: agreement("random")?,
            evolved: agreement("evolved")?,
        })
    };
    let settings = view.sets[0].settings.iter().map(|row| row.setting);
    settings.filter(|setting| setting.engine == EngineKind::Lockstep).map(row).collect()
}

fn agreement(set: &Set, setting: Setting) -> Option<Agreement> {
    let row = set.settings.iter().find(|row| row.setting == setting)?.against.fidelity.as_ref()?;
    let halved = set.halved.iter().map(|row| &row.against);
    let itself = std::iter::once(&set.ceiling.against).chain(halved);
    let itself: Option<Vec<f64>> = itself.map(|against| Some(against.fidelity.as_ref()?.spearman?.value)).collect();
    let ceiling = itself?.into_iter().fold(1.0, f64::min);
    Some(Agreement { gaits: row.gaits as u32, spearman: rounded(row.spearman?.value), ceiling: rounded(ceiling) })
}

/// To four digits: more would be noise.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

/// Puts rows of one robot into a table's file, in the place of all that it had of it; makes the file if there is none.
pub fn keep(path: &Path, rows: Vec<Row>) -> Result<(), Error> {
    let mut known = match fs::read_to_string(path) {
        Ok(text) => {
            Known::from_toml(&text).map_err(|source| Error::Invalid { file: path.display().to_string(), source })?
        }
        Err(e) if e.kind() == ErrorKind::NotFound => Known::default(),
        Err(e) => return Err(Error::read(path, e)),
    };
    // A robot that changed leaves no row behind.
    let same_name = |r: &Row, row: &Row| (&r.robot, &r.variant, r.scale) == (&row.robot, &row.variant, row.scale);
    known.rows.retain(|r| !rows.iter().any(|row| row.replaces(r) || same_name(r, row)));
    known.rows.extend(rows);
    write_file(path, known.to_toml().as_bytes())
}
