//! The `[simulate]` table of a job: a given motion, and the quantities that vary between repeats.

use super::{GaitSet, Reference};
use crate::base::error::{Faults, Invalid, in_range, whole_in_range};
use crate::base::limits::{MAX_DURATION, MAX_MAP_SIZE, MAX_MOTION_STEPS, MAX_REPLANS, MAX_SIMULATIONS};
use crate::model::Robot;
use crate::model::environment::Environment;
use crate::physics::{PhysicsSpec, TICK, Targets};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Name of the procedure that this table belongs to.
pub const SIMULATE: &str = "simulate";
/// Default number of repeats if a quantity varies.
const REPEATS: u32 = 50;
/// Default for the most plans of a repeat.
const REPLANS: u32 = 20;
/// Shortest motion, s.
const SHORTEST: f64 = 0.1;

/// The `[simulate]` table. The motion is one of `steps`, `targets` and `stand`; with `replan` it is optional.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SimulateSpec {
    /// Gaits in sequence, counted from 1: a plan, or a single gait.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub steps: Option<Vec<u32>>,
    /// Planned place of the pivot after each step: x, y, z (mu) and yaw (rad).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub places: Option<Vec<[f64; 4]>>,
    /// Joint targets: a path to a CSV file, or the table itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub targets: Option<Reference<TargetTable>>,
    /// Time to stand in the robot's neutral pose, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stand: Option<f64>,
    /// The gaits of `steps` and `replan`: a path to a run's folder or to its gaits.json, or the table itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gaits: Option<Reference<GaitSet>>,
    /// Ways in which steps follow each other. Default: both.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ways: Option<Vec<Way>>,
    /// Number of repeats, each with its own draws of the quantities that vary. The motion is carried out once more
    /// without variation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub repeats: Option<u32>,
    /// Quantities that vary.
    #[serde(skip_serializing_if = "VarySpec::is_nothing")]
    pub vary: VarySpec,
    /// Replanning if the motion deviates from the plan.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub replan: Option<ReplanSpec>,
}

/// Way in which the gaits of a plan follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Way {
    /// Every gait starts from the exact end of the one before, with velocities zeroed, as planners assume.
    Resimulated,
    /// One simulation without a stop.
    Continuous,
}

impl Way {
    /// Returns the name in job files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Resimulated => "resimulated",
            Self::Continuous => "continuous",
        }
    }
}

/// Joint targets over time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetTable {
    /// Names of the robot's joints, in the robot's order.
    pub joints: Vec<String>,
    /// Rows of a time, s, and one target per joint, rad. Times begin at 0 and increase. Targets are linear between
    /// rows.
    pub rows: Vec<Vec<f64>>,
}

/// Quantities that vary between repeats. Each is drawn uniformly from its range, with its own random stream.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VarySpec {
    /// Coefficient of Coulomb friction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<[f64; 2]>,
    /// Factor of every motor's greatest torque.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motor_strength: Option<[f64; 2]>,
    /// Offset of the start's x, mu.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub x: Option<[f64; 2]>,
    /// Offset of the start's y, mu.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub y: Option<[f64; 2]>,
    /// Offset of the start's heading, rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub yaw: Option<[f64; 2]>,
    /// Number of joints, drawn uniformly, that are locked at their angle at the start.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dead_joints: Option<u32>,
    /// Standard deviation of normal noise on every joint's target, rad. Noise is drawn every 0.1 s and linear between.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub target_noise: Option<f64>,
}

/// Settings of replanning.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReplanSpec {
    /// Planar distance from the planned place beyond which a new plan is made, mu.
    #[serde(default = "deviation")]
    pub deviation: f64,
    /// Most plans of a repeat.
    #[serde(default = "replans")]
    pub most: u32,
    /// Physics on which plans are made. Default: that of the job.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub physics: Option<PhysicsSpec>,
}

fn deviation() -> f64 {
    1.0
}

fn replans() -> u32 {
    REPLANS
}

impl Default for ReplanSpec {
    fn default() -> Self {
        Self { deviation: deviation(), most: replans(), physics: None }
    }
}

impl SimulateSpec {
    /// Rejects numbers out of range and keys that contradict each other, and fills in defaults.
    pub(super) fn resolve(&mut self) -> Result<(), Invalid> {
        let mut faults = Faults::default();
        faults.take(self.one_motion());
        if let Some(steps) = &self.steps {
            let most = MAX_MOTION_STEPS as u64;
            faults.take(whole_in_range("number of simulate.steps", steps.len() as u64, (1, most), ""));
        }
        if let Some(stand) = self.stand {
            faults.take(in_range("simulate.stand", stand, (SHORTEST, MAX_DURATION), "s"));
        }
        if let Some(Reference::Inline(table)) = &self.targets {
            faults.take(table.validate());
        }
        faults.take(self.validate_places());
        faults.take(self.vary.validate());
        if let Some(ReplanSpec { deviation, most, .. }) = self.replan {
            faults.take(in_range("simulate.replan.deviation", deviation, (0.0, MAX_MAP_SIZE), "mu"));
            faults.take(whole_in_range("simulate.replan.most", most, (1, MAX_REPLANS.into()), ""));
        }
        let varies = !self.vary.is_nothing();
        let repeats = *self.repeats.get_or_insert(if varies { REPEATS } else { 0 });
        faults.take(whole_in_range("simulate.repeats", repeats, (0, MAX_SIMULATIONS.into()), ""));
        if repeats > 0 && !varies {
            let reason = "nothing varies, so all repeats would be the same: give a range in [simulate.vary], such as \
                          friction = [0.6, 1.0], or leave the key out";
            faults.take::<()>(Err(conflict("simulate.repeats", reason)));
        }
        faults.take(self.resolve_ways());
        faults.end()
    }

