//! Fidelity: how near an engine setting comes to a reference on the same gaits.
//!
//! Contact-rich gaits are chaotic, so two settings can't agree better than the reference agrees with itself from starts
//! that hardly differ. That is the *ceiling*, and every fidelity is to be read against it. A reference is worth its name
//! where halving its own step changes no more than that.

pub mod comparison;
pub mod table;

use crate::statistics::{Estimate, bootstrap, spearman};
use serde::{Deserialize, Serialize};
use sim_core::base::math::{heading, wrap};
use sim_core::base::random::{Purpose, Stream};
use sim_core::base::statistics::{median, quantile};
use sim_core::model::{Place, State};
use sim_core::physics::{Outcome, Rollout};

/// How far joint angles of a disturbed start are off, rad.
pub const DISTURBANCE: f32 = 1e-6;

/// How near one setting comes to a reference on the same gaits from the same start. Intervals are 95 % bootstrap
/// intervals over the gaits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fidelity {
    /// Gaits that both completed: those compared.
    pub gaits: usize,
    /// Gaits that were unstable with the setting or the reference, and so are not compared.
    pub unstable: usize,
    /// Distance between the two places of the pivot after the gait, mu.
    pub position: Errors,
    /// Difference of the headings, rad.
    pub yaw: Errors,
    /// |Δx|, mu: along the robot's first heading.
    pub x: Errors,
    /// |Δy|, mu.
    pub y: Errors,
    /// Median of the distance between the two places relative to the way the reference went. Gaits with which the
    /// reference stays where it is have none.
    pub relative: Option<Estimate>,
    /// Spearman's rank correlation of the planar distances travelled. `None` if all travel the same.
    pub spearman: Option<Estimate>,
}

/// Errors over gaits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Errors {
    /// Half of the gaits have a smaller error.
    pub median: Estimate,
    /// One of twenty has a greater one.
    pub p95: Estimate,
}

/// Where a rollout ends, in the frame of the place where it started; `None` if it was unstable.
pub fn arrival(rollout: &Rollout, from: &Place) -> Option<Place> {
    let at = rollout.end.pivot.translation;
    let yaw = heading(rollout.end.pivot.rotation);
    let end = Place { x: at.x.into(), y: at.y.into(), z: at.z.into(), yaw };
    (rollout.outcome == Outcome::Completed).then(|| from.seen(&end))
}

/// A start with every joint angle off by [`DISTURBANCE`] to one side or the other.
pub fn disturbed(start: &State, gait: u32) -> State {
    let mut stream = Stream::new(0, Purpose::Sample, 0, gait, 1);
    let mut off = |angle: &f32| if stream.unit() < 0.5 { angle - DISTURBANCE } else { angle + DISTURBANCE };
    State::new(start.pivot, start.joints.iter().map(&mut off).collect())
}

/// Compares where gaits lead with a setting and with the reference, gait by gait; `None` stands for an unstable rollout.
/// `None` if no gait completed with both.
///
/// # Panics
/// If the two are not of the same length.
pub fn compare(reference: &[Option<Place>], setting: &[Option<Place>]) -> Option<Fidelity> {
    assert_eq!(reference.len(), setting.len(), "the same gaits are compared");
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

/// Every estimate is made from the same resamples: differences between settings are not those of luck.
fn estimate(n: usize, statistic: impl Fn(&[usize]) -> Option<f64>) -> Option<Estimate> {
    bootstrap(n as u32, &mut Stream::new(0, Purpose::Bootstrap, 0, 0, 0), statistic)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// Places along a line, at all headings.
    fn places() -> Vec<Option<Place>> {
        (1..=20).map(|i| Some(Place { x: f64::from(i), y: 0.0, z: 0.5, yaw: wrap(0.5 * f64::from(i)) })).collect()
    }

    fn moved(dx: f64, dy: f64, turn: f64) -> Vec<Option<Place>> {
        let moved = |p: Place| Place { x: p.x + dx, y: p.y + dy, yaw: wrap(p.yaw + turn), ..p };
        places().into_iter().map(|p| p.map(moved)).collect()
    }

    #[test]
    fn a_setting_agrees_with_itself() {
        let found = compare(&places(), &places()).unwrap();
        let none = Estimate { value: 0.0, low: 0.0, high: 0.0 };
        for errors in [found.position, found.yaw, found.x, found.y] {
            assert_eq!(errors, Errors { median: none, p95: none });
        }
        assert_eq!((found.gaits, found.unstable, found.relative), (20, 0, Some(none)));
        assert_eq!(found.spearman, Some(Estimate { value: 1.0, low: 1.0, high: 1.0 }));
    }

    #[test]
    fn a_constant_error_is_measured_as_what_it_is() {
        let found = compare(&places(), &moved(0.3, -0.4, 0.2)).unwrap();
        let is = |estimate: Estimate, value: f64| {
            let all = [estimate.low, estimate.value, estimate.high];
            assert!(all.iter().all(|v| (v - value).abs() < 1e-9), "{estimate:?}, not {value}");
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
    fn a_place_is_seen_from_another_as_it_was_laid_out_there() {
        let frame = Place { x: 3.0, y: -2.0, z: 0.5, yaw: 2.5 };
        for place in places().into_iter().flatten() {
            let seen = frame.seen(&frame.then(&place));
            assert!(seen.planar_distance(&place) < 1e-12 && seen.z == place.z, "{seen:?}");
            assert!(wrap(seen.yaw - place.yaw).abs() < 1e-12, "{seen:?}");
        }
    }

    #[test]
    fn headings_are_compared_the_short_way_round() {
        let at = |yaw: f64| vec![Some(Place { x: 1.0, y: 0.0, z: 0.0, yaw })];
        let found = compare(&at(PI - 0.1), &at(0.1 - PI)).unwrap();
        assert!((found.yaw.median.value - 0.2).abs() < 1e-12);
        assert_eq!(found.spearman, None, "one gait has no order");
    }

    #[test]
    fn unstable_gaits_are_counted_and_not_compared() {
        let mut setting = moved(1.0, 0.0, 0.0);
        (setting[0], setting[7]) = (None, None);
        let mut reference = places();
        reference[7] = None;
        let found = compare(&reference, &setting).unwrap();
        assert_eq!((found.gaits, found.unstable), (18, 2));
        assert_eq!(compare(&[None], &[None]), None);
    }

    #[test]
    fn a_disturbed_start_is_off_by_a_millionth_in_every_joint() {
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
