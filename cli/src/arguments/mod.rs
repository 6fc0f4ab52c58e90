//! From what was typed to what is meant: the one place where defaults, the environment and the machine are consulted.

mod bench;
mod raw;

pub use bench::Bench;
pub use raw::{
    BenchDispatch, BenchEvaluate, BenchFidelity, BenchFitness, BenchFleet, BenchPlan, BenchReuse, BenchRollout,
    BenchSoundness, Load, State, Subject,
};

use crate::certs::Host;
use crate::client::Url;
use crate::error::Error;
use clap::Parser as _;
use proto::credentials::{Credentials, Sources};
use sim_core::finish::Question;
use sim_core::job::Scale;
use sim_core::limits::MAX_GENOME;
use sim_core::robot::exchange::Format;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// A command with all that it needs to know.
#[derive(Debug)]
pub struct Resolved {
    /// Only errors and JSON.
    pub quiet: bool,
    /// What to do.
    pub command: Command,
}

#[derive(Debug)]
pub enum Command {
    Run(Run),
    Submit(Submit),
    Watch(OneJob),
    List(List),
    Show(Show),
    Cancel(OneJob),
    Pause(OneJob),
    Resume(OneJob),
    Restart(Restart),
    Evaluate(Evaluate),
    Fetch(Fetch),
    Workers { on: Url, json: bool },
    Demand { on: Url, json: bool },
    Health(Health),
    Replay(Replay),
    Verify(Verify),
    Validate(Validate),
    Bench(Bench),
    Robot(Robot),
    Certs(Certs),
    Scenarios { show: Option<String>, json: bool },
}

/// A job as the user points at it.
#[derive(Debug)]
pub struct JobFile {
    /// A path, or the name of a job that ships.
    pub job: String,
    pub seed: Option<u64>,
}

#[derive(Debug)]
pub struct Run {
    pub file: JobFile,
    pub out: Option<PathBuf>,
    pub place: Place,
    pub json: bool,
}

/// Where a run's evaluations happen.
#[derive(Debug)]
pub enum Place {
    /// In this process, so many at once.
    Here { slots: u32 },
    /// On the workers of a coordinator.
    There(Url),
}

#[derive(Debug)]
pub struct Submit {
    pub file: JobFile,
    /// 0: the coordinator's default.
    pub priority: u32,
    pub again: bool,
    pub on: Url,
    pub json: bool,
}

#[derive(Debug)]
pub struct Health {
    pub of: HealthOf,
    pub json: bool,
}

/// Whose health is asked for.
#[derive(Debug)]
pub enum HealthOf {
    /// A coordinator's; of one that stands by is enough, or not.
    Coordinator { on: Url, alive: bool },
    /// Of the process that serves its metrics here.
    Process(SocketAddr),
}

#[derive(Debug)]
pub struct OneJob {
    pub id: String,
    pub on: Url,
    pub json: bool,
}

#[derive(Debug)]
pub struct Restart {
    pub job: OneJob,
    /// Where it was tainted if it is not given.
    pub from_generation: Option<u32>,
    pub again: bool,
}

#[derive(Debug)]
pub struct Evaluate {
    pub what: EvaluateWhat,
    pub generation: u32,
    pub candidate: u32,
    pub question: Option<Question>,
    /// The one that ended the job if it is not given.
    pub genome: Option<Vec<f64>>,
    pub json: bool,
}

/// Whose candidate is evaluated.
#[derive(Debug)]
pub enum EvaluateWhat {
    File(JobFile),
    /// A coordinator's.
    Stored {
        id: String,
        on: Url,
    },
}

#[derive(Debug)]
pub struct List {
    pub states: Vec<State>,
    pub limit: usize,
    pub on: Url,
    pub json: bool,
}

#[derive(Debug)]
pub struct Show {
    pub job: OneJob,
    pub toml: bool,
}

#[derive(Debug)]
pub struct Fetch {
    pub id: String,
    pub out: Option<PathBuf>,
    pub on: Url,
    pub json: bool,
}

#[derive(Debug)]
pub struct Replay {
    pub folder: PathBuf,
    pub what: ReplayWhat,
    pub out: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug)]
pub enum ReplayWhat {
    /// Counted from 0.
    Gait(usize),
    Plan,
}

#[derive(Debug)]
pub struct Verify {
    pub folder: PathBuf,
    pub full: bool,
    pub json: bool,
}

#[derive(Debug)]
pub struct Validate {
    pub file: JobFile,
    pub estimate: bool,
    pub json: bool,
}

