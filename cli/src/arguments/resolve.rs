//! Resolution of the command line: defaults, environment variables and properties of the machine.

use super::{
    Bench, Certs, CertsAction, Command, Compare, Evaluate, EvaluateWhat, Fetch, GivenBy, Health, HealthOf, JobFile,
    List, OneJob, Place, Plan, Replay, ReplayWhat, Resolved, Restart, Robot, RobotOutput, Run, RunOf, RunTo, Sequence,
    SequenceAction, Show, Simulate, SimulateWhat, Submit, Validate, Verify, raw,
};
use crate::client::Url;
use crate::error::Error;
use crate::inputs;
use clap::Parser as _;
use proto::credentials::{self as shown, Credentials, Sources};
use sim_core::base::limits::MAX_GENOTYPE;
use sim_core::genotype::Genotype;
use sim_core::problem::VarySpec;
use sim_core::procedure::evolve::finish::Question;
use std::path::{Path, PathBuf};

/// Parses the command line. On `--help` and on wrong usage clap prints and exits (exit codes 0 and 2).
pub fn parse() -> Result<Resolved, Error> {
    resolve(raw::Cli::parse())
}

pub(super) fn resolve(raw: raw::Cli) -> Result<Resolved, Error> {
    let command = match raw.command {
        raw::Command::Run(run) => Command::Run(Run { file: run.file.into(), to: run_to(run.to)? }),
        raw::Command::Plan(plan) => Command::Plan(planning(plan)?),
        raw::Command::Simulate(simulate) => Command::Simulate(simulation(*simulate)?),
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
        raw::Command::Health(raw) => Command::Health(health(raw)?),
        raw::Command::Compare(compare) => Command::Compare(Compare {
            folders: compare.folders.into_iter().map(folder_of).collect(),
            out: compare.out.map(picture).transpose()?,
            json: compare.json,
        }),
        raw::Command::Replay(raw) => Command::Replay(replay(raw)),
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
            unit: robot.unit,
            json: robot.json,
        }),
        raw::Command::Certs(raw) => Command::Certs(certs(raw)),
        raw::Command::Completions(completions) => Command::Completions(completions.shell),
        raw::Command::Man(man) => Command::Man { out: man.out },
        raw::Command::Sequence(raw::Sequence { action }) => Command::Sequence(sequence(action)?),
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

fn run_to(raw: raw::RunTo) -> Result<RunTo, Error> {
    let place = match (raw.workers, named_coordinator(raw.coordinator)?) {
        (Some(slots), _) => Place::Here { slots },
        (None, None) => Place::Here { slots: cores() },
        (None, Some((url, from))) => Place::There {
            url: Url::parse(&url, from, &credentials(raw.shown)?)?,
            from_environment: from == raw::COORDINATOR_VARIABLE,
        },
    };
    Ok(RunTo { out: raw.out, place, json: raw.json })
}

fn planning(raw: raw::Plan) -> Result<Plan, Error> {
    Ok(Plan {
        of: run_of(raw.run, &raw.to)?,
        environment: raw.environment,
        seeds: raw.seeds,
        iterations: raw.iterations,
        algorithm: raw.algorithm,
        reuse_tolerance: raw.reuse_tolerance,
        whole_trees: raw.whole_trees,
        seed: raw.seed,
        to: run_to(raw.to)?,
    })
}

fn simulation(raw: raw::Simulate) -> Result<Simulate, Error> {
    let of = match (raw.run, raw.robot) {
        (_, Some(robot)) => GivenBy::Robot(robot),
        (Some(run), None) => GivenBy::Run(run_of(run, &raw.to)?),
        (None, None) => {
            let message = "name a run, or a robot with --robot: `evogait simulate RUN --gait 1`".to_owned();
            return Err(Error::Usage { message });
        }
    };
    let what = match raw.what {
        raw::SimulateWhat { gait: Some(gait), .. } => SimulateWhat::Gait(gait),
        raw::SimulateWhat { targets: Some(path), .. } => SimulateWhat::Targets(path),
        raw::SimulateWhat { stand: Some(seconds), .. } => SimulateWhat::Stand(seconds),
        raw::SimulateWhat { plan: _, .. } => SimulateWhat::Plan,
    };
    Ok(Simulate {
        of,
        what,
        environment: raw.environment,
        fine: raw.fine,
        replan: raw.replan.then_some(raw.deviation),
        way: raw.way.map(Into::into),
        repeats: raw.repeats,
        vary: VarySpec {
            friction: raw.friction,
            motor_strength: raw.motor_strength,
            x: raw.x,
            y: raw.y,
            yaw: raw.yaw,
            dead_joints: raw.dead_joints,
            target_noise: raw.target_noise,
        },
        seed: raw.seed,
        to: run_to(raw.to)?,
    })
}