    fn one_motion(&self) -> Result<(), Invalid> {
        let given = [self.steps.is_some(), self.targets.is_some(), self.stand.is_some()];
        let many = given.iter().filter(|given| **given).count();
        if self.replan.is_some() && (self.targets.is_some() || self.stand.is_some()) {
            let reason = "plans are made of gaits: give simulate.steps, or no motion to have the first plan made, too";
            return Err(conflict("simulate.replan", reason));
        }
        if many > 1 || many == 0 && self.replan.is_none() {
            let reason = "it needs one motion: steps (gaits in turn), targets (a table of joint targets) or stand (s)";
            return Err(conflict("simulate", reason));
        }
        match (self.uses_gaits(), self.gaits.is_some()) {
            (true, false) => {
                Err(conflict("simulate.gaits", "simulate.steps and simulate.replan need gaits: add this key"))
            }
            (false, true) => Err(conflict(
                "simulate.gaits",
                "neither simulate.steps nor simulate.replan uses them: leave this key out",
            )),
            _ => Ok(()),
        }
    }

    fn validate_places(&self) -> Result<(), Invalid> {
        let Some(places) = &self.places else { return Ok(()) };
        if self.steps.as_ref().is_none_or(|steps| steps.len() != places.len()) {
            let steps = self.steps.as_ref().map_or(0, Vec::len);
            return Err(conflict(
                "simulate.places",
                &format!("{} places for {steps} steps: give one place per step", places.len()),
            ));
        }
        let mut faults = Faults::default();
        for (i, place) in places.iter().enumerate() {
            for (j, value) in place.iter().enumerate() {
                let (range, unit) = if j == 3 { ((-PI, PI), "rad") } else { ((-MAX_MAP_SIZE, MAX_MAP_SIZE), "mu") };
                faults.take(in_range(format!("simulate.places[{i}][{j}]"), *value, range, unit));
            }
        }
        faults.end()
    }

    fn resolve_ways(&mut self) -> Result<(), Invalid> {
        // Other motions are one simulation. With replanning the robot stops at every plan.
        let in_turn = self.steps.as_ref().is_some_and(|steps| steps.len() > 1) && self.replan.is_none();
        let fitting: &[Way] = if in_turn { &[Way::Resimulated, Way::Continuous] } else { &[Way::Resimulated] };
        let ways = self.ways.get_or_insert_with(|| fitting.to_vec());
        let repeated = ways.iter().enumerate().any(|(i, way)| ways[..i].contains(way));
        if ways.is_empty() || repeated || ways.iter().any(|way| !fitting.contains(way)) {
            let reason = if in_turn {
                "allowed are \"resimulated\" and \"continuous\", each once"
            } else {
                "only a motion of several steps without replan has a choice of ways: leave this key out"
            };
            return Err(conflict("simulate.ways", reason));
        }
        Ok(())
    }

    /// Returns true if the motion is made of gaits.
    pub(super) fn uses_gaits(&self) -> bool {
        self.steps.is_some() || self.replan.is_some()
    }

    /// Returns the duration of a motion without gaits, s.
    pub(super) fn duration(&self) -> Option<f64> {
        match (&self.targets, self.stand) {
            (Some(Reference::Inline(table)), _) => Some(table.rows.last()?[0]),
            (_, stand) => stand,
        }
    }

    /// Rejects steps with unknown gaits, places outside the map, and tables of another robot.
    pub(super) fn fits(&self, robot: &Robot, environment: &Environment, gaits: u32) -> Result<(), Invalid> {
        let mut faults = Faults::default();
        let off_map = |[x, y, ..]: &[f64; 4]| !environment.contains(*x, *y);
        if let Some(i) = self.places.iter().flatten().position(off_map) {
            let reason = format!(
                "it lies outside the map of environment \"{}\": give the places of a plan in this environment",
                environment.name
            );
            faults.take::<()>(Err(conflict(&format!("simulate.places[{i}]"), &reason)));
        }
        for (i, &step) in self.steps.iter().flatten().enumerate() {
            faults.take(whole_in_range(format!("simulate.steps[{i}]"), step, (1, gaits.into()), ""));
        }
        match &self.targets {
            Some(Reference::Inline(table)) => {
                faults.take(table.fits(robot));
            }
            Some(Reference::Named(path)) => {
                let reason = format!(
                    "\"{path}\" is a path, and only the `evogait` command reads paths: write the table into the job"
                );
                faults.take::<()>(Err(conflict("simulate.targets", &reason)));
            }
            None => {}
        }
        if let Some(dead) = self.vary.dead_joints {
            let joints = robot.hinges.len() as u64;
            faults.take(whole_in_range("simulate.vary.dead_joints", dead, (0, joints), ""));
        }
        faults.end()
    }
}