#[derive(Debug)]
pub struct Certs {
    pub action: CertsAction,
    pub folder: PathBuf,
    /// Under which the coordinator is dialed.
    pub hosts: Vec<Host>,
    /// That certificates are valid.
    pub days: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CertsAction {
    Init,
    Renew,
}

#[derive(Debug)]
pub struct Robot {
    /// A path, or the name of a robot that ships.
    pub robot: String,
    pub variant: Option<String>,
    pub output: Option<RobotOutput>,
    pub json: bool,
}

/// What of a robot is written, and where to.
#[derive(Debug, PartialEq)]
pub enum RobotOutput {
    Picture(PathBuf, PictureFormat),
    /// In the format of others; to standard output if there is no file.
    Export {
        format: Format,
        scale: Scale,
        to: Option<PathBuf>,
    },
}

impl RobotOutput {
    /// A format that is not given follows from the file's name.
    fn of(raw: &mut raw::Robot) -> Result<Option<Self>, Error> {
        let given = raw.format.map(Format::from);
        let ending = raw.out.as_deref().and_then(Path::extension).and_then(|e| e.to_str());
        let format = given.or(match ending {
            Some("xml" | "mjcf") => Some(Format::Mjcf),
            Some("urdf") => Some(Format::Urdf),
            _ => None,
        });
        let usage = |message: String| Err(Error::Usage { message });
        match (format, raw.out.take()) {
            (Some(_), None) if raw.json => {
                usage("--json and --format both print to standard output: write one to a file with --out FILE".into())
            }
            (Some(format), to) => {
                Ok(Some(Self::Export { format, scale: raw.scale.map_or(Scale::Paper, Scale::from), to }))
            }
            (None, _) if raw.scale.is_some() => {
                usage("--scale is told to MJCF and URDF alone: add --format mjcf or --format urdf".into())
            }
            (None, Some(path)) => PictureFormat::of(&path).map(|format| Some(Self::Picture(path, format))),
            (None, None) => Ok(None),
        }
    }
}

/// The pictures' formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureFormat {
    Svg,
    Png,
}

impl PictureFormat {
    fn of(path: &Path) -> Result<Self, Error> {
        match path.extension().and_then(|e| e.to_str()) {
            Some("svg") => Ok(Self::Svg),
            Some("png") => Ok(Self::Png),
            _ => Err(Error::Usage {
                message: format!(
                    "--out = \"{}\" does not tell what to write: it must end in .svg or .png (a picture), .xml or .mjcf \
                     (MJCF) or .urdf",
                    path.display()
                ),
            }),
        }
    }
}

/// Reads the command line; on `--help` or wrong usage clap has the last word (exit codes 0 and 2).
pub fn parse() -> Result<Resolved, Error> {
    resolve(raw::Cli::parse())
}

