//! All parsers as functions of bytes, for the fuzzer in `fuzz/` and for the recorded inputs in `fuzz/regressions`. A
//! parser may refuse its input. It must not panic, hang or use unbounded memory.

use crate::sandbox::{planning_job, simulating_job, tiny_job};
use prost::Message;
use proto::{credentials::Token, dial::Addresses, v1};
use sim_core::base::limits::MAX_TOML_LENGTH;
use sim_core::control::sequence::{self, MAX_SEGMENTS};
use sim_core::engines::fidelity::FidelityTable;
use sim_core::exchange::{self, Format};
use sim_core::job::JobSpec;
use sim_core::model::catalogue::{self, Entry};
use sim_core::model::environment::Environment;
use sim_core::model::mtran::{self, Configuration};
use sim_core::model::{Robot, RobotSpec};
use sim_core::physics::{Physics, Scale};
use sim_core::problem::{Checked, Job, Preparation};
use sim_core::procedure::preparing::PreparationOutcome;
use sim_core::procedure::{self, Bench, Hooks, Procedure};
use sim_core::procedure::{evolve, plan, simulate};
use std::sync::{Arc, LazyLock};

/// Parser under test.
pub type Parser = fn(&[u8]);

/// All parsers, by name.
pub const PARSERS: &[(&str, Parser)] = &[
    ("job", job),
    ("job-spec", job_spec),
    ("robot", robot),
    ("exchange", exchanged),
    ("environment", environment),
    ("fidelity", fidelity),
    ("hello", coordinator::parsers::hello),
    ("complete", coordinator::parsers::complete),
    ("messages", messages),
    ("task", task),
    ("task-result", task_result),
    ("preparation", preparation),
    ("state", state),
    ("blob", coordinator::parsers::blob),
    ("store-url", |bytes| with_text(bytes, coordinator::parsers::store_url)),
    ("tokens", |bytes| with_text(bytes, coordinator::parsers::tokens)),
    ("token", token),
    ("addresses", addresses),
    ("sequence", |bytes| with_text(bytes, sequence)),
    ("initial-states", |bytes| with_text(bytes, initial_states)),
];

/// Returns valid inputs of a parser, from which the fuzzer starts.
pub fn seeds(parser: &str) -> Vec<Vec<u8>> {
    let shipped = |entries: &[Entry]| entries.iter().map(|entry| entry.toml.as_bytes().to_vec()).collect();
    match parser {
        "job" | "job-spec" => {
            let others = [planning_job(1, 2), simulating_job(1, 2)].map(String::into_bytes);
            catalogue::jobs().iter().map(|entry| entry.toml.as_bytes().to_vec()).chain(others).collect()
        }
        "robot" => shipped(catalogue::robots()),
        "environment" => shipped(catalogue::environments()),
        "fidelity" => vec![FidelityTable::shipped().to_toml().into_bytes()],
        "exchange" => exchanged_seeds(),
        "hello" => hello_seeds(),
        "complete" => complete_seeds(),
        "messages" => message_seeds(),
        "task" => EXAMPLES.iter().flat_map(|example| example.tasks.clone()).collect(),
        "task-result" => EXAMPLES.iter().flat_map(|example| example.results.clone()).collect(),
        "preparation" => EXAMPLES.iter().flat_map(|e| [e.outcome.clone(), e.preparation.clone()]).collect(),
        "state" => EXAMPLES.iter().flat_map(|example| example.states.clone()).collect(),
        // A version byte, then MessagePack by field name: results and the worker that delivered them.
        "blob" => vec![b"\x02\x82\xa7results\x91\xc4\x01\x07\xa6finder\x82\xa6worker\xa1w\xa4host\xa1h".to_vec()],
        "store-url" => {
            ["sqlite:a/b.db", "sqlite:///a.db", "memory:", "postgres://user:word@host:5432/name?sslmode=disable"]
                .map(|text| text.as_bytes().to_vec())
                .into()
        }
        "tokens" => {
            vec![format!("# who\nclient token-0123456789abc\nworker sha256:{}\n", "0f".repeat(32)).into_bytes()]
        }
        "token" => vec![b"0123456789abcdef".to_vec()],
        "sequence" => ["{ m [1 1] 0, -90 c [1 1] 0 } # kept\nL 3 { { m [0 0] 30°, −60; m [2 1] 0, 0 } L 2 { { } } }"]
            .map(|text| text.as_bytes().to_vec())
            .into(),
        "initial-states" => {
            vec![b"ID 0 p(0,0,0) z(0,1,0) y(-1,0,0) (0, 0)\nID 1 p(-1,1,0) z(-1,0,0) y(0,1,0) (0, 30)".to_vec()]
        }
        "addresses" => vec![b"https://a.example:7077,http://[::1]:7078".to_vec()],
        _ => Vec::new(),
    }
}

