//! Fidelity: agreement of an engine setting with a reference on the same gaits.
//!
//! Gaits with many contacts are chaotic, so a setting can't agree with the reference better than the reference agrees
//! with itself from slightly disturbed starts. This self-agreement is the *ceiling*: compare every fidelity with it. A
//! reference is fine enough if halving its step changes its results no more than the disturbed starts do.

pub mod comparison;
pub mod table;

use crate::statistics::{Estimate, bootstrap, spearman};
use serde::{Deserialize, Serialize};
use sim_core::base::math::{heading, wrap};
use sim_core::base::random::{Purpose, Stream};
use sim_core::base::statistics::{median, quantile};
use sim_core::model::{Place, State};
use sim_core::physics::{Outcome, Rollout};

/// Difference of every joint angle of a disturbed start from the original start, rad.
pub const DISTURBANCE: f32 = 1e-6;

/// Agreement of one setting with a reference on the same gaits from the same start. Intervals are 95 % bootstrap
/// intervals over the gaits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fidelity {
    /// Number of gaits compared: those that completed with both settings.
    pub gaits: usize,
    /// Number of gaits not compared, because they were unstable with the setting or the reference.
    pub unstable: usize,
    /// Planar distance between the two positions of the pivot after the gait, mu.
    pub position: Errors,
    /// Difference of the headings, rad.
    pub yaw: Errors,
    /// |Δx| of the final positions along the initial heading, mu.
    pub x: Errors,
    /// |Δy| of the final positions across the initial heading, mu.
    pub y: Errors,
    /// Median of the position error divided by the planar distance that the reference travelled. Gaits in which the
    /// reference does not move are left out.
    pub relative: Option<Estimate>,
    /// Spearman's rank correlation of the planar distances travelled. `None` if all distances of either setting are
    /// equal.
    pub spearman: Option<Estimate>,
}

/// Distribution of an error over gaits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Median of the errors.
    pub median: Estimate,
    /// 95th percentile of the errors.
    pub p95: Estimate,
}

/// Returns the final place of a rollout in the frame of its initial place; `None` if the rollout did not complete.
pub fn arrival(rollout: &Rollout, from: &Place) -> Option<Place> {
    let at = rollout.end.pivot.translation;
    let yaw = heading(rollout.end.pivot.rotation);
    let end = Place { x: at.x.into(), y: at.y.into(), z: at.z.into(), yaw };
    (rollout.outcome == Outcome::Completed).then(|| from.seen(&end))
}

/// Returns the start with [`DISTURBANCE`] added to or subtracted from every joint angle at random. `gait` selects the
/// random stream.
pub fn disturbed(start: &State, gait: u32) -> State {
    let mut stream = Stream::new(0, Purpose::Sample, 0, gait, 1);
    let mut off = |angle: &f32| if stream.unit() < 0.5 { angle - DISTURBANCE } else { angle + DISTURBANCE };
    State::new(start.pivot, start.joints.iter().map(&mut off).collect())
}

/// Compares the final places of gaits with a setting and with the reference, gait by gait. A place of `None` is one of
/// a rollout that did not complete. Returns `None` if no gait completed with both.
///
/// # Panics
/// If the two slices differ in length.
pub fn compare(reference: &[Option<Place>], setting: &[Option<Place>]) -> Option<Fidelity> {
    assert_eq!(reference.len(), setting.len(), "both settings need an entry for every gait");
    let pairs: Vec<(Place, Place)> = reference.iter().zip(setting).filter_map(|(r, s)| Some(((*r)?, (*s)?))).collect();
    let distance: Vec<f64> = pairs.iter().map(|(r, s)| r.planar_distance(s)).collect();
    let of = |difference: &dyn Fn(&Place, &Place) -> f64| {
        errors(&pairs.iter().map(|(r, s)| difference(r, s)).collect::<Vec<_>>())
    };
    let travelled = |place: &Place| place.planar_distance(&Place::ORIGIN);
    let way: Vec<(f64, f64)> = pairs.iter().map(|(r, s)| (travelled(r), travelled(s))).collect();
    let relative: Vec<f64> = way.iter().zip(&distance).filter(|(w, _)| w.0 > 0.0).map(|(w, d)| d / w.0).collect();
    Some(Fidelity {
        gaits: pairs.len(),
        unstable: reference.len() - pairs.len(),
        position: errors(&distance)?,
        yaw: of(&|r, s| wrap(r.yaw - s.yaw).abs())?,
        x: of(&|r, s| (r.x - s.x).abs())?,
        y: of(&|r, s| (r.y - s.y).abs())?,
        relative: estimate(relative.len(), |members| median(&picked(&relative, members))),
        spearman: estimate(way.len(), |members| {
            let (r, s): (Vec<f64>, Vec<f64>) = members.iter().map(|&i| way[i]).unzip();
            spearman(&r, &s)
        }),
    })
}

