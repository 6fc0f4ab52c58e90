//! The `[finish]` table of a job: the choice of the winner after the search.

use crate::base::error::{Faults, Invalid, whole_in_range};
use crate::base::limits::{MAX_ARCHIVE, MAX_FINISH_SEEDS};
use crate::physics::{EngineChoice, Physics, PhysicsSpec, Scale};
use serde::{Deserialize, Serialize};

/// Default number of fresh RRT seeds.
const SEEDS: u32 = 20;
/// Default number of genotypes in the archive.
const ARCHIVE: u32 = 20;

/// The `[finish]` table. Keys that are not given get their defaults; all but `kind` belong to `kind = "reference"`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FinishSpec {
    /// Rule by which the published winner is chosen.
    pub kind: FinishKind,
    /// Number of the search's best distinct genotypes that are scored again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub archive: Option<u32>,
    /// Number of fresh RRT seeds for each of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seeds: Option<u32>,
    /// Physics steps per second of simulated time, on the reference setting.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps_per_second: Option<u32>,
    /// Substeps (solver iterations) of a step, on the reference setting.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub substeps: Option<u32>,
    /// True to score every new global best of the search again without reuse of transitions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub audit: Option<bool>,
}

/// Rule by which the published winner is chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FinishKind {
    /// The best of the search's archive on the reference setting: finer physics, fresh RRT seeds.
    #[default]
    Reference,
    /// The best of the search, as in the paper.
    None,
}

/// A resolved `[finish]` table of kind `reference`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Finish {
    /// Genotypes in the archive.
    pub archive: u32,
    /// Fresh RRT seeds.
    pub seeds: u32,
    /// Steps per second on the reference setting.
    pub steps_per_second: u32,
    /// Substeps of a step on the reference setting.
    pub substeps: u32,
    /// True if global bests are audited without reuse.
    pub audit: bool,
}

impl FinishSpec {
    /// Resolves and validates the table. Returns `None` for kind `none`.
    pub fn resolve(&self, scale: Scale) -> Result<Option<Finish>, Invalid> {
        if self.kind == FinishKind::None {
            return self.refuse_settings().map(|()| None);
        }
        let reference = Physics::reference_of(scale);
        let mut faults = Faults::default();
        let mut count = |field: &str, value: Option<u32>, default: u32, max: u32| {
            let value = value.unwrap_or(default);
            faults.take(whole_in_range(format!("finish.{field}"), value, (1, max.into()), ""));
            value
        };
        let finish = Finish {
            archive: count("archive", self.archive, ARCHIVE, MAX_ARCHIVE),
            seeds: count("seeds", self.seeds, SEEDS, MAX_FINISH_SEEDS),
            steps_per_second: count("steps_per_second", self.steps_per_second, reference.steps_per_second, 10_000),
            substeps: count("substeps", self.substeps, reference.substeps, 1000),
            audit: self.audit.unwrap_or(true),
        };
        faults.end().map(|()| Some(finish))
    }

    fn refuse_settings(&self) -> Result<(), Invalid> {
        let given = [
            ("archive", self.archive.is_some()),
            ("seeds", self.seeds.is_some()),
            ("steps_per_second", self.steps_per_second.is_some()),
            ("substeps", self.substeps.is_some()),
            ("audit", self.audit.is_some()),
        ];
        match given.iter().find(|(_, given)| *given) {
            None => Ok(()),
            Some((field, _)) => Err(Invalid::Conflict {
                field: format!("finish.{field}"),
                reason: "a finish of kind \"none\" has no settings: leave it out, or use kind = \"reference\"".into(),
            }),
        }
    }
}

impl Finish {
    /// Returns the number of fresh RRT seeds of a job with this finish.
    pub fn seeds_of(finish: Option<&Finish>) -> u32 {
        finish.map_or(SEEDS, |f| f.seeds)
    }

    /// Returns the table with every value written out.
    pub fn written_out(finish: Option<&Finish>) -> FinishSpec {
        match finish {
            None => FinishSpec { kind: FinishKind::None, ..FinishSpec::default() },
            Some(&Finish { archive, seeds, steps_per_second, substeps, audit }) => FinishSpec {
                kind: FinishKind::Reference,
                archive: Some(archive),
                seeds: Some(seeds),
                steps_per_second: Some(steps_per_second),
                substeps: Some(substeps),
                audit: Some(audit),
            },
        }
    }

    /// Returns a job's physics on the reference setting: always rapier, with the finish's own steps.
    pub fn physics(&self, search: &PhysicsSpec) -> PhysicsSpec {
        PhysicsSpec {
            engine: EngineChoice::Rapier,
            steps_per_second: Some(self.steps_per_second),
            substeps: Some(self.substeps),
            ..search.clone()
        }
    }
}
