//! Results of a comparison as rows of the fidelity table that is shipped with the program
//! ([`sim_core::engines::fidelity`]).

use super::comparison::{Comparison, Set};
use crate::setting::PhysicsSetting;
use sim_core::engines::fidelity::{Agreement, FidelityRow, FidelityTable};
use sim_core::physics::{EngineKind, Scale, lockstep};
use sim_core::problem::Job;
use std::fmt;

/// Reason why a comparison gives no rows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unfit {
    /// The reference is a setting of another engine than lockstep.
    Reference(PhysicsSetting),
    /// All settings are of another engine than lockstep.
    Settings,
    /// Fewer than two random or two evolved gaits.
    Gaits,
    /// Too few gaits of a kind completed for a rank correlation.
    Unstable {
        /// Kind of the gaits: "random" or "evolved".
        gaits: &'static str,
        /// Setting compared with the reference.
        setting: PhysicsSetting,
    },
}

impl fmt::Display for Unfit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Reference(reference) => write!(
                f,
                "the reference {reference} is not a setting of the lockstep engine: choose one that ends with -lockstep"
            ),
            Self::Settings => {
                f.write_str("none of the settings is of the lockstep engine: add one that ends with -lockstep")
            }
            Self::Gaits => f.write_str("too few gaits: a row needs at least 2 random and 2 evolved gaits"),
            Self::Unstable { gaits, setting } => {
                write!(
                    f,
                    "too few {gaits} gaits completed with both {setting} and the reference for a rank correlation: \
                     use more gaits"
                )
            }
        }
    }
}

impl std::error::Error for Unfit {}

/// Checks, before the measurement, that a comparison can give rows. `gaits`: numbers of random and of evolved gaits.
///
/// # Errors
/// If the reference or all settings are of another engine than lockstep, or there are fewer than 2 gaits of a kind.
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

/// Returns the table's default settings: the default setting of the lockstep engine at this scale, and the same with 2,
/// 4 and 8 times as many steps per second for robots that need finer steps.
pub fn settings(scale: Scale) -> Vec<PhysicsSetting> {
    let own = PhysicsSetting::own(EngineKind::Lockstep, scale);
    [1, 2, 4, 8].map(|finer| PhysicsSetting { steps_per_second: finer * own.steps_per_second, ..own }).to_vec()
}

/// Returns one row for each setting of the lockstep engine. `variant`: name of the robot's variant, if any; `sets`:
/// results with random and with evolved gaits.
///
/// # Errors
/// If a setting has no rank correlation with the reference.
pub fn rows(
    job: &Job,
    variant: Option<&str>,
    scale: Scale,
    comparison: &Comparison,
    sets: &[Set],
) -> Result<Vec<FidelityRow>, Unfit> {
    let reference = comparison.reference;
    let row = |&setting: &PhysicsSetting| {
        let agreement = |gaits| {
            let set = sets.iter().find(|set| set.gaits == gaits);
            set.and_then(|set| agreement(set, setting)).ok_or(Unfit::Unstable { gaits, setting })
        };
        Ok(FidelityRow {
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

fn agreement(set: &Set, setting: PhysicsSetting) -> Option<Agreement> {
    let row = set.settings.iter().find(|row| row.setting == setting)?.against.fidelity.as_ref()?;
    let halved = set.halved.iter().map(|row| &row.against);
    let itself = std::iter::once(&set.ceiling.against).chain(halved);
    let itself: Option<Vec<f64>> = itself.map(|against| Some(against.fidelity.as_ref()?.spearman?.value)).collect();
    let ceiling = itself?.into_iter().fold(1.0, f64::min);
    Some(Agreement { gaits: row.gaits as u32, spearman: rounded(row.spearman?.value), ceiling: rounded(ceiling) })
}

/// Rounds to four decimal places, as further digits are not significant.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

/// Replaces all rows of a robot in the table with new ones.
pub fn merge(known: &mut FidelityTable, rows: Vec<FidelityRow>) {
    // If a robot's mechanics have changed, its old rows are found by name.
    let same_name =
        |r: &FidelityRow, row: &FidelityRow| (&r.robot, &r.variant, r.scale) == (&row.robot, &row.variant, row.scale);
    known.rows.retain(|r| !rows.iter().any(|row| row.replaces(r) || same_name(r, row)));
    known.rows.extend(rows);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fidelity::comparison::{Against, Ceiling};
    use sim_core::base::digest::Digest;

    fn comparison(reference: &str, settings: &[&str]) -> Comparison {
        let reference: PhysicsSetting = reference.parse().unwrap();
        let settings = settings.iter().map(|s| s.parse().unwrap()).collect();
        Comparison { reference, halved: reference.halved().unwrap(), settings }
    }

    #[test]
    fn comparison_without_possible_rows_is_refused() {
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
        let row = |robot: &str, mechanics: &str, steps_per_second| FidelityRow {
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
        let mut known = FidelityTable { rows: vec![before, other.clone(), renamed] };
        merge(&mut known, vec![new.clone()]);
        assert_eq!(known.rows, [other, new]);
    }

    #[test]
    fn set_without_completed_gaits_has_no_agreement() {
        let setting: PhysicsSetting = "200x2-lockstep".parse().unwrap();
        let speed = crate::speed::simulated_per_cpu(&[]);
        let against = Against { speed, fidelity: None };
        let ceiling = Ceiling { against };
        let set = Set { gaits: "random", reference_speed: speed, settings: vec![], halved: vec![], ceiling };
        assert!(agreement(&set, setting).is_none());
    }
}