fn errors(values: &[f64]) -> Option<Errors> {
    let of = |p: f64| estimate(values.len(), |members| quantile(&picked(values, members), p));
    Some(Errors { median: of(0.5)?, p95: of(0.95)? })
}

fn picked(values: &[f64], members: &[usize]) -> Vec<f64> {
    members.iter().map(|&i| values[i]).collect()
}

/// Bootstraps a statistic. All estimates use the same resamples, so that differences between settings do not come from
/// the resampling.
fn estimate(n: usize, statistic: impl Fn(&[usize]) -> Option<f64>) -> Option<Estimate> {
    bootstrap(n as u32, &mut Stream::new(0, Purpose::Bootstrap, 0, 0, 0), statistic)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Places along a line, with different headings.
    fn places() -> Vec<Option<Place>> {
        (1..=20).map(|i| Some(Place { x: f64::from(i), y: 0.0, z: 0.5, yaw: wrap(0.5 * f64::from(i)) })).collect()
    }

    fn moved(dx: f64, dy: f64, turn: f64) -> Vec<Option<Place>> {
        let moved = |p: Place| Place { x: p.x + dx, y: p.y + dy, yaw: wrap(p.yaw + turn), ..p };
        places().into_iter().map(|p| p.map(moved)).collect()
    }

    #[test]
    fn setting_agrees_with_itself_completely() {
        let found = compare(&places(), &places()).unwrap();
        let none = Estimate { value: 0.0, low: 0.0, high: 0.0 };
        for errors in [found.position, found.yaw, found.x, found.y] {
            assert_eq!(errors, Errors { median: none, p95: none });
        }
        assert_eq!((found.gaits, found.unstable, found.relative), (20, 0, Some(none)));
        assert_eq!(found.spearman, Some(Estimate { value: 1.0, low: 1.0, high: 1.0 }));
    }

    #[test]
    fn constant_error_is_measured_exactly() {
        let found = compare(&places(), &moved(0.3, -0.4, 0.2)).unwrap();
        let is = |estimate: Estimate, value: f64| {
            let all = [estimate.low, estimate.value, estimate.high];
            assert!(all.iter().all(|v| (v - value).abs() < 1e-9), "estimate {estimate:?} must be {value}");
        };
        for (errors, value) in [(found.position, 0.5), (found.yaw, 0.2), (found.x, 0.3), (found.y, 0.4)] {
            is(errors.median, value);
            is(errors.p95, value);
        }
        // 0.5 / x for x of 1 to 20: the median of 1/x lies between 1/11 and 1/10.
        let relative = found.relative.unwrap();
        assert!((relative.value - 0.5 * (1.0 / 10.0 + 1.0 / 11.0) / 2.0).abs() < 1e-12, "{relative:?}");
        assert!(relative.low < relative.value && relative.value < relative.high);
    }

    #[test]
    fn seen_place_is_the_inverse_of_then() {
        let frame = Place { x: 3.0, y: -2.0, z: 0.5, yaw: 2.5 };
        for place in places().into_iter().flatten() {
            let seen = frame.seen(&frame.then(&place));
            assert!(seen.planar_distance(&place) < 1e-12 && seen.z == place.z, "{seen:?}");
            assert!(wrap(seen.yaw - place.yaw).abs() < 1e-12, "{seen:?}");
        }
    }

    #[test]
    fn yaw_error_is_shorter_angle_between_headings() {
        let at = |yaw: f64| vec![Some(Place { x: 1.0, y: 0.0, z: 0.0, yaw })];
        let found = compare(&at(PI - 0.1), &at(0.1 - PI)).unwrap();
        assert!((found.yaw.median.value - 0.2).abs() < 1e-12);
        assert_eq!(found.spearman, None, "one gait must have no rank correlation");
    }

    #[test]
    fn unstable_gaits_are_counted_but_not_compared() {
        let mut setting = moved(1.0, 0.0, 0.0);
        (setting[0], setting[7]) = (None, None);
        let mut reference = places();
        reference[7] = None;
        let found = compare(&reference, &setting).unwrap();
        assert_eq!((found.gaits, found.unstable), (18, 2));
        assert_eq!(compare(&[None], &[None]), None);
    }

    #[test]
    fn disturbed_start_differs_in_every_joint() {
        let start = State::new(sim_core::base::math::Pose::IDENTITY, vec![0.1; 32]);
        let (one, two) = (disturbed(&start, 1), disturbed(&start, 2));
        assert_eq!(one, disturbed(&start, 1));
        assert_ne!(one, two);
        assert_eq!(one.pivot, start.pivot);
        for joint in &one.joints {
            assert!(((joint - 0.1).abs() - DISTURBANCE).abs() < 1e-8, "{joint}");
        }
        assert!(one.joints.iter().any(|j| *j > 0.1) && one.joints.iter().any(|j| *j < 0.1));
    }
}
