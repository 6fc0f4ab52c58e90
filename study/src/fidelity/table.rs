//! Results as rows of the fidelity table that ships ([`sim_core::engines::known`]).

use super::comparison::{Comparison, Set};
use crate::setting::Setting;
use sim_core::engines::known::{Agreement, Known, Row};
use sim_core::physics::{EngineKind, Scale, lockstep};
use sim_core::problem::Job;
use std::fmt;

/// The reason why a comparison gives no rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unfit {
    /// The reference is one of another engine.
    Reference(Setting),
    /// No setting is one of the lockstep engine.
    Settings,
    /// Fewer than two random or two evolved gaits.
    Gaits,
    /// Too few gaits of a kind completed for a rank correlation.
    Unstable {
        /// "random" or "evolved".
        gaits: &'static str,
        /// The setting.
        setting: Setting,
    },
}

impl fmt::Display for Unfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Reference(reference) => write!(f, "the reference {reference} is not one of the lockstep engine"),
            Self::Settings => f.write_str("none of the settings compared is one of the lockstep engine"),
            Self::Gaits => f.write_str("a row needs at least two random and two evolved gaits"),
            Self::Unstable { gaits, setting } => {
                write!(f, "too few {gaits} gaits completed with {setting} and with the reference")
            }
        }
    }
}

impl std::error::Error for Unfit {}

/// Refuses, before anything is measured, a comparison that could not make a row. `gaits`: numbers of random and of
/// evolved gaits.
pub fn check(comparison: &Comparison, gaits: [u32; 2]) -> Result<(), Unfit> {
    if comparison.reference.engine != EngineKind::Lockstep {
        return Err(Unfit::Reference(comparison.reference));
    }
    if !comparison.settings.iter().any(|s| s.engine == EngineKind::Lockstep) {
        return Err(Unfit::Settings);
    }
    if gaits.iter().any(|n| *n < 2) {
        return Err(Unfit::Gaits);
    }
    Ok(())
}

/// The settings that the table has by default: the scale's own setting, and finer ones for robots that it is too coarse
/// for.
pub fn settings(scale: Scale) -> Vec<Setting> {
    let own = Setting::own(EngineKind::Lockstep, scale);
    [1, 2, 4, 8].map(|finer| Setting { steps_per_second: finer * own.steps_per_second, ..own }).to_vec()
}

/// The rows of the lockstep engine's settings. `variant`: name of the robot's variant, if any; `sets`: results with
/// random and with evolved gaits.
///
/// # Errors
/// If a rank correlation is missing.
pub fn rows(
    job: &Job,
    variant: Option<&str>,
    scale: Scale,
    comparison: &Comparison,
    sets: &[Set],
) -> Result<Vec<Row>, Unfit> {
    let reference = comparison.reference;
    let row = |&setting: &Setting| {
        let agreement = |gaits| {
            let set = sets.iter().find(|set| set.gaits == gaits);
            set.and_then(|set| agreement(set, setting)).ok_or(Unfit::Unstable { gaits, setting })
        };
        Ok(Row {
            robot: job.robot_spec().name.clone(),
            variant: variant.unwrap_or("none").to_owned(),
            mechanics: job.robot().mechanics(),
            scale,
            revision: lockstep::REVISION,
            steps_per_second: setting.steps_per_second,
            substeps: setting.substeps,
            reference: format!("{}x{}", reference.steps_per_second, reference.substeps),
            random: agreement("random")?,
            evolved: agreement("evolved")?,
        })
    };
    comparison.settings.iter().filter(|setting| setting.engine == EngineKind::Lockstep).map(row).collect()
}

fn agreement(set: &Set, setting: Setting) -> Option<Agreement> {
    let row = set.settings.iter().find(|row| row.setting == setting)?.against.fidelity.as_ref()?;
    let halved = set.halved.iter().map(|row| &row.against);
    let itself = std::iter::once(&set.ceiling.against).chain(halved);
    let itself: Option<Vec<f64>> = itself.map(|against| Some(against.fidelity.as_ref()?.spearman?.value)).collect();
    let ceiling = itself?.into_iter().fold(1.0, f64::min);
    Some(Agreement { gaits: row.gaits as u32, spearman: rounded(row.spearman?.value), ceiling: rounded(ceiling) })
}

/// Rounds to four digits: more would be noise.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

/// Puts rows of one robot into a table, in the place of all rows that the table has of it.
pub fn merge(known: &mut Known, rows: Vec<Row>) {
    // A robot that changed leaves no row behind.
    let same_name = |r: &Row, row: &Row| (&r.robot, &r.variant, r.scale) == (&row.robot, &row.variant, row.scale);
    known.rows.retain(|r| !rows.iter().any(|row| row.replaces(r) || same_name(r, row)));
    known.rows.extend(rows);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fidelity::comparison::{Against, Ceiling};
    use sim_core::base::digest::Digest;

    fn comparison(reference: &str, settings: &[&str]) -> Comparison {
        let reference: Setting = reference.parse().unwrap();
        let settings = settings.iter().map(|s| s.parse().unwrap()).collect();
        Comparison { reference, halved: reference.halved().unwrap(), settings }
    }

    #[test]
    fn comparison_that_gives_no_row_is_refused() {
        let fit = comparison("1600x4-lockstep", &["30x8", "200x2-lockstep"]);
        assert_eq!(check(&fit, [2, 2]), Ok(()));
        assert_eq!(check(&fit, [2, 1]), Err(Unfit::Gaits));
        assert_eq!(check(&comparison("1600x4-lockstep", &["30x8"]), [2, 2]), Err(Unfit::Settings));
        let rapier = comparison("480x8", &["200x2-lockstep"]);
        assert_eq!(check(&rapier, [2, 2]), Err(Unfit::Reference(rapier.reference)));
    }

    #[test]
    fn merged_rows_replace_those_of_the_same_robot_only() {
        let agreement = Agreement { gaits: 10, spearman: 0.9, ceiling: 1.0 };
        let row = |robot: &str, mechanics: &str, steps_per_second| Row {
            robot: robot.to_owned(),
            variant: "none".to_owned(),
            mechanics: Digest::of("test", &mechanics),
            scale: Scale::Paper,
            revision: lockstep::REVISION,
            steps_per_second,
            substeps: 2,
            reference: "1600x4".to_owned(),
            random: agreement,
            evolved: agreement,
        };
        let (before, other) = (row("changed", "old", 400), row("other", "other", 200));
        let renamed = row("old name", "new", 200);
        let new = row("changed", "new", 200);
        let mut known = Known { rows: vec![before, other.clone(), renamed] };
        merge(&mut known, vec![new.clone()]);
        assert_eq!(known.rows, [other, new]);
    }

    #[test]
    fn set_without_completed_gaits_has_no_agreement() {
        let setting: Setting = "200x2-lockstep".parse().unwrap();
        let speed = crate::speed::simulated_per_cpu(&[]);
        let against = Against { speed, fidelity: None };
        let ceiling = Ceiling { against };
        let set = Set { gaits: "random", reference_speed: speed, settings: vec![], halved: vec![], ceiling };
        assert!(agreement(&set, setting).is_none());
    }
}