fn resolve(raw: raw::Cli) -> Result<Resolved, Error> {
    let command = match raw.command {
        raw::Command::Run(run) => Command::Run(Run {
            file: run.file.into(),
            out: run.out,
            place: match run.coordinator {
                Some(url) => Place::There(Url::parse(&url, "--coordinator", &credentials(run.shown)?)?),
                None => Place::Here { slots: run.workers.unwrap_or_else(cores) },
            },
            json: run.json,
        }),
        raw::Command::Submit(submit) => Command::Submit(Submit {
            file: submit.file.into(),
            priority: submit.priority.unwrap_or(0),
            again: submit.again,
            json: submit.on.json,
            on: coordinator(submit.on)?,
        }),
        raw::Command::Watch(job) => Command::Watch(one_job(job)?),
        raw::Command::List(list) => Command::List(List {
            states: list.state,
            limit: list.limit.map_or(usize::MAX, |n| n as usize),
            json: list.on.json,
            on: coordinator(list.on)?,
        }),
        raw::Command::Show(show) => Command::Show(Show { toml: show.toml, job: one_job(show.job)? }),
        raw::Command::Cancel(job) => Command::Cancel(one_job(job)?),
        raw::Command::Pause(job) => Command::Pause(one_job(job)?),
        raw::Command::Resume(job) => Command::Resume(one_job(job)?),
        raw::Command::Restart(restart) => Command::Restart(Restart {
            from_generation: restart.from_generation,
            again: restart.again,
            job: one_job(restart.job)?,
        }),
        raw::Command::Evaluate(evaluate) => Command::Evaluate(evaluation(evaluate)?),
        raw::Command::Fetch(fetch) => {
            Command::Fetch(Fetch { id: fetch.id, out: fetch.out, json: fetch.on.json, on: coordinator(fetch.on)? })
        }
        raw::Command::Workers(on) => Command::Workers { json: on.json, on: coordinator(on)? },
        raw::Command::Demand(on) => Command::Demand { json: on.json, on: coordinator(on)? },
        raw::Command::Health(health) => {
            let json = health.on.json;
            let of = match health.process {
                Some(address) => HealthOf::Process(address),
                None => HealthOf::Coordinator { alive: health.alive, on: coordinator(health.on)? },
            };
            Command::Health(Health { of, json })
        }
        raw::Command::Replay(replay) => Command::Replay(Replay {
            folder: folder_of(replay.folder),
            what: match replay.what.gait {
                Some(n) => ReplayWhat::Gait(n as usize - 1),
                None => ReplayWhat::Plan,
            },
            out: replay.out,
        }),
        raw::Command::Verify(verify) => {
            Command::Verify(Verify { folder: folder_of(verify.folder), full: verify.full, json: verify.json })
        }
        raw::Command::Validate(validate) => Command::Validate(Validate {
            file: validate.file.into(),
            estimate: !validate.no_estimate,
            json: validate.json,
        }),
        raw::Command::Bench(bench) => Command::Bench(Bench::from(bench)),
        raw::Command::Robot(mut robot) => Command::Robot(Robot {
            output: RobotOutput::of(&mut robot)?,
            robot: robot.robot,
            variant: robot.variant,
            json: robot.json,
        }),
        raw::Command::Certs(certs) => {
            let (action, raw::CertsFolder { folder, hosts, days }) = match certs.action {
                raw::CertsAction::Init(folder) => (CertsAction::Init, folder),
                raw::CertsAction::Renew(folder) => (CertsAction::Renew, folder),
            };
            Command::Certs(Certs { action, folder, hosts, days })
        }
        raw::Command::Scenarios(scenarios) => Command::Scenarios {
            show: scenarios.action.map(|raw::ScenariosAction::Show { name }| name),
            json: scenarios.json,
        },
    };
    Ok(Resolved { quiet: raw.quiet, command })
}

impl From<raw::JobFile> for JobFile {
    fn from(raw: raw::JobFile) -> Self {
        Self { job: raw.job, seed: raw.seed }
    }
}

fn one_job(raw: raw::OneJob) -> Result<OneJob, Error> {
    Ok(OneJob { id: raw.id, json: raw.on.json, on: coordinator(raw.on)? })
}

fn evaluation(raw: raw::Evaluate) -> Result<Evaluate, Error> {
    let genome = match (raw.genome, raw.genome_file) {
        (Some(text), _) => Some(genome(&text, "--genome")?),
        (None, Some(path)) => {
            let text = std::fs::read_to_string(&path).map_err(|e| Error::read(&path, e))?;
            Some(genome(&text, &path.display().to_string())?)
        }
        (None, None) => None,
    };
    Ok(Evaluate {
        generation: raw.generation.unwrap_or(0),
        candidate: raw.candidate.unwrap_or(0),
        question: raw.question.map(Question::from),
        genome,
        json: raw.on.json,
        what: if is_job_id(&raw.job) {
            EvaluateWhat::Stored { id: raw.job, on: coordinator(raw.on)? }
        } else {
            EvaluateWhat::File(JobFile { job: raw.job, seed: None })
        },
    })
}

/// Whether it looks like what a coordinator calls a job: j, a number, a dash and twelve hexadecimal digits.
fn is_job_id(text: &str) -> bool {
    let parts = text.strip_prefix('j').and_then(|rest| rest.split_once('-'));
    parts.is_some_and(|(number, digest)| {
        !number.is_empty()
            && number.bytes().all(|b| b.is_ascii_digit())
            && digest.len() == 12
            && digest.bytes().all(|b| b.is_ascii_hexdigit())
    })
}

/// Numbers between commas, blanks or line ends, in brackets or not.
fn genome(text: &str, from: &str) -> Result<Vec<f64>, Error> {
    let separator = |c: char| c == ',' || c == '[' || c == ']' || c.is_whitespace();
    let number = |word: &str| {
        let wrong =
            format!("{from} holds \"{word}\", which is no number: a genome is numbers with commas between them");
        word.parse().map_err(|_| Error::Usage { message: wrong })
    };
    let genome: Vec<f64> = text.split(separator).filter(|w| !w.is_empty()).map(number).collect::<Result<_, _>>()?;
    match genome.len() {
        0 => Err(Error::Usage { message: format!("{from} holds no number") }),
        n if n > MAX_GENOME => {
            Err(Error::Usage { message: format!("{from} holds {n} numbers: at most {MAX_GENOME} are allowed") })
        }
        _ => Ok(genome),
    }
}

