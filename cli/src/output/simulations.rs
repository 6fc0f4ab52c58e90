//! Files of a job that simulated: result.json, and tables of its runs.

use super::result::{Counts, Digests, Versions, wall_seconds};
use crate::values;
use proto::v1;
use serde::{Deserialize, Serialize};
use sim_core::base::digest::Digest;
use sim_core::base::statistics::{median, share_interval};
use sim_core::problem::{Checked, Way};
use sim_core::procedure::simulate::{Ended, Recorded, Run, SimulationReport};
use std::fmt::Write as _;
use study::setting::PhysicsSetting;

/// Version of the layout of the file.
const FORMAT: u32 = 1;

/// Result of a job that simulated. Lengths in mu, angles in rad, times in s. Numbers read back to the same bits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SimulationFile {
    /// Version of the layout.
    pub format: u32,
    /// Always "simulate".
    pub procedure: String,
    /// Name of the job.
    pub name: String,
    /// Seed of the job.
    pub seed: u64,
    /// Digest of the job.
    pub job_digest: Digest,
    /// Digest of the result, over the bits of all runs.
    pub result_digest: Digest,
    /// Digest of the engine that computed the result.
    pub engine_digest: Digest,
    /// Engine and its setting, such as `200x2-lockstep`.
    pub engine: String,
    /// Engine and setting of replanning; absent for a job without replanning.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub planning: Option<String>,
    /// Name of the robot.
    pub robot: String,
    /// Name of the environment.
    pub environment: String,
    /// Runs of each way: the motion with nothing varied, and statistics of the repeats.
    pub ways: Vec<OfWay>,
    /// Sums of the counts over all runs.
    pub counts: Counts,
    /// Time from the first lease of a task to the end, s; pauses included.
    pub wall_seconds: f64,
    /// Versions of the program and crates that wrote the file.
    pub versions: Versions,
}

/// Runs of the motion in one way.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OfWay {
    /// Way: "resimulated" (every gait starts from rest) or "continuous" (without stops).
    pub way: Way,
    /// Numbers of the run with nothing varied.
    pub unvaried: RunNumbers,
    /// Statistics over the repeats; `null` without repeats.
    pub repeats: Option<Statistics>,
}

/// Numbers of a run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunNumbers {
    /// "completed", or the reason why the run did not complete or could not start.
    pub ended: String,
    /// True if the run completed on the map without touching an obstacle, and ended within the goal's radius if there
    /// is a goal.
    pub success: bool,
    /// Displacement ahead, in the frame of the start.
    pub ahead: f64,
    /// Displacement to the left, in the frame of the start.
    pub left: f64,
    /// Change of heading, in (−π, π].
    pub turned: f64,
    /// Planar distance from the start to the end.
    pub displacement: f64,
    /// Length of the pivot's path in the plane.
    pub travelled: f64,
    /// Planar distance from the end to the goal; `null` without a goal.
    pub distance: Option<f64>,
    /// Planar distance from the end to the planned end; `null` for a motion without a plan.
    pub deviation: Option<f64>,
    /// Time of the first contact with an obstacle; `null` if there was none.
    pub touched: Option<f64>,
    /// True if the pivot left the map.
    pub left_map: bool,
    /// Simulated time until the end.
    pub seconds: f64,
    /// Mechanical work of the motors, kg·mu²/s².
    pub work: f64,
    /// Sum of the absolute mechanical work of the motors, kg·mu²/s².
    pub turnover: f64,
    /// Mean fraction of the bodies that touch the ground or terrain, from 0 to 1.
    pub contact: f64,
    /// Number of gaits executed.
    pub gaits: u32,
    /// Number of new plans made during the run.
    pub replans: u32,
}

/// Statistics over repeats. Statistics of numbers are over the repeats that completed; units are those of [`RunNumbers`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    /// Number of repeats.
    pub repeats: u32,
    /// Fraction of repeats that succeeded.
    pub success: Share,
    /// Repeats that did not complete.
    pub broken: u32,
    /// Repeats that could not start at their varied start.
    pub without_start: u32,
    /// Repeats that touched an obstacle.
    pub touched: u32,
    /// Repeats that left the map.
    pub left_map: u32,
    /// Displacement ahead.
    pub ahead: Option<Values>,
    /// Displacement to the left.
    pub left: Option<Values>,
    /// Change of heading.
    pub turned: Option<Values>,
    /// Planar distance from the start to the end.
    pub displacement: Option<Values>,
    /// Length of the pivot's path.
    pub travelled: Option<Values>,
    /// Distance from the end to the goal.
    pub distance: Option<Values>,
    /// Distance from the end to the planned end.
    pub deviation: Option<Values>,
    /// Simulated time until the end.
    pub seconds: Option<Values>,
    /// Mechanical work of the motors.
    pub work: Option<Values>,
    /// Sum of the absolute mechanical work of the motors.
    pub turnover: Option<Values>,
    /// Mean fraction of bodies in contact.
    pub contact: Option<Values>,
    /// Number of new plans made during a run.
    pub replans: Option<Values>,
}