/// Returns every shipped robot as MJCF and as URDF.
fn exchanged_seeds() -> Vec<Vec<u8>> {
    let specs = catalogue::robots().iter().filter_map(|entry| toml::from_str::<RobotSpec>(entry.toml).ok());
    let robots = specs.filter_map(|spec| Robot::compile(&spec).ok());
    let physics = Physics::of_scale(Scale::Paper);
    robots
        .flat_map(|robot| {
            [Format::Mjcf, Format::Urdf].map(|f| f.write(&robot, &physics).unwrap_or_default().into_bytes())
        })
        .collect()
}

/// Returns the first message of a worker that still runs an assignment.
fn hello_seeds() -> Vec<Vec<u8>> {
    let running = v1::RunningAssignment { assignment_id: 7, job_id: "j1".to_owned(), count: 3, ..Default::default() };
    let hello = v1::Hello {
        protocol: proto::PROTOCOL,
        worker_id: "w".to_owned(),
        name: "node:1".to_owned(),
        slots: 2,
        engine_digests: vec![vec![7; 32]],
        running: vec![running],
        version: "0.1.0".to_owned(),
        ..Default::default()
    };
    vec![hello.encode_to_vec()]
}

/// Returns the completion of an assignment by results and by a failure.
fn complete_seeds() -> Vec<Vec<u8>> {
    let with = |outcome| v1::CompleteRequest {
        worker_id: "w".to_owned(),
        assignment_id: 7,
        job_id: "j1".to_owned(),
        engine_digest: vec![7; 32],
        round: 2,
        first: 2,
        count: 2,
        permit: vec![1; 64],
        compute_us: 1000,
        outcome: Some(outcome),
        tasks: vec![vec![2]; 2],
    };
    [
        v1::complete_request::Outcome::Results(v1::Results { results: vec![vec![3; 9]; 2] }),
        v1::complete_request::Outcome::Failure("it panicked".to_owned()),
    ]
    .map(|outcome| with(outcome).encode_to_vec())
    .into()
}

/// Returns messages of four types, each behind the byte that selects its type in [`messages`].
fn message_seeds() -> Vec<Vec<u8>> {
    let best = v1::Value { name: "best".to_owned(), unit: "%".to_owned(), value: Some(f64::NAN) };
    let row = v1::Row { series: "generations".to_owned(), index: 1, values: vec![best.clone()] };
    let progress = v1::Progress { phase: "searching".to_owned(), values: vec![best], ..Default::default() };
    let job = v1::Job { id: "j1".to_owned(), progress: Some(progress.clone()), ..Default::default() };
    let event = v1::JobEvent { sequence: 1, job: Some(job), ..Default::default() };
    let assign = v1::Assign { job_id: "j1".to_owned(), tasks: vec![vec![1; 9]], ..Default::default() };
    let message = Some(v1::coordinator_message::Message::Assign(assign));
    [
        (4, event.encode_to_vec()),
        (8, row.encode_to_vec()),
        (9, progress.encode_to_vec()),
        (10, v1::CoordinatorMessage { message }.encode_to_vec()),
    ]
    .map(|(kind, message)| [&[kind], message.as_slice()].concat())
    .into()
}

/// Parses a motion sequence. What parses must print to the same program.
fn sequence(text: &str) {
    let Ok(program) = sequence::parse(text) else { return };
    assert!((1..=MAX_SEGMENTS).contains(&program.count()));
    assert_eq!(sequence::parse(&program.to_string()).as_ref(), Ok(&program));
}

