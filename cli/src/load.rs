//! Loader for job, robot and environment files. It follows references; an error names the file with the fault.

use crate::error::Error;
use crate::{gait_set, inputs, target_table};
use sim_core::base::error::Invalid;
use sim_core::base::{limits, toml_file};
use sim_core::exchange::{self, Import};
use sim_core::job::{JobSpec, Reference};
use sim_core::model::catalogue::{self, Entry};
use sim_core::model::environment::Environment;
use sim_core::model::mtran::{self, Configuration};
use sim_core::model::{Robot, RobotSpec};
use sim_core::problem::{Checked, Job, JobKind};
use sim_core::procedure::kinds;
use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

/// Job as given on the command line.
#[derive(Debug)]
pub struct JobFile {
    /// Path of a job file, or name of a shipped job.
    pub job: String,
    /// Seed that replaces the job's own.
    pub seed: Option<u64>,
}

/// Text of a file or of a catalogue entry, with its origin.
struct Source {
    text: String,
    /// Name in messages.
    label: String,
    /// Base folder of relative references in the text; `None` for a catalogue entry.
    folder: Option<PathBuf>,
}

/// Reads a job, its robot, its environment and its gaits, checks all of it, and lets the robot settle.
pub fn job(file: &JobFile) -> Result<Job, Error> {
    read(file, Job::new)
}

/// Same as [`job`], but without a simulation: it does not detect a robot that can't stand.
pub fn checked(file: &JobFile) -> Result<Checked, Error> {
    read(file, Checked::new)
}

/// Same as [`job`]; fails if the job does not evolve.
pub fn evolving(file: &JobFile) -> Result<Job, Error> {
    let job = job(file)?;
    must_evolve(&job, &file.job).map(|()| job)
}

/// Fails if the job does not evolve. `called` is its name in the message.
pub fn must_evolve(job: &Checked, called: &str) -> Result<(), Error> {
    let what = match job.kind() {
        JobKind::Evolve => return Ok(()),
        JobKind::Plan => "plans with gaits that are given",
        JobKind::Simulate => "simulates a motion that is given",
    };
    Err(Error::Usage { message: format!("{called} {what}: this command is for jobs that evolve") })
}

fn read<T>(file: &JobFile, resolve: fn(JobSpec) -> Result<T, Invalid>) -> Result<T, Error> {
    let source = find("job", &file.job, catalogue::jobs(), None)?;
    let mut spec: JobSpec = parse(&source, toml_file::read)?;
    if let Some(seed) = file.seed {
        spec.seed = seed;
    }
    // The error about a robot or environment with a file of its own names that file.
    let mut robot_label = source.label.clone();
    let mut environment_label = source.label.clone();
    if let Reference::Named(name) = &spec.robot {
        let found = follow("robot", name, catalogue::robots(), &source)?;
        let import = parse(&found, |text| robot_spec(text, &found.label, 1.0))?;
        spec.robot = Reference::Inline(Box::new(import.robot));
        robot_label = found.label;
    }
    if let Reference::Named(name) = &spec.environment {
        let found = follow("environment", name, catalogue::environments(), &source)?;
        spec.environment = Reference::Inline(Box::new(parse(&found, Environment::from_toml)?));
        environment_label = found.label;
    }
    follow_motions(&mut spec, &source)?;
    let file_of = |invalid: &Invalid| match part(invalid) {
        Part::Robot => robot_label.clone(),
        Part::Environment => environment_label.clone(),
        Part::Job => source.label.clone(),
    };
    kinds::of(&spec).and_then(|_| resolve(spec)).map_err(|invalid| told_of_files(invalid, file_of))
}

/// Replaces paths to gaits and to a table of targets by their content. The checks of the job report a faulty robot.
fn follow_motions(spec: &mut JobSpec, source: &Source) -> Result<(), Error> {
    let Reference::Inline(robot) = &spec.robot else { return Ok(()) };
    let robot = spec.variant.as_ref().map_or_else(|| Ok((**robot).clone()), |variant| robot.variant(variant));
    let Ok(robot) = robot.and_then(|robot| Robot::compile(&robot)) else { return Ok(()) };
    let path = |named: &str| source.folder.as_ref().map_or_else(|| PathBuf::from(named), |folder| folder.join(named));
    let of_plan = spec.plan.as_mut().map(|plan| &mut plan.gaits);
    let (of_simulation, targets) = match &mut spec.simulate {
        Some(simulate) => (simulate.gaits.as_mut(), simulate.targets.as_mut()),
        None => (None, None),
    };
    for gaits in [of_plan, of_simulation].into_iter().flatten() {
        if let (Reference::Named(named), Some(of)) = (&*gaits, &spec.gaits) {
            *gaits = Reference::Inline(Box::new(gait_set::read(&path(named), of, &robot)?));
        }
    }
    if let Some(targets) = targets
        && let Reference::Named(named) = &*targets
    {
        *targets = Reference::Inline(Box::new(target_table::read(&path(named), &robot)?));
    }
    Ok(())
}

