//! Shipped table of the lockstep engine's fidelity, from which jobs with `engine = "auto"` get their engine.
//! `evogait bench fidelity --table` makes its rows.

use crate::base::digest::Digest;
use crate::base::error::{Invalid, in_range, whole_in_range};
use crate::model::Robot;
use crate::physics::{Scale, lockstep};
use serde::{Deserialize, Serialize};
use std::sync::OnceLock;

/// Least rank correlation with the converged reference at which lockstep may replace rapier. Where the robot's ceiling
/// is lower, the ceiling counts, because no setting can exceed it.
pub const STANDS: f64 = 0.98;

/// Table of the lockstep engine's fidelity.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FidelityTable {
    /// One row for each robot, scale and setting.
    #[serde(default, rename = "row")]
    pub rows: Vec<FidelityRow>,
}

/// Fidelity of one robot at one setting of the lockstep engine, against a converged setting of the same engine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FidelityRow {
    /// Name of the robot, only for readers.
    pub robot: String,
    /// Failed modules, only for readers: "none" or the name of a variant.
    pub variant: String,
    /// Identity of the robot, [`Robot::mechanics`].
    pub mechanics: Digest,
    /// Scale, which sets gravity and motors.
    pub scale: Scale,
    /// [`lockstep::REVISION`] of the measurement.
    pub revision: u32,
    /// Steps a second of the setting.
    pub steps_per_second: u32,
    /// Substeps of the setting.
    pub substeps: u32,
    /// Converged setting, only for readers.
    pub reference: String,
    /// Agreement for gaits drawn uniformly from the controller's bounds.
    pub random: Agreement,
    /// Agreement for gaits from the last generations of searches.
    pub evolved: Agreement,
}

/// Rank correlation of travelled distances with the reference.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Agreement {
    /// Number of compared gaits.
    pub gaits: u32,
    /// Spearman's rank correlation, −1 to 1.
    pub spearman: f64,
    /// Rank correlation of the reference with itself: the smaller of two, one from a start that differs by a millionth
    /// rad, one at half the step.
    pub ceiling: f64,
}

impl Agreement {
    fn stands(&self) -> bool {
        self.spearman >= STANDS.min(self.ceiling)
    }
}

impl FidelityRow {
    /// Returns true if lockstep may replace rapier.
    pub fn stands(&self) -> bool {
        self.random.stands() && self.evolved.stands()
    }

    /// Returns steps a second and substeps.
    pub fn setting(&self) -> (u32, u32) {
        (self.steps_per_second, self.substeps)
    }

    /// Returns true if both rows have the same robot, scale and setting. Their revisions may differ.
    pub fn replaces(&self, other: &FidelityRow) -> bool {
        let what = |row: &FidelityRow| (row.mechanics, row.scale, row.steps_per_second, row.substeps);
        what(self) == what(other)
    }
}

impl FidelityTable {
    /// Returns the shipped table.
    ///
    /// # Panics
    /// If the compiled-in file is invalid, which a test rules out.
    pub fn shipped() -> &'static FidelityTable {
        static TABLE: OnceLock<FidelityTable> = OnceLock::new();
        TABLE.get_or_init(|| {
            FidelityTable::from_toml(SHIPPED).expect("the compiled-in scenarios/fidelity.toml is valid")
        })
    }

    /// Reads and checks a table.
    pub fn from_toml(text: &str) -> Result<FidelityTable, Invalid> {
        let known: FidelityTable = toml::from_str(text)?;
        for (i, row) in known.rows.iter().enumerate() {
            for (name, agreement) in [("random", row.random), ("evolved", row.evolved)] {
                let field = |of: &str| format!("row[{i}].{name}.{of}");
                whole_in_range(field("gaits"), agreement.gaits, (2, 1_000_000), "")?;
                in_range(field("spearman"), agreement.spearman, (-1.0, 1.0), "")?;
                in_range(field("ceiling"), agreement.ceiling, (-1.0, 1.0), "")?;
            }
            if known.rows[..i].iter().any(|before| row.replaces(before)) {
                let value = row.mechanics.short();
                return Err(Invalid::Duplicate { field: format!("row[{i}].mechanics"), value });
            }
        }
        Ok(known)
    }

    /// Returns the table as a file, with rows in order of robot, variant, scale and substeps a second.
    pub fn to_toml(&self) -> String {
        let mut sorted = self.clone();
        sorted.rows.sort_by_key(|r| {
            let name = (r.robot.clone(), r.variant != "none", r.variant.clone());
            (name, r.scale == Scale::Real, r.steps_per_second * r.substeps)
        });
        let rows = toml::to_string(&sorted).expect("a table of numbers and names can be written as TOML");
        format!("{HEAD}\n{rows}")
    }

    /// Returns the rows of a robot at a scale for this revision of the engine, the fastest setting first.
    pub fn of(&self, robot: &Robot, scale: Scale) -> Vec<&FidelityRow> {
        let mechanics = robot.mechanics();
        let is =
            |row: &&FidelityRow| (row.mechanics, row.scale, row.revision) == (mechanics, scale, lockstep::REVISION);
        let mut rows: Vec<&FidelityRow> = self.rows.iter().filter(is).collect();
        rows.sort_by_key(|row| row.steps_per_second * row.substeps);
        rows
    }
}