/// Parses initial states of M-TRAN modules, and places the modules.
fn initial_states(text: &str) {
    if let Ok(places) = mtran::parse(text) {
        assert_eq!(mtran::parse(&mtran::print(&places)).as_ref(), Ok(&places));
    }
    if let Ok(configuration) = Configuration::of_text(text)
        && let Ok(spec) = configuration.robot("fuzzed", "")
    {
        let _ = Robot::compile(&spec);
    }
}

/// Passes texts up to the allowed length on to the parser; longer ones are refused before parsing.
fn with_text(bytes: &[u8], read: impl Fn(&str)) {
    if let Ok(text) = std::str::from_utf8(bytes)
        && text.len() <= MAX_TOML_LENGTH
    {
        read(text);
    }
}

/// Reads a whole job and settles its robot.
fn job(bytes: &[u8]) {
    with_text(bytes, |text| {
        if let Ok(job) = Job::from_toml(text) {
            let again = Job::from_toml(&job.to_toml()).expect("a written job can be read again");
            assert_eq!(again.digest(), job.digest(), "a written job must have the same digest");
        }
    });
}

fn job_spec(bytes: &[u8]) {
    with_text(bytes, |text| drop(toml::from_str::<JobSpec>(text)));
}

fn robot(bytes: &[u8]) {
    with_text(bytes, |text| {
        if let Ok(spec) = toml::from_str::<RobotSpec>(text) {
            let _ = Robot::compile(&spec);
        }
    });
}

/// Reads a robot as MJCF or URDF.
fn exchanged(bytes: &[u8]) {
    with_text(bytes, |text| {
        if let Ok(import) = exchange::read(text) {
            Robot::compile(&import.robot).expect("an imported robot compiles");
        }
    });
}

fn environment(bytes: &[u8]) {
    with_text(bytes, |text| drop(Environment::from_toml(text)));
}

fn fidelity(bytes: &[u8]) {
    with_text(bytes, |text| drop(FidelityTable::from_toml(text)));
}

/// Reads the other messages of the protocol. The first byte selects the type.
fn messages(bytes: &[u8]) {
    let Some((kind, bytes)) = bytes.split_first() else {
        return;
    };
    match kind % 11 {
        0 => drop(v1::SubmitJobRequest::decode(bytes)),
        1 => drop(v1::ListJobsRequest::decode(bytes)),
        2 => drop(v1::WatchJobRequest::decode(bytes)),
        3 => drop(v1::WorkerMessage::decode(bytes)),
        4 => drop(v1::JobEvent::decode(bytes)),
        5 => drop(v1::GetResultResponse::decode(bytes)),
        6 => drop(v1::ListWorkersResponse::decode(bytes)),
        7 => drop(v1::ListJobsResponse::decode(bytes)),
        8 => drop(v1::Row::decode(bytes).map(procedure::SeriesRow::from)),
        9 => drop(v1::Progress::decode(bytes).map(procedure::Progress::from)),
        _ => drop(v1::CoordinatorMessage::decode(bytes)),
    }
}

/// Small job with encoded data of its rounds.
struct Example {
    problem: Checked,
    /// Encoded preparation, which all later tasks share.
    preparation: Vec<u8>,
    /// Result of round 0.
    outcome: Vec<u8>,
    /// Saved state before round 1.
    prepared: Vec<u8>,
    /// Saved states before round 0 and before round 1.
    states: Vec<Vec<u8>>,
    /// Tasks of round 1.
    tasks: Vec<Vec<u8>>,
    results: Vec<Vec<u8>>,
}

/// Examples, one per procedure.
static EXAMPLES: LazyLock<[Example; 3]> =
    LazyLock::new(|| [tiny_job(1, 2), planning_job(1, 2), simulating_job(1, 2)].map(|job_toml| Example::of(&job_toml)));

/// Hooks that let every task run to its end.
struct Patient;

impl Hooks for Patient {
    fn stop(&self) -> bool {
        false
    }
}