/// Converts faults to one error. Faults of other files than the first get the name of their file.
fn told_of_files(invalid: Invalid, file_of: impl Fn(&Invalid) -> String) -> Error {
    let faults = match invalid {
        Invalid::Several(faults) => faults,
        one => vec![one],
    };
    let file = faults.first().map(&file_of).unwrap_or_default();
    let of_others = |fault: Invalid| match file_of(&fault) {
        own if own == file => fault,
        other => Invalid::Conflict { field: other, reason: fault.to_string() },
    };
    let faults: Vec<Invalid> = faults.into_iter().map(of_others).collect();
    let source = Invalid::all(faults).err().unwrap_or_else(|| Invalid::Several(Vec::new()));
    Error::Invalid { file, source }
}

/// Reads a resolved job, such as the job.toml of an output folder, as [`Checked`] or as [`Job`]; also returns its text.
pub fn resolved<T>(path: &Path, read: fn(&str) -> Result<T, Invalid>) -> Result<(T, String), Error> {
    let text = text_of(path)?;
    let job = read(&text).map_err(|source| Error::Invalid { file: path.display().to_string(), source })?;
    Ok((job, text))
}

/// Reads an environment by path or by the name of a shipped one. Also returns its name for messages.
pub fn environment(name: &str) -> Result<(Environment, String), Error> {
    let source = find("environment", name, catalogue::environments(), None)?;
    let environment = parse(&source, Environment::from_toml)?;
    Ok((environment, source.label))
}

/// Robot from a file or from the catalogue.
pub struct RobotFile {
    /// Specification of the robot.
    pub spec: RobotSpec,
    /// Path of the file, or name of the catalogue entry.
    pub label: String,
    /// Notes of an import.
    pub notes: Vec<String>,
}

/// Reads a robot by path or by the name of a shipped one. `unit` is the length in the file that becomes 1 mu.
pub fn robot(name: &str, unit: Option<f64>) -> Result<RobotFile, Error> {
    let source = find("robot", name, catalogue::robots(), None)?;
    let Import { robot, notes } = parse(&source, |text| robot_spec(text, &source.label, unit.unwrap_or(1.0)))?;
    if unit.is_some() && robot.bodies.is_empty() {
        let message = format!(
            "--unit does not apply to {}: it is made of modules, and their kind defines their size",
            source.label
        );
        return Err(Error::Usage { message });
    }
    Ok(RobotFile { spec: robot, label: source.label, notes })
}

/// Parses a robot file. A text that begins with "<" is MJCF or URDF: no TOML does.
fn robot_spec(text: &str, label: &str, unit: f64) -> Result<Import, Invalid> {
    let text = text.trim_start_matches('\u{feff}');
    let xml = [".xml", ".mjcf", ".urdf"].iter().any(|ending| label.to_ascii_lowercase().ends_with(ending));
    if xml || text.trim_start().starts_with('<') {
        return exchange::read_in(text, unit);
    }
    if label.to_ascii_lowercase().ends_with(".mtran") {
        return initial_states(text).map(|robot| Import { robot, notes: Vec::new() });
    }
    let robot: RobotSpec = toml_file::read(text)?;
    let robot = if unit == 1.0 { robot } else { robot.in_units_of(unit) };
    Ok(Import { robot, notes: Vec::new() })
}

/// Reads the initial states of M-TRAN modules.
fn initial_states(text: &str) -> Result<RobotSpec, Invalid> {
    let refused = |reason: String| Invalid::Conflict { field: "robot".into(), reason };
    let configuration = Configuration::of_text(text).map_err(|error| refused(error.to_string()))?;
    configuration.robot("mtran", "").map_err(|error| refused(error.to_string()))
}

/// Name of a random robot, without its kind, number of modules and seed.
const RANDOM: &str = "random:";

/// Draws a random robot: `mtran:MODULES:SEED`.
fn random_robot(name: &str, drawn: &str) -> Result<Source, Error> {
    let refused = |reason: String| Error::Usage { message: format!("robot \"{name}\": {reason}") };
    let numbers = drawn.strip_prefix("mtran:").and_then(|rest| rest.split_once(':'));
    let parsed = numbers.and_then(|(modules, seed)| Some((modules.parse().ok()?, seed.parse().ok()?)));
    let (modules, seed) = parsed.ok_or_else(|| {
        refused("a random robot is written random:mtran:MODULES:SEED, such as random:mtran:3:7".to_owned())
    })?;
    let configuration = mtran::drawn(modules, seed).map_err(|error| refused(error.to_string()))?;
    let description = format!("Random connected configuration of {modules} M-TRAN modules, seed {seed}.");
    let spec = configuration.robot(&format!("mtran-{modules}-{seed}"), &description);
    let spec = spec.map_err(|error| refused(format!("{error}; choose another seed")))?;
    let text = toml::to_string(&spec).map_err(|error| refused(error.to_string()))?;
    Ok(Source { text, label: format!("robot \"{name}\""), folder: None })
}