/// Fraction and its confidence interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// Number of successes.
    pub count: u32,
    /// Number of trials.
    pub of: u32,
    /// 95 % score interval of the fraction (Wilson 1927), from 0 to 1.
    pub interval: [f64; 2],
}

/// Mean, spread and order statistics.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Values {
    /// Mean of the values.
    pub mean: f64,
    /// Sample standard deviation; `null` for one value.
    pub deviation: Option<f64>,
    /// Least value.
    pub least: f64,
    /// Median of the values.
    pub median: f64,
    /// Greatest value.
    pub greatest: f64,
}

impl SimulationFile {
    /// Creates the content of result.json from a coordinator's answer.
    pub(super) fn new(job: &Checked, status: &v1::Job, digests: &Digests, report: &SimulationReport) -> Self {
        let of_way = |(i, recorded): (usize, &Recorded)| {
            let runs: Vec<&Run> = report.repeats.iter().filter_map(|runs| runs.get(i)).collect();
            OfWay {
                way: recorded.run.way,
                unvaried: RunNumbers::of(job, &recorded.run),
                repeats: (!runs.is_empty()).then(|| Statistics::of(job, &runs)),
            }
        };
        Self {
            format: FORMAT,
            procedure: "simulate".to_owned(),
            name: job.spec().name.clone(),
            seed: job.spec().seed,
            job_digest: digests.job,
            result_digest: digests.result,
            engine_digest: digests.engine,
            engine: PhysicsSetting::of(job).to_string(),
            planning: job.on_reference().map(|planning| PhysicsSetting::of(planning).to_string()),
            robot: job.robot_spec().name.clone(),
            environment: job.environment().name.clone(),
            ways: report.unvaried.iter().enumerate().map(of_way).collect(),
            counts: Counts::told(&values::progress(status).values),
            wall_seconds: wall_seconds(status),
            versions: Versions::here(),
        }
    }
}

impl RunNumbers {
    fn of(job: &Checked, run: &Run) -> Self {
        let got = run.displacement();
        Self {
            ended: match &run.ended {
                Ended::Completed => "completed".to_owned(),
                Ended::Broken(reason) | Ended::NoStart(reason) => reason.clone(),
            },
            success: run.succeeded(job),
            ahead: got.x,
            left: got.y,
            turned: got.yaw,
            displacement: run.start().planar_distance(&run.end()),
            travelled: run.travelled,
            distance: run.distance(job),
            deviation: run.deviation(job),
            touched: run.touched,
            left_map: run.left_map,
            seconds: run.seconds,
            work: run.work,
            turnover: run.turnover,
            contact: run.contact.iter().sum::<f64>() / run.contact.len().max(1) as f64,
            gaits: run.gaits.len() as u32,
            replans: run.replans,
        }
    }
}

impl Statistics {
    fn of(job: &Checked, runs: &[&Run]) -> Self {
        let told: Vec<RunNumbers> = runs.iter().map(|run| RunNumbers::of(job, run)).collect();
        let many = |wanted: &dyn Fn(&Run) -> bool| runs.iter().filter(|run| wanted(run)).count() as u32;
        let sound: Vec<&RunNumbers> =
            told.iter().zip(runs).filter(|(_, run)| run.ended == Ended::Completed).map(|(told, _)| told).collect();
        let values = |value: &dyn Fn(&RunNumbers) -> Option<f64>| {
            Values::of(&sound.iter().filter_map(|told| value(told)).collect::<Vec<f64>>())
        };
        let (count, of) = (told.iter().filter(|told| told.success).count() as u32, runs.len() as u32);
        Self {
            repeats: of,
            success: Share { count, of, interval: share_interval(count, of).into() },
            broken: many(&|run| matches!(run.ended, Ended::Broken(_))),
            without_start: many(&|run| matches!(run.ended, Ended::NoStart(_))),
            touched: many(&|run| run.touched.is_some()),
            left_map: many(&|run| run.left_map),
            ahead: values(&|told| Some(told.ahead)),
            left: values(&|told| Some(told.left)),
            turned: values(&|told| Some(told.turned)),
            displacement: values(&|told| Some(told.displacement)),
            travelled: values(&|told| Some(told.travelled)),
            distance: values(&|told| told.distance),
            deviation: values(&|told| told.deviation),
            seconds: values(&|told| Some(told.seconds)),
            work: values(&|told| Some(told.work)),
            turnover: values(&|told| Some(told.turnover)),
            contact: values(&|told| Some(told.contact)),
            replans: values(&|told| job.on_reference().map(|_| f64::from(told.replans))),
        }
    }
}