impl Example {
    fn of(job_toml: &str) -> Self {
        let problem = Checked::from_toml(job_toml).expect("the text is a valid job file");
        let bench = Bench::of(problem.clone()).expect("a checked job has a bench");
        let mut procedure = procedure::start(&problem).expect("a checked job has a procedure");
        let before = procedure.save();
        let outcome =
            bench.run(0, &[], &[(0, procedure.task(0))], &Patient).expect("the preparation runs").swap_remove(0);
        let _ = procedure.tell(&[outcome.clone().into()]);
        let round = procedure.round();
        let tasks: Vec<Vec<u8>> = (0..round.tasks).map(|index| procedure.task(index)).collect();
        let numbered: Vec<(u32, Vec<u8>)> = (0..).zip(tasks.clone()).collect();
        let results = bench.run(round.number, &round.shared, &numbered, &Patient).expect("the tasks of round 1 run");
        let prepared = procedure.save();
        let states = vec![before, prepared.clone()];
        Self { problem, preparation: round.shared.to_vec(), outcome, prepared, states, tasks, results }
    }

    fn procedure(&self, saved: &[u8]) -> Option<Box<dyn Procedure>> {
        procedure::load(&self.problem, saved).ok()
    }
}

/// Reads a task as a worker does.
fn task(bytes: &[u8]) {
    let evolves = evolve::Task::decode(bytes).map(|task| task.encode());
    let plans = plan::Task::decode(bytes).map(|task| task.encode());
    let simulates = simulate::Task::decode(bytes).map(|task| task.encode());
    for encoded in [evolves, plans, simulates].into_iter().flatten() {
        assert_eq!(encoded, bytes, "a task must have one encoding");
    }
}

/// Reads and checks a task result as a coordinator does.
fn task_result(bytes: &[u8]) {
    let evolved = evolve::TaskResult::decode(bytes).map(|result| result.encode());
    let planned = plan::TaskResult::decode(bytes).map(|result| result.encode());
    let simulated = simulate::TaskResult::decode(bytes).map(|result| result.encode());
    for (example, decoded) in EXAMPLES.iter().zip([evolved, planned, simulated]) {
        let procedure = example.procedure(&example.prepared).expect("a saved state can be loaded");
        let checked = procedure.check(0, bytes);
        let _ = procedure.show(bytes);
        match decoded {
            Ok(encoded) => assert_eq!(encoded, bytes, "a result must have one encoding"),
            Err(_) => assert!(checked.is_err(), "an unreadable result must be refused"),
        }
    }
}

/// Reads the result of round 0 and the data that later rounds share.
fn preparation(bytes: &[u8]) {
    if let Ok(outcome) = PreparationOutcome::decode(bytes) {
        assert_eq!(outcome.encode(), bytes, "an outcome must have one encoding");
    }
    let decoded = Preparation::decode(bytes);
    for example in EXAMPLES.iter() {
        if let Ok(preparation) = &decoded {
            assert_eq!(preparation.encode(), bytes, "a preparation must have one encoding");
            let _ = example.problem.takes(preparation);
        }
        let preparing = procedure::start(&example.problem).expect("a checked job has a procedure");
        let _ = (preparing.check(0, bytes), preparing.show(bytes));
    }
}

/// Loads a saved state of a job and its round.
fn state(bytes: &[u8]) {
    for example in EXAMPLES.iter() {
        let Some(mut procedure) = example.procedure(bytes) else { continue };
        let round = procedure.round();
        let _ = (procedure.task(round.tasks - 1), procedure.describe(0), procedure.progress(), procedure.save());
        let result: Arc<[u8]> = example.results[0].clone().into();
        if (0..round.tasks).all(|index| procedure.check(index, &result).is_ok()) {
            let _ = procedure.tell(&vec![result; round.tasks as usize]);
        }
    }
}

fn token(bytes: &[u8]) {
    with_text(bytes, |text| {
        if let Ok(token) = Token::parse(text, "it") {
            assert_eq!(token.reveal(), text);
        }
    });
}

fn addresses(bytes: &[u8]) {
    with_text(bytes, |text| {
        if let Ok(addresses) = text.parse::<Addresses>() {
            assert_eq!(addresses.to_string().parse(), Ok(addresses), "written addresses must be equal when read again");
        }
    });
}
