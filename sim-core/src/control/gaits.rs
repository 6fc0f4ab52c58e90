//! Settings of a job's gaits: the `[gaits]` table.

use super::Controller;
use crate::base::error::{Faults, Invalid, in_range, whole_in_range};
use crate::base::limits;
use crate::base::registry::Chosen;
use crate::genotype::{Gene, Length, NamedGene, Space};
use crate::model::Robot;
use crate::physics::TICK;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Settings of a job's gaits, the `[gaits]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GaitsSpec {
    /// Number of gaits of a candidate, k.
    pub count: u32,
    /// Duration of each gait, τ, s.
    #[serde(default = "paper_duration")]
    pub duration: f64,
    /// Controller that generates the joint targets.
    #[serde(default)]
    pub controller: Chosen<dyn Controller>,
    /// Least and greatest number of segments of a gait, for controllers of sequences. Default: the controller's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segments: Option<(u32, u32)>,
    /// Allowed overlap of modules in the kinematics of a motion sequence, mu; 1 allows any. Default: 0.02.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overlap: Option<f64>,
    /// Bounds that replace the controller's own, by name of the parameter: `mu = [0.3, 1.3]`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub bounds: BTreeMap<String, (f64, f64)>,
}

impl GaitsSpec {
    /// Returns the settings of a motion that is not made of gaits and lasts `duration` s.
    pub(crate) fn of_motion(duration: f64) -> Self {
        Self {
            count: 1,
            duration,
            controller: Chosen::default(),
            segments: None,
            overlap: None,
            bounds: BTreeMap::new(),
        }
    }
}

fn paper_duration() -> f64 {
    30.0
}

/// Refuses counts and durations out of range.
pub(crate) fn validate_gaits(gaits: &GaitsSpec) -> Result<(), Invalid> {
    let mut faults = Faults::default();
    faults.take(whole_in_range("gaits.count", gaits.count, (1, limits::MAX_GAITS.into()), ""));
    faults.take(in_range("gaits.duration", gaits.duration, (0.1, limits::MAX_DURATION), "s"));
    faults.end()
}

/// Refuses a duration that is not a whole number of physics steps and of ticks. `field` is the field that the error
/// names.
pub(crate) fn whole_steps(field: &str, gaits: &GaitsSpec, steps_per_second: u32) -> Result<(), Invalid> {
    let steps = gaits.duration * f64::from(steps_per_second);
    let ticks = gaits.duration / TICK;
    if (steps - libm::round(steps)).abs() > 1e-6 || (ticks - libm::round(ticks)).abs() > 1e-6 {
        let reason = format!(
            "{} s is not a whole number of physics steps ({steps_per_second} a second) and of ticks of \
             the target table (200 a second); choose a duration that is a whole number of both",
            gaits.duration
        );
        return Err(Invalid::Conflict { field: field.into(), reason });
    }
    Ok(())
}

/// Returns the space of gait sets: the genes of one gait, repeated for every gait, with the job's bounds.
pub(crate) fn space_of(gaits: &GaitsSpec, robot: &Robot) -> Result<Space, Invalid> {
    let controller = gaits.controller.0;
    controller.fits(robot)?;
    let Space { mut genes, length } = controller.space(robot);
    if !genes.is_empty() {
        set_bounds(&mut genes, &gaits.bounds)?;
        if genes.iter().all(|named| is_fixed(named.gene)) {
            let reason = "all parameters are fixed (lower bound = upper bound), so there is nothing to search for: \
                          give one of them two different bounds";
            return Err(Invalid::Conflict { field: "gaits.bounds".into(), reason: reason.into() });
        }
    }
    let length = length_of(gaits, length)?;
    if let Some(overlap) = gaits.overlap {
        if length == Length::Fixed {
            let reason = format!("controller \"{}\" does not check overlaps: leave this key out", controller.name());
            return Err(Invalid::Conflict { field: "gaits.overlap".into(), reason });
        }
        in_range("gaits.overlap", overlap, (0.0, 1.0), "mu")?;
    }
    if length != Length::Fixed && gaits.count > 1 {
        let reason = format!(
            "a gait of controller \"{}\" is a sequence, and a candidate has only one sequence: set it to 1",
            controller.name()
        );
        return Err(Invalid::Conflict { field: "gaits.count".into(), reason });
    }
    let gait = Space { genes, length };
    let longest = gait.longest().saturating_mul(gaits.count as usize);
    whole_in_range("length of the genome", longest as u64, (1, limits::MAX_GENOTYPE as u64), "")?;
    let named = |i: u32, named: &NamedGene| NamedGene { name: format!("gait{i}.{}", named.name), ..named.clone() };
    let genes = (1..=gaits.count).flat_map(|i| gait.genes.iter().map(move |gene| named(i, gene))).collect();
    Ok(Space { genes, length })
}

/// Returns the length of a gait's genotypes, with the job's number of segments.
fn length_of(gaits: &GaitsSpec, own: Length) -> Result<Length, Invalid> {
    let Some((least, most)) = gaits.segments.or(gaits.controller.0.segments()) else { return Ok(own) };
    if own == Length::Fixed {
        let name = gaits.controller.0.name();
        let reason = format!("the gaits of controller \"{name}\" have no segments: leave this key out");
        return Err(Invalid::Conflict { field: "gaits.segments".into(), reason });
    }
    whole_in_range("gaits.segments[0]", least, (1, limits::MAX_GAIT_SEGMENTS.into()), "")?;
    whole_in_range("gaits.segments[1]", most, (least.into(), limits::MAX_GAIT_SEGMENTS.into()), "")?;
    Ok(Length::Sequence { least, most })
}

fn is_fixed(gene: Gene) -> bool {
    let (low, high) = gene.bounds();
    low == high
}

/// Sets the bounds of a gait's genes by the name of their parameter.
fn set_bounds(genes: &mut [NamedGene], bounds: &BTreeMap<String, (f64, f64)>) -> Result<(), Invalid> {
    for (parameter, &(low, high)) in bounds {
        let field = format!("gaits.bounds.{parameter}");
        let mut known: Vec<String> = Vec::new();
        for named in genes.iter().filter(|named| matches!(named.gene, Gene::Real { .. })) {
            if !known.iter().any(|name| name == named.parameter()) {
                known.push(named.parameter().to_owned());
            }
        }
        if !known.contains(parameter) {
            return Err(Invalid::Unknown { field: "gaits.bounds".into(), value: parameter.clone(), known });
        }
        in_range(format!("{field}[0]"), low, (-1000.0, 1000.0), "")?;
        in_range(format!("{field}[1]"), high, (-1000.0, 1000.0), "")?;
        if low > high {
            let reason = format!(
                "the lower bound {low} lies above the upper bound {high}; \
                 two equal bounds keep the parameter at that value"
            );
            return Err(Invalid::Conflict { field, reason });
        }
        for named in genes.iter_mut().filter(|named| named.parameter() == parameter) {
            if let Gene::Real { low: least, high: most } = &mut named.gene {
                (*least, *most) = (low, high);
            }
        }
    }
    Ok(())
}
