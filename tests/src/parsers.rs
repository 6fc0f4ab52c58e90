//! Every parser as a function of bytes: what `fuzz/` feeds, and what the recorded inputs in `fuzz/regressions` are run
//! through. A parser may refuse; it may not panic, hang or take memory without bound.

use prost::Message;
use proto::{credentials::Token, dial::Addresses, v1};
use sim_core::base::limits::MAX_TOML_LENGTH;
use sim_core::engines::known::Known;
use sim_core::exchange::{self, Format};
use sim_core::job::JobSpec;
use sim_core::model::catalogue::{self, Entry};
use sim_core::model::environment::Environment;
use sim_core::model::{Robot, RobotSpec};
use sim_core::physics::{Physics, Scale};
use sim_core::problem::Job;

/// A parser.
pub type Parser = fn(&[u8]);

/// All of them, by name.
pub const PARSERS: &[(&str, Parser)] = &[
    ("job", job),
    ("job-spec", job_spec),
    ("robot", robot),
    ("exchange", exchanged),
    ("environment", environment),
    ("fidelity", fidelity),
    ("hello", coordinator::parsers::hello),
    ("complete", coordinator::parsers::complete),
    ("assign", assign),
    ("messages", messages),
    ("blob", coordinator::parsers::blob),
    ("store-url", |bytes| with_text(bytes, coordinator::parsers::store_url)),
    ("tokens", |bytes| with_text(bytes, coordinator::parsers::tokens)),
    ("token", token),
    ("addresses", addresses),
];