fn sequence(action: raw::SequenceAction) -> Result<Sequence, Error> {
    let (of, action) = match action {
        raw::SequenceAction::Check { of, json } => (of, SequenceAction::Check { json }),
        raw::SequenceAction::Targets { of, duration, out } => (of, SequenceAction::Targets { duration, out }),
        raw::SequenceAction::Run { of, duration, fine, to } => {
            (of, SequenceAction::Run { duration, fine, to: run_to(to)? })
        }
    };
    Ok(Sequence { file: of.file, robot: of.robot, action })
}

fn run_of(run: String, to: &raw::RunTo) -> Result<RunOf, Error> {
    if !is_job_id(&run) {
        return Ok(RunOf::Folder(folder_of(run.into())));
    }
    let named = named_coordinator(to.coordinator.clone())?;
    let (url, from) = named.unwrap_or_else(|| (raw::DEFAULT_COORDINATOR.to_owned(), "the default"));
    Ok(RunOf::Stored { id: run, on: Url::parse(&url, from, &credentials(to.shown.clone())?)? })
}

/// Checks that the file name of a picture ends with .svg or .png.
fn picture(path: PathBuf) -> Result<PathBuf, Error> {
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    if ending.is_some_and(|ending| ending == "svg" || ending == "png") {
        return Ok(path);
    }
    Err(Error::Usage {
        message: format!("--out {} is no picture file: a picture ends with .svg or .png", path.display()),
    })
}

fn one_job(raw: raw::OneJob) -> Result<OneJob, Error> {
    Ok(OneJob { id: raw.id, json: raw.on.json, on: coordinator(raw.on)? })
}

fn evaluation(raw: raw::Evaluate) -> Result<Evaluate, Error> {
    let genotype = match (raw.genome, raw.genome_file) {
        (Some(text), _) => Some(genotype(&text, "--genome")?),
        (None, Some(path)) => {
            let text = std::fs::read_to_string(&path).map_err(|e| Error::read(&path, e))?;
            inputs::record(&path);
            Some(genotype(&text, &path.display().to_string())?)
        }
        (None, None) => None,
    };
    Ok(Evaluate {
        generation: raw.generation.unwrap_or(0),
        candidate: raw.candidate.unwrap_or(0),
        question: raw.question.map(Question::from),
        genotype,
        json: raw.on.json,
        what: if is_job_id(&raw.job) {
            EvaluateWhat::Stored { id: raw.job, on: coordinator(raw.on)? }
        } else {
            EvaluateWhat::File(JobFile { job: raw.job, seed: None })
        },
    })
}

fn health(raw: raw::Health) -> Result<Health, Error> {
    let json = raw.on.json;
    let of = match raw.process {
        Some(address) => HealthOf::Process(address),
        None => HealthOf::Coordinator { alive: raw.alive, on: coordinator(raw.on)? },
    };
    Ok(Health { of, json })
}

fn replay(raw: raw::Replay) -> Replay {
    let what = match raw.what.gait {
        Some(n) => ReplayWhat::Gait(n as usize - 1),
        None => ReplayWhat::Plan,
    };
    Replay { folder: folder_of(raw.folder), what, out: raw.out }
}

fn certs(raw: raw::Certs) -> Certs {
    let (action, raw::CertsFolder { folder, hosts, days }) = match raw.action {
        raw::CertsAction::Init(folder) => (CertsAction::Init, folder),
        raw::CertsAction::Renew(folder) => (CertsAction::Renew, folder),
    };
    Certs { action, folder, hosts, days }
}

/// Returns true if the text has the form of a job id: j, a number, a dash and twelve hexadecimal digits.
fn is_job_id(text: &str) -> bool {
    let parts = text.strip_prefix('j').and_then(|rest| rest.split_once('-'));
    parts.is_some_and(|(number, digest)| {
        !number.is_empty()
            && number.bytes().all(|b| b.is_ascii_digit())
            && digest.len() == 12
            && digest.bytes().all(|b| b.is_ascii_hexdigit())
    })
}