const SHIPPED: &str = include_str!("../../../scenarios/fidelity.toml");

/// Comment at the head of the file.
const HEAD: &str = "\
# Fidelity of settings of the lockstep engine against its converged reference, robot by robot. `engine = \"auto\"` uses
# the fastest setting with sufficient fidelity, or rapier where there is none. Made by tests/fidelity-table.sh;
# docs/performance.md explains it. A row is valid for one robot (by its mechanics, not its name) and one revision of
# the engine.
";

#[cfg(test)]
mod tests {
    use super::*;

    fn robot(variant: Option<&str>) -> Robot {
        let spec: crate::model::RobotSpec = toml::from_str(crate::model::catalogue::robots()[0].toml).unwrap();
        Robot::compile(&variant.map_or_else(|| spec.clone(), |v| spec.variant(v).unwrap())).unwrap()
    }

    fn row(random: (f64, f64), evolved: (f64, f64)) -> FidelityRow {
        let agreement = |(spearman, ceiling)| Agreement { gaits: 100, spearman, ceiling };
        FidelityRow {
            robot: "some name".into(),
            variant: "none".into(),
            mechanics: robot(None).mechanics(),
            scale: Scale::Paper,
            revision: lockstep::REVISION,
            steps_per_second: 200,
            substeps: 2,
            reference: "1600x4".into(),
            random: agreement(random),
            evolved: agreement(evolved),
        }
    }

    #[test]
    fn shipped_table_is_valid_and_in_written_form() {
        let known = FidelityTable::from_toml(SHIPPED).unwrap();
        assert_eq!(known.to_toml(), SHIPPED);
        for row in &known.rows {
            assert_eq!(
                row.revision,
                lockstep::REVISION,
                "{} {}: the row is of another revision of lockstep: measure it again",
                row.robot,
                row.variant
            );
        }
    }

    #[test]
    fn row_stands_at_threshold_or_ceiling() {
        let high = (0.99, 0.999);
        assert!(row(high, high).stands() && row((STANDS, 1.0), high).stands());
        assert!(!row((0.979, 1.0), high).stands() && !row(high, (0.979, 1.0)).stands());
        assert!(row(high, (0.93, 0.92)).stands(), "no setting can agree better than the reference with itself");
        assert!(!row(high, (0.91, 0.92)).stands());
    }

    #[test]
    fn row_applies_to_one_mechanics_scale_and_revision() {
        let good = row((0.99, 1.0), (0.99, 1.0));
        let knows =
            |row: FidelityRow, robot: &Robot, scale| !FidelityTable { rows: vec![row] }.of(robot, scale).is_empty();
        let mut whole = robot(None);
        assert!(knows(good.clone(), &whole, Scale::Paper));
        whole.name = "other".into();
        whole.bodies[0].name = "other".into();
        assert!(knows(good.clone(), &whole, Scale::Paper));
        assert!(!knows(good.clone(), &whole, Scale::Real));
        assert!(!knows(good.clone(), &robot(Some("E1")), Scale::Paper));
        assert!(!knows(FidelityRow { revision: 0, ..good.clone() }, &whole, Scale::Paper));
        whole.bodies[0].mass *= 1.0001;
        assert!(!knows(good, &whole, Scale::Paper));
    }

    #[test]
    fn fastest_setting_comes_first() {
        let good = row((0.99, 1.0), (0.99, 1.0));
        let fine = FidelityRow { steps_per_second: 400, ..good.clone() };
        let known = FidelityTable { rows: vec![fine.clone(), good.clone()] };
        assert_eq!(known.of(&robot(None), Scale::Paper), [&good, &fine]);
        assert!(known.to_toml().find("= 200").unwrap() < known.to_toml().find("= 400").unwrap());
    }

    #[test]
    fn table_round_trips_and_invalid_table_is_refused() {
        let known = FidelityTable { rows: vec![row((0.99, 1.0), (0.98, 0.99))] };
        assert_eq!(FidelityTable::from_toml(&known.to_toml()).unwrap(), known);
        let twice = FidelityTable { rows: [known.rows.clone(), known.rows.clone()].concat() };
        let said = FidelityTable::from_toml(&twice.to_toml()).unwrap_err().to_string();
        assert!(said.starts_with("row[1].mechanics = "), "{said}");
        let said = FidelityTable::from_toml(&known.to_toml().replace("0.98", "1.5")).unwrap_err().to_string();
        assert!(said.starts_with("row[0].evolved.spearman = 1.5 is out of range"), "{said}");
    }
}