impl Values {
    /// Computes the statistics; `None` without values.
    fn of(values: &[f64]) -> Option<Self> {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
        Some(Self {
            median: median(values)?,
            mean,
            deviation: (values.len() > 1).then(|| (squares / (n - 1.0)).sqrt()),
            least: values.iter().copied().fold(f64::INFINITY, f64::min),
            greatest: values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        })
    }
}

/// Formats runs.csv, with a row per run. `repeat` is empty for a run with nothing varied. Other cells are empty if the
/// run has no such number.
pub(super) fn table(job: &Checked, report: &SimulationReport) -> String {
    let mut head = "repeat,way,friction,motor_strength,start_x,start_y,start_yaw,dead_joints,success,ended,seconds,\
                    end_x,end_y,end_z,end_yaw,ahead,left,turned,displacement,travelled,distance,deviation,touched,\
                    left_map,work,turnover,contact,gaits,replans"
        .to_owned();
    report.bodies.iter().for_each(|body| head += &format!(",contact_{body}"));
    let mut out = head + "\n";
    let unvaried = report.unvaried.iter().map(|recorded| (None, &recorded.run));
    let repeats = report.repeats.iter().enumerate().flat_map(|(i, runs)| runs.iter().map(move |run| (Some(i), run)));
    for (repeat, run) in unvaried.chain(repeats) {
        let told = RunNumbers::of(job, run);
        let dead: Vec<&str> =
            run.drawn.dead.iter().filter_map(|&i| Some(report.joints.get(i as usize)?.as_str())).collect();
        let ended = match &run.ended {
            Ended::Completed => "completed",
            Ended::Broken(_) => "broken",
            Ended::NoStart(_) => "no start",
        };
        let gaits: Vec<String> = run.gaits.iter().map(|gait| (gait + 1).to_string()).collect();
        let cell = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
        let repeat = repeat.map_or_else(String::new, |repeat| repeat.to_string());
        let ([x, y, yaw], [end_x, end_y, end_z, end_yaw]) = (run.drawn.start, run.end);
        // Writing to a String can't fail.
        let _ = write!(
            out,
            "{repeat},{},{},{},{x},{y},{yaw},{},{},{ended},{},{end_x},{end_y},{end_z},{end_yaw},{},{},{},{},{},{},{},{},{},{},{},{},{},{}",
            run.way.name(),
            run.drawn.friction,
            run.drawn.motor_strength,
            dead.join(" "),
            told.success,
            told.seconds,
            told.ahead,
            told.left,
            told.turned,
            told.displacement,
            told.travelled,
            cell(told.distance),
            cell(told.deviation),
            cell(told.touched),
            told.left_map,
            told.work,
            told.turnover,
            told.contact,
            gaits.join(" "),
            told.replans
        );
        run.contact.iter().for_each(|share| out += &format!(",{share}"));
        out.push('\n');
    }
    out
}

/// Formats motion-WAY.csv, with a row per sample of the run with nothing varied: time (s), joint targets and angles
/// (rad), the pivot's position (mu), rotation (unit quaternion) and yaw (rad), and for each body 1 if it touches the
/// ground or terrain, else 0.
pub(super) fn motion(report: &SimulationReport, recorded: &Recorded) -> String {
    let samples = super::csv::samples(&report.joints, &recorded.samples);
    let heads = std::iter::once(report.bodies.iter().map(|body| format!("touch_{body}")).collect::<Vec<_>>());
    let rows = recorded.touching.iter().map(|row| row.iter().map(|touches| u8::from(*touches).to_string()).collect());
    let joined = samples.lines().zip(heads.chain(rows)).map(|(line, more)| format!("{line},{}\n", more.join(",")));
    joined.collect()
}

/// Formats paths.csv, with a row per point (mu) of the pivot's path in every run. `repeat` is empty for a run with
/// nothing varied.
pub(super) fn paths(report: &SimulationReport) -> String {
    let mut out = "repeat,way,point,x,y\n".to_owned();
    let unvaried = report.unvaried.iter().map(|recorded| (String::new(), &recorded.run));
    let repeats =
        report.repeats.iter().enumerate().flat_map(|(i, runs)| runs.iter().map(move |run| (i.to_string(), run)));
    for (repeat, run) in unvaried.chain(repeats) {
        for (point, [x, y]) in run.path.iter().enumerate() {
            let _ = writeln!(out, "{repeat},{},{point},{x},{y}", run.way.name());
        }
    }
    out
}