/// Inputs that a parser takes, to begin with.
pub fn seeds(parser: &str) -> Vec<Vec<u8>> {
    let shipped = |entries: &[Entry]| entries.iter().map(|entry| entry.toml.as_bytes().to_vec()).collect();
    let candidate = || v1::ScoredCandidate { generation: 1, candidate: 2, score: Some(0.5), genome: vec![0.1, -0.0] };
    let counts = || v1::Counts { rollouts: 1, simulated_ms: 1000, ..Default::default() };
    match parser {
        "job" | "job-spec" => shipped(catalogue::jobs()),
        "robot" => shipped(catalogue::robots()),
        "environment" => shipped(catalogue::environments()),
        "fidelity" => vec![Known::shipped().to_toml().into_bytes()],
        "exchange" => {
            let specs = catalogue::robots().iter().filter_map(|entry| toml::from_str::<RobotSpec>(entry.toml).ok());
            let robots = specs.filter_map(|spec| Robot::compile(&spec).ok());
            let physics = Physics::of_scale(Scale::Paper);
            robots
                .flat_map(|robot| [Format::Mjcf, Format::Urdf].map(|f| f.write(&robot, &physics).into_bytes()))
                .collect()
        }
        "hello" => {
            let running =
                v1::RunningAssignment { assignment_id: 7, job_id: "j1".to_owned(), count: 3, ..Default::default() };
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
        "complete" => {
            let evaluations = vec![v1::EvaluationResult { score: Some(0.5), counts: Some(counts()) }; 2];
            let evaluated = v1::EvaluateResult { generation: 1, first: 2, evaluations };
            let scores = vec![v1::Score { score: Some(f64::NAN) }, v1::Score { score: None }];
            let traces_json = b"{\"gaits\":[]}".to_vec();
            let examined = v1::ExamineResult { round: 1, index: 2, scores, counts: Some(counts()), traces_json };
            let with = |result| v1::CompleteRequest {
                worker_id: "w".to_owned(),
                assignment_id: 7,
                job_id: "j1".to_owned(),
                engine_digest: vec![7; 32],
                result: Some(result),
                compute_us: 1000,
            };
            [
                v1::complete_request::Result::Evaluate(evaluated),
                v1::complete_request::Result::Examine(examined),
                v1::complete_request::Result::Failure("it panicked".to_owned()),
            ]
            .map(|result| with(result).encode_to_vec())
            .into()
        }
        "assign" => {
            let genomes = vec![v1::Genome { values: vec![0.1, 0.2] }; 2];
            let evaluate = v1::EvaluateTask { generation: 1, first: 2, genomes };
            let examine = v1::ExamineTask { round: 1, index: 2, question: 1, candidate: Some(candidate()) };
            [v1::assign::Task::Evaluate(evaluate), v1::assign::Task::Examine(examine)]
                .map(|task| {
                    let assign = v1::Assign { job_id: "j1".to_owned(), task: Some(task), ..Default::default() };
                    let message = Some(v1::coordinator_message::Message::Assign(assign));
                    v1::CoordinatorMessage { message }.encode_to_vec()
                })
                .into()
        }
        "messages" => {
            let job =
                v1::Job { id: "j1".to_owned(), best: Some(candidate()), counts: Some(counts()), ..Default::default() };
            let event = v1::JobEvent { sequence: 1, job: Some(job), ..Default::default() };
            vec![
                [&[4], event.encode_to_vec().as_slice()].concat(),
                [&[8], candidate().encode_to_vec().as_slice()].concat(),
            ]
        }
        // A version byte, then a message.
        "blob" => vec![[&[1], candidate().encode_to_vec().as_slice()].concat()],
        "store-url" => {
            ["sqlite:a/b.db", "sqlite:///a.db", "memory:", "postgres://user:word@host:5432/name?sslmode=disable"]
                .map(|text| text.as_bytes().to_vec())
                .into()
        }
        "tokens" => {
            vec![format!("# who\nclient token-0123456789abc\nworker sha256:{}\n", "0f".repeat(32)).into_bytes()]
        }
        "token" => vec![b"0123456789abcdef".to_vec()],
        "addresses" => vec![b"https://a.example:7077,http://[::1]:7078".to_vec()],
        _ => Vec::new(),
    }
}

/// Texts as long as they may be; longer ones are refused before anybody reads them.
fn with_text(bytes: &[u8], read: impl Fn(&str)) {
    if let Ok(text) = std::str::from_utf8(bytes)
        && text.len() <= MAX_TOML_LENGTH
    {
        read(text);
    }
}

/// A whole job, robot settled and all.
fn job(bytes: &[u8]) {
    with_text(bytes, |text| {
        if let Ok(job) = Job::from_toml(text) {
            let again = Job::from_toml(&job.to_toml()).expect("a job that was read is written so that it can be read");
            assert_eq!(again.digest(), job.digest(), "what is written out is the same job");
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

/// MJCF and URDF.
fn exchanged(bytes: &[u8]) {
    with_text(bytes, |text| {
        if let Ok(import) = exchange::read(text) {
            Robot::compile(&import.robot).expect("a robot that was imported is a robot");
        }
    });
}

fn environment(bytes: &[u8]) {
    with_text(bytes, |text| drop(Environment::from_toml(text)));
}

fn fidelity(bytes: &[u8]) {
    with_text(bytes, |text| drop(Known::from_toml(text)));
}

/// What a worker is told to do.
fn assign(bytes: &[u8]) {
    let Ok(v1::CoordinatorMessage { message: Some(v1::coordinator_message::Message::Assign(assign)) }) =
        v1::CoordinatorMessage::decode(bytes)
    else {
        return;
    };
    match assign.task {
        Some(v1::assign::Task::Evaluate(task)) => drop(proto::range_length(task.first, task.genomes.len())),
        Some(v1::assign::Task::Examine(task)) => drop(proto::examination(task)),
        None => {}
    }
}

/// Everything else that crosses the wire.
fn messages(bytes: &[u8]) {
    let Some((kind, bytes)) = bytes.split_first() else {
        return;
    };
    match kind % 10 {
        0 => drop(v1::SubmitJobRequest::decode(bytes)),
        1 => drop(v1::ListJobsRequest::decode(bytes)),
        2 => drop(v1::WatchJobRequest::decode(bytes)),
        3 => drop(v1::WorkerMessage::decode(bytes)),
        4 => drop(v1::JobEvent::decode(bytes)),
        5 => drop(v1::GetResultResponse::decode(bytes)),
        6 => drop(v1::ListWorkersResponse::decode(bytes)),
        7 => drop(v1::ListJobsResponse::decode(bytes)),
        8 => drop(v1::ScoredCandidate::decode(bytes).map(sim_core::search::Scored::try_from)),
        _ => drop(v1::EvaluateResult::decode(bytes).map(|result| proto::evaluations(&result))),
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
            assert_eq!(addresses.to_string().parse(), Ok(addresses), "written out it is the same");
        }
    });
}