fn coordinator(raw: raw::OnCoordinator) -> Result<Url, Error> {
    let credentials = credentials(raw.shown)?;
    if let Some(url) = raw.coordinator {
        return Url::parse(&url, "--coordinator", &credentials);
    }
    match std::env::var(raw::COORDINATOR_VARIABLE) {
        Ok(url) if !url.is_empty() => Url::parse(&url, raw::COORDINATOR_VARIABLE, &credentials),
        _ => Url::parse(raw::DEFAULT_COORDINATOR, "the default", &credentials),
    }
}

fn credentials(raw: raw::Shown) -> Result<Credentials, Error> {
    let raw::Shown { ca, cert, key, token_file } = raw;
    Credentials::of_process(Sources { ca, cert, key, token_file }).map_err(|e| Error::Usage { message: e.to_string() })
}

/// The number of cores this process may use; 1 where the machine doesn't tell.
pub fn cores() -> u32 {
    std::thread::available_parallelism().map_or(1, |n| n.get() as u32)
}

/// A run is named by its folder or by the result in it.
fn folder_of(path: PathBuf) -> PathBuf {
    if path.file_name().is_some_and(|name| name == crate::output::RESULT) && !path.is_dir() {
        return match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
            _ => Path::new(".").to_owned(),
        };
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory as _;

    #[test]
    fn the_declaration_of_the_arguments_is_sound() {
        raw::Cli::command().debug_assert();
    }

    #[test]
    fn genomes_are_read_with_all_their_bits() {
        let odd = [-0.0, 1.0 / 3.0, f64::MIN_POSITIVE / 4.0, -1e300, f64::INFINITY];
        let text = odd.map(|v| v.to_string()).join(",");
        for text in [text.clone(), format!("[{}]\n", text.replace(',', ", ")), text.replace(',', "\n")] {
            let read = genome(&text, "x").unwrap();
            assert_eq!(read.iter().map(|v| v.to_bits()).collect::<Vec<_>>(), odd.map(f64::to_bits), "{text}");
        }
        assert!(genome("1.0,two", "--genome").unwrap_err().to_string().contains("--genome holds \"two\""));
        assert!(genome(" ", "--genome").is_err());
    }

    #[test]
    fn a_coordinator_s_job_is_told_from_a_file_by_its_look() {
        assert!(is_job_id("j12-0123456789ab"));
        for other in ["quadropod-empty", "j12-0123456789ab.toml", "j-0123456789ab", "j1-0123", "x1-0123456789ab"] {
            assert!(!is_job_id(other), "{other}");
        }
    }

    #[test]
    fn a_result_file_stands_for_its_folder() {
        assert_eq!(folder_of("runs/a/result.json".into()), Path::new("runs/a"));
        assert_eq!(folder_of("result.json".into()), Path::new("."));
        assert_eq!(folder_of("runs/a".into()), Path::new("runs/a"));
    }

    #[test]
    fn what_is_written_of_a_robot_follows_from_the_format_or_the_file_s_name() {
        let output = |line: &str| {
            let typed = ["evogait", "robot", "lizard"].into_iter().chain(line.split_whitespace());
            match resolve(raw::Cli::try_parse_from(typed).unwrap()) {
                Ok(Resolved { command: Command::Robot(robot), .. }) => Ok(robot.output),
                Ok(_) => unreachable!("`evogait robot` is that command"),
                Err(error) => Err(error.to_string()),
            }
        };
        let export = |format, scale, to: Option<&str>| {
            Ok(Some(RobotOutput::Export { format, scale, to: to.map(PathBuf::from) }))
        };
        assert_eq!(output(""), Ok(None));
        assert_eq!(output("--out a.png"), Ok(Some(RobotOutput::Picture("a.png".into(), PictureFormat::Png))));
        assert_eq!(output("--format mjcf"), export(Format::Mjcf, Scale::Paper, None));
        assert_eq!(output("--out a.xml --scale real"), export(Format::Mjcf, Scale::Real, Some("a.xml")));
        assert_eq!(output("--out a.urdf --json"), export(Format::Urdf, Scale::Paper, Some("a.urdf")));
        assert_eq!(output("--out a.xml --format urdf"), export(Format::Urdf, Scale::Paper, Some("a.xml")));
        assert!(output("--format urdf --json").unwrap_err().contains("--out FILE"));
        assert!(output("--scale real").unwrap_err().contains("--format"));
        assert!(output("--out a.stl").unwrap_err().contains(".urdf"));
    }
}