/// Parses numbers separated by commas, blanks, line ends or brackets.
fn genotype(text: &str, from: &str) -> Result<Genotype, Error> {
    let separator = |c: char| c == ',' || c == '[' || c == ']' || c.is_whitespace();
    let number = |word: &str| {
        let wrong =
            format!("{from}: \"{word}\" is not a number; a genome is a list of numbers with commas between them");
        word.parse().map_err(|_| Error::Usage { message: wrong })
    };
    let numbers: Vec<f64> = text.split(separator).filter(|w| !w.is_empty()).map(number).collect::<Result<_, _>>()?;
    match numbers.len() {
        0 => Err(Error::Usage {
            message: format!("{from} contains no number: a genome is a list of numbers with commas between them"),
        }),
        n if n > MAX_GENOTYPE => {
            Err(Error::Usage { message: format!("{from} contains {n} numbers: at most {MAX_GENOTYPE} are allowed") })
        }
        _ => Ok(numbers.into()),
    }
}

fn coordinator(raw: raw::OnCoordinator) -> Result<Url, Error> {
    let credentials = credentials(raw.shown)?;
    let named = named_coordinator(raw.coordinator)?;
    let (url, from) = named.unwrap_or_else(|| (raw::DEFAULT_COORDINATOR.to_owned(), "the default"));
    Url::parse(&url, from, &credentials)
}

/// Returns URL and source of the coordinator that the command line or else the environment gives. An empty variable
/// counts as unset.
fn named_coordinator(given: Option<String>) -> Result<Option<(String, &'static str)>, Error> {
    match given {
        Some(url) if url.trim().is_empty() => Err(Error::Usage {
            message: "--coordinator is empty: give a URL, such as http://127.0.0.1:7077, or leave the option out"
                .to_owned(),
        }),
        Some(url) => Ok(Some((url, "--coordinator"))),
        None => {
            let named = std::env::var(raw::COORDINATOR_VARIABLE).ok().filter(|url| !url.is_empty());
            Ok(named.map(|url| (url, raw::COORDINATOR_VARIABLE)))
        }
    }
}

fn credentials(raw: raw::Shown) -> Result<Credentials, Error> {
    let raw::Shown { ca, cert, key, token_file } = raw;
    let named = |given: &Option<PathBuf>, variable: &str| {
        given.clone().or_else(|| std::env::var_os(variable).filter(|value| !value.is_empty()).map(PathBuf::from))
    };
    let files = [
        named(&ca, shown::CA_VARIABLE),
        named(&cert, shown::CERT_VARIABLE),
        named(&key, shown::KEY_VARIABLE),
        named(&token_file, shown::TOKEN_FILE_VARIABLE),
    ];
    let credentials = Credentials::of_process(Sources { ca, cert, key, token_file });
    files.iter().flatten().for_each(|path| inputs::record(path));
    credentials.map_err(|e| Error::Usage { message: e.to_string() })
}

/// Returns the number of cores that this process may use, or 1 if the system does not report it.
pub fn cores() -> u32 {
    std::thread::available_parallelism().map_or(1, |n| n.get() as u32)
}

/// Returns the output folder of a run, which may be given as the folder or as its result file.
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
    fn clap_accepts_the_argument_definition() {
        raw::Cli::command().debug_assert();
    }

    #[test]
    fn parsed_genotype_keeps_all_bits() {
        let odd = [-0.0, 1.0 / 3.0, f64::MIN_POSITIVE / 4.0, -1e300, f64::INFINITY];
        let text = odd.map(|v| v.to_string()).join(",");
        for text in [text.clone(), format!("[{}]\n", text.replace(',', ", ")), text.replace(',', "\n")] {
            let read = genotype(&text, "x").unwrap();
            assert_eq!(read.numbers().iter().map(|v| v.to_bits()).collect::<Vec<_>>(), odd.map(f64::to_bits), "{text}");
        }
        assert!(genotype("1.0,two", "--genome").unwrap_err().to_string().contains("--genome: \"two\" is not a number"));
        assert!(genotype(" ", "--genome").is_err());
    }

    #[test]
    fn job_ids_are_distinguished_from_file_names() {
        assert!(is_job_id("j12-0123456789ab"));
        for other in ["quadropod-empty", "j12-0123456789ab.toml", "j-0123456789ab", "j1-0123", "x1-0123456789ab"] {
            assert!(!is_job_id(other), "{other}");
        }
    }

    #[test]
    fn result_file_resolves_to_its_folder() {
        assert_eq!(folder_of("runs/a/result.json".into()), Path::new("runs/a"));
        assert_eq!(folder_of("result.json".into()), Path::new("."));
        assert_eq!(folder_of("runs/a".into()), Path::new("runs/a"));
    }
}