fn parse<T>(source: &Source, read: impl Fn(&str) -> Result<T, Invalid>) -> Result<T, Error> {
    read(&source.text).map_err(|invalid| Error::Invalid { file: source.label.clone(), source: invalid })
}

/// Part of a job that an error concerns.
enum Part {
    Job,
    Robot,
    Environment,
}

fn part(invalid: &Invalid) -> Part {
    let of_field = |field: &str| {
        let head = field.trim_start_matches("number of ");
        if head.starts_with("environment") {
            Part::Environment
        } else if ["robot", "module", "pivot", "failed", "variants"].iter().any(|f| head.starts_with(f)) {
            Part::Robot
        } else {
            Part::Job
        }
    };
    match invalid {
        Invalid::Overlap { .. } | Invalid::Disconnected { .. } | Invalid::AttachmentLoop { .. } => Part::Robot,
        Invalid::FaceTaken { .. } | Invalid::Foreign { .. } => Part::Robot,
        Invalid::Misplaced { .. } => Part::Environment,
        Invalid::OutOfRange { field, .. }
        | Invalid::WholeOutOfRange { field, .. }
        | Invalid::Unknown { field, .. }
        | Invalid::Duplicate { field, .. }
        | Invalid::Name { field, .. }
        | Invalid::Conflict { field, .. } => of_field(field),
        Invalid::Several(all) => all.first().map_or(Part::Job, part),
        Invalid::Syntax { .. } => Part::Job,
    }
}

/// Finds the `robot` or `environment` of a job: a shipped name, or a path relative to the job file.
fn follow(what: &'static str, name: &str, shipped: &'static [Entry], job: &Source) -> Result<Source, Error> {
    find(what, name, shipped, job.folder.as_deref()).map_err(|error| match error {
        Error::NotFound { .. } => {
            let known = shipped.iter().map(|entry| entry.name.to_owned()).collect();
            let source = Invalid::Unknown { field: what.to_owned(), value: name.to_owned(), known };
            Error::Invalid { file: job.label.clone(), source }
        }
        other => other,
    })
}

/// Finds a file or a catalogue entry. A name with a separator or a known ending is a path; a shipped name comes before
/// a file of the same name.
fn find(
    what: &'static str,
    name: &str,
    shipped: &'static [Entry],
    relative_to: Option<&Path>,
) -> Result<Source, Error> {
    let path = relative_to.map_or_else(|| PathBuf::from(name), |folder| folder.join(name));
    let looks_like_path = [".toml", ".xml", ".mjcf", ".urdf", ".mtran"].iter().any(|ending| name.ends_with(ending))
        || name.contains(std::path::MAIN_SEPARATOR)
        || name.contains('/');
    if what == "robot"
        && let Some(drawn) = name.strip_prefix(RANDOM)
    {
        return random_robot(name, drawn);
    }
    if !looks_like_path && let Some(entry) = shipped.iter().find(|entry| entry.name == name) {
        let label = format!("{what} \"{name}\" that ships");
        return Ok(Source { text: entry.toml.to_owned(), label, folder: None });
    }
    if looks_like_path || path.is_file() {
        let text = read_text(&path)?;
        let folder = path.parent().map(Path::to_owned);
        return Ok(Source { text, label: path.display().to_string(), folder });
    }
    let known = shipped.iter().map(|entry| entry.name).collect::<Vec<_>>().join(", ");
    Err(Error::NotFound { what, name: name.to_owned(), known })
}

/// Reads an input file and records it, so that no output replaces it.
fn read_text(path: &Path) -> Result<String, Error> {
    let text = text_of(path)?;
    inputs::record(path);
    Ok(text)
}

/// Reads a text file of at most [`limits::MAX_TOML_LENGTH`] bytes.
fn text_of(path: &Path) -> Result<String, Error> {
    let read = || -> io::Result<String> {
        let mut bytes = Vec::new();
        File::open(path)?.take(limits::MAX_TOML_LENGTH as u64 + 1).read_to_end(&mut bytes)?;
        if bytes.len() > limits::MAX_TOML_LENGTH {
            return Err(io::Error::other(format!("it has more than the allowed {} bytes", limits::MAX_TOML_LENGTH)));
        }
        String::from_utf8(bytes)
            .map_err(|e| io::Error::other(format!("it is not UTF-8 text (byte {})", e.utf8_error().valid_up_to())))
    };
    read().map_err(|source| Error::read(path, source))
}