impl TargetTable {
    fn validate(&self) -> Result<(), Invalid> {
        let of_row = |i: usize, reason: String| Err(conflict(&format!("simulate.targets.rows[{i}]"), &reason));
        let mut before = None;
        for (i, row) in self.rows.iter().enumerate() {
            let wanted = self.joints.len() + 1;
            if row.len() != wanted {
                return of_row(
                    i,
                    format!("it has {} numbers: {wanted} are needed, a time and one target per joint", row.len()),
                );
            }
            if let Some(target) = row[1..].iter().find(|target| !(-PI..=PI).contains(*target)) {
                return of_row(i, format!("target {target} is out of range: allowed is −π to π rad"));
            }
            let later = before.map_or(row[0] == 0.0, |before| row[0] > before);
            if !later || row[0] > MAX_DURATION {
                let most = format!("times must begin at 0, increase, and be at most {MAX_DURATION} s");
                return of_row(i, format!("its time is {} s: {most}", row[0]));
            }
            before = Some(row[0]);
        }
        let last = before.unwrap_or(0.0);
        in_range("time of the last row of simulate.targets", last, (SHORTEST, MAX_DURATION), "s")
    }

    fn fits(&self, robot: &Robot) -> Result<(), Invalid> {
        let joints = robot.joint_names();
        if self.joints == joints {
            return Ok(());
        }
        let told = if self.joints.is_empty() { "none".to_owned() } else { self.joints.join(", ") };
        let (name, joints) = (&robot.name, joints.join(", "));
        Err(conflict(
            "simulate.targets.joints",
            &format!("they are {told}, but robot \"{name}\" has {joints}: name the robot's joints, in this order"),
        ))
    }

    /// Returns the targets on ticks, up to a time, s, that is not before the last row.
    pub(crate) fn targets(&self, duration: f64) -> Targets {
        let rows: Vec<(f64, Vec<f64>)> = self.rows.iter().map(|row| (row[0], row[1..].to_vec())).collect();
        Targets::between(&rows, duration)
    }
}

impl VarySpec {
    /// Returns true if nothing varies.
    pub fn is_nothing(&self) -> bool {
        *self == Self::default()
    }

    fn validate(&self) -> Result<(), Invalid> {
        let mut faults = Faults::default();
        let map = (-MAX_MAP_SIZE, MAX_MAP_SIZE);
        for (name, range, allowed, unit) in [
            ("friction", self.friction, (0.0, 10.0), ""),
            ("motor_strength", self.motor_strength, (0.0, 10.0), ""),
            ("x", self.x, map, "mu"),
            ("y", self.y, map, "mu"),
            ("yaw", self.yaw, (-PI, PI), "rad"),
        ] {
            let Some([low, high]) = range else { continue };
            let field = format!("simulate.vary.{name}");
            faults.take(in_range(format!("{field}[0]"), low, allowed, unit));
            faults.take(in_range(format!("{field}[1]"), high, allowed, unit));
            if low > high {
                faults.take::<()>(Err(conflict(
                    &field,
                    &format!("the range begins at {low}, above its end {high}: put the smaller number first"),
                )));
            }
        }
        if let Some(noise) = self.target_noise {
            faults.take(in_range("simulate.vary.target_noise", noise, (0.0, PI), "rad"));
        }
        faults.end()
    }
}

/// Returns the first time from `seconds` on, s, that ends both a whole physics step and a whole tick.
pub(super) fn whole_time(seconds: f64, steps_per_second: u32) -> f64 {
    let ticks_per_second = libm::round(1.0 / TICK) as u32;
    let common = f64::from(greatest_divisor(steps_per_second, ticks_per_second));
    libm::ceil(seconds * common - 1e-9) / common
}

fn greatest_divisor(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { greatest_divisor(b, a % b) }
}

fn conflict(field: &str, reason: &str) -> Invalid {
    Invalid::Conflict { field: field.to_owned(), reason: reason.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_ends_with_whole_step_and_tick() {
        for (seconds, rate, expected) in [
            (1.0, 30, 1.0),
            (0.123, 30, 0.2),
            (0.123, 60, 0.15),
            (0.123, 200, 0.125),
            (0.123, 600, 0.125),
            (2.5, 7, 3.0),
        ] {
            let found = whole_time(seconds, rate);
            assert!((found - expected).abs() < 1e-12, "{seconds} s at {rate}: {found}");
        }
    }
}
