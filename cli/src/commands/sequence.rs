//! `evogait sequence`: checks a motion sequence of M-TRAN modules, tabulates its joint targets, or simulates it.

use super::run::carry_out;
use super::simulate::{finer, with_robot};
use crate::arguments::{Sequence, SequenceAction};
use crate::console::{self, table};
use crate::error::Error;
use crate::output::atomic;
use crate::{inputs, load};
use serde::Serialize;
use sim_core::base::error::Invalid;
use sim_core::control::sequence::{self, MAX_PROGRAM_LENGTH, Program, Refusal, Semantics, Step};
use sim_core::job::Reference;
use sim_core::model::mtran::{Configuration, Connection};
use sim_core::model::{Robot, RobotSpec};
use sim_core::problem::{Checked, SimulateSpec, TargetTable};
use std::fs::File;
use std::io::Read as _;
use std::path::Path;

/// Runs the command.
pub fn run(args: Sequence, quiet: bool) -> Result<(), Error> {
    let program = read(&args.file)?;
    let file = load::robot(&args.robot, None)?;
    let robot = Robot::compile(&file.spec).map_err(|source| invalid(&file.label, source))?;
    match args.action {
        SequenceAction::Check { json } => check(&args.file, &program, &robot, &file.label, json, quiet),
        SequenceAction::Targets { duration, out } => {
            let rows = target_rows(&program, &robot, duration, &file.label)?;
            let text = csv(&robot, &rows);
            match out {
                Some(path) => atomic::write_file(&path, text.as_bytes()),
                None => console::say(&text),
            }
        }
        SequenceAction::Run { duration, fine, to } => {
            let rows = target_rows(&program, &robot, duration, &file.label)?;
            let job = job(file.spec, &robot, rows, fine)?;
            carry_out(&job, to, quiet)
        }
    }
}

fn invalid(label: &str, source: Invalid) -> Error {
    Error::Invalid { file: label.to_owned(), source }
}

/// Reads a program.
fn read(path: &Path) -> Result<Program, Error> {
    let mut text = String::new();
    let read = File::open(path).and_then(|file| file.take(MAX_PROGRAM_LENGTH as u64 + 1).read_to_string(&mut text));
    read.map_err(|source| Error::read(path, source))?;
    inputs::record(path);
    sequence::parse(&text).map_err(|error| Error::Sequence { file: path.to_owned(), reason: error.to_string() })
}

fn target_rows(program: &Program, robot: &Robot, duration: f64, label: &str) -> Result<Vec<Vec<f64>>, Error> {
    sequence::target_rows(program, robot, duration).map_err(|source| invalid(label, source))
}

/// Returns the job that simulates a table of targets.
fn job(spec: RobotSpec, robot: &Robot, rows: Vec<Vec<f64>>, fine: bool) -> Result<Checked, Error> {
    let table = TargetTable { joints: robot.joint_names(), rows };
    let simulate = SimulateSpec { targets: Some(Reference::Inline(Box::new(table))), ..SimulateSpec::default() };
    let name = spec.name.clone();
    let mut job = with_robot(spec, "sequence", simulate);
    if fine {
        job.physics = finer(&job.physics);
    }
    Checked::new(job).map_err(|source| invalid(&name, source))
}

fn csv(robot: &Robot, rows: &[Vec<f64>]) -> String {
    let mut text = format!("time,{}\n", robot.joint_names().join(","));
    for row in rows {
        let cells: Vec<String> = row.iter().map(f64::to_string).collect();
        text += &(cells.join(",") + "\n");
    }
    text
}

/// Effect of a segment, for `--json`.
#[derive(Serialize)]
struct SegmentView {
    /// Index of the segment with all loops unrolled, from 0.
    segment: usize,
    /// Text of the segment.
    text: String,
    /// Duration, s.
    duration: f64,
    /// Connections that it cuts.
    cut: Vec<String>,
    /// Connections that it makes.
    made: Vec<String>,
}

/// Result of a check, for `--json`.
#[derive(Serialize)]
struct CheckView {
    robot: String,
    modules: usize,
    /// Time of a repeat, s.
    duration: f64,
    segments: Vec<SegmentView>,
    /// Reason why the program can't be repeated although each segment is feasible once; `null` if it can.
    repeat: Option<String>,
}

fn check(file: &Path, program: &Program, robot: &Robot, label: &str, json: bool, quiet: bool) -> Result<(), Error> {
    let configuration = Configuration::of_robot(robot).ok_or_else(|| {
        let reason = "a motion sequence needs a robot of modules of kind \"mtran\"".to_owned();
        invalid(label, Invalid::Conflict { field: "robot.module".into(), reason })
    })?;
    let configuration = configuration.map_err(|error| {
        invalid(label, Invalid::Conflict { field: "robot.module".into(), reason: error.to_string() })
    })?;
    let refused = |refusal: Refusal| Error::Sequence { file: file.to_owned(), reason: refusal.to_string() };
    let semantics = Semantics::default();
    let steps = configuration.apply_all(program.segments(), &semantics).map_err(refused)?;
    let after = steps.last().map_or(&configuration, |step| &step.after);
    let repeat = after.apply_all(program.segments(), &semantics).err().map(|refusal| refusal.to_string());
    let view = CheckView {
        robot: robot.name.clone(),
        modules: configuration.len(),
        duration: steps.iter().map(|step| step.duration).sum(),
        segments: program.segments().zip(&steps).enumerate().map(segment_view).collect(),
        repeat,
    };
    if json {
        return console::say_json(&view);
    }
    if quiet {
        return Ok(());
    }
    console::say(&text(&view))
}

fn segment_view((segment, (program, step)): (usize, (&sequence::Segment, &Step))) -> SegmentView {
    let names = |connections: &std::collections::BTreeSet<Connection>| {
        connections.iter().map(|(a, b)| format!("{a} {b}")).collect()
    };
    SegmentView {
        segment,
        text: program.to_string(),
        duration: step.duration,
        cut: names(&step.cut),
        made: names(&step.made),
    }
}

fn text(view: &CheckView) -> String {
    let list = |names: &[String]| if names.is_empty() { "-".to_owned() } else { names.join(", ") };
    let row = |segment: &SegmentView| {
        let time = format!("{}", segment.duration);
        vec![segment.segment.to_string(), segment.text.clone(), time, list(&segment.cut), list(&segment.made)]
    };
    let rows: Vec<Vec<String>> = view.segments.iter().map(row).collect();
    let head = ["segment", "operations", "s", "cuts", "connects"];
    let count = view.segments.len();
    let repeat = match &view.repeat {
        None => "feasible, also when it begins again".to_owned(),
        Some(reason) => format!("feasible once; when it begins again: {reason}"),
    };
    let plural = if count == 1 { "segment" } else { "segments" };
    format!(
        "{}: {} modules, {count} {plural}, {} s a repeat\n\n{}\n{repeat}\n",
        view.robot,
        view.modules,
        view.duration,
        table(&head, &rows)
    )
}
