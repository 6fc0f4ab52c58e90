//! Tests of procedures: golden jobs run round by round, results that are refused, states that are saved and loaded.

use sim_core::base::encoding;
use sim_core::base::score::Counts;
use sim_core::problem::Checked;
use sim_core::procedure::evolve::finish::Question;
use sim_core::procedure::evolve::report::Report;
use sim_core::procedure::evolve::{Task, TaskResult};
use sim_core::procedure::preparing::PreparationOutcome;
use sim_core::procedure::{self, Bench, Hooks, NotRun, Procedure, RoundEnd, SeriesRow, Step};
use sim_core::report::Traces;
use std::cell::Cell;
use std::fs;
use std::path::Path;
use std::sync::Arc;

/// Hooks that stop the work at the n-th call of `stop`.
pub struct StopAfter(pub Cell<u64>);

impl Hooks for StopAfter {
    fn stop(&self) -> bool {
        self.0.set(self.0.get().saturating_sub(1));
        self.0.get() == 0
    }
}

fn never() -> StopAfter {
    StopAfter(Cell::new(u64::MAX))
}

/// Order and grouping of a round's tasks.
#[derive(Clone, Copy)]
pub enum Batches {
    /// In order, with as many tasks as the round allows.
    Full,
    /// In reverse order, one by one.
    BackwardsAlone,
    /// Tasks with an even index, then those with an odd one.
    EvenOdd,
}

struct Ran {
    rows: Vec<SeriesRow>,
    states: Vec<Vec<u8>>,
    phases: Vec<&'static str>,
    report: Report,
}

/// Runs a round's tasks and returns their results by index.
pub fn results_of(procedure: &dyn Procedure, bench: &Bench, batches: Batches) -> Vec<Arc<[u8]>> {
    let round = procedure.round();
    let all: Vec<(u32, Vec<u8>)> = (0..round.tasks).map(|i| (i, procedure.task(i))).collect();
    let of = |keep: fn(&(u32, Vec<u8>)) -> bool| all.iter().filter(|task| keep(task)).cloned().collect::<Vec<_>>();
    let calls: Vec<Vec<(u32, Vec<u8>)>> = match batches {
        Batches::Full => all.chunks(round.at_most as usize).map(<[_]>::to_vec).collect(),
        Batches::BackwardsAlone => all.iter().rev().map(|task| vec![task.clone()]).collect(),
        Batches::EvenOdd => vec![of(|(i, _)| i % 2 == 0), of(|(i, _)| i % 2 == 1)],
    };
    let mut results: Vec<Arc<[u8]>> = vec![Arc::from([].as_slice()); all.len()];
    for tasks in calls.iter().filter(|tasks| !tasks.is_empty()) {
        let done = bench.run(round.number, &round.shared, tasks, &never()).unwrap();
        assert_eq!(done.len(), tasks.len());
        for ((index, _), result) in tasks.iter().zip(done) {
            procedure.check(*index, &result).unwrap();
            results[*index as usize] = result.into();
        }
    }
    results
}

/// Runs a job to its end, and saves and loads the procedure before every round.
fn run(job: &Checked, batches: Batches) -> Ran {
    let bench = Bench::open(&job.to_toml()).unwrap();
    let mut procedure = procedure::start(job).unwrap();
    let (mut rows, mut states, mut phases) = (Vec::new(), Vec::new(), Vec::new());
    loop {
        let saved = procedure.save();
        procedure = procedure::load(job, &saved).unwrap();
        assert_eq!(procedure.save(), saved);
        states.push(saved);
        let round = procedure.round();
        assert_eq!(round.number as usize, phases.len());
        assert_eq!(procedure.progress().phase, round.phase);
        phases.push(round.phase);
        let results = results_of(&*procedure, &bench, batches);
        let RoundEnd { row, step } = procedure.tell(&results);
        rows.extend(row);
        match step {
            Step::Next => {}
            Step::Done(artefacts) => {
                let [artefact] = &artefacts[..] else { panic!("{} artefacts", artefacts.len()) };
                assert_eq!((&*artefact.name, &*artefact.media_type), ("report", "application/json"));
                return Ran { rows, states, phases, report: serde_json::from_slice(&artefact.content).unwrap() };
            }
            step => panic!("{step:?}"),
        }
    }
}

/// A golden job and its recorded results.
fn golden(name: &str) -> (Checked, serde_json::Value) {
    let file = |suffix: &str| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../tests/golden/{name}.{suffix}"));
        fs::read_to_string(path).unwrap()
    };
    (Checked::from_toml(&file("toml")).unwrap(), serde_json::from_str(&file("json")).unwrap())
}

fn assert_recorded(name: &str) {
    let (job, recorded) = golden(name);
    let ran = run(&job, Batches::Full);
    let lines: Vec<String> = ran
        .rows
        .iter()
        .map(|row| {
            assert_eq!(row.series, "generations");
            let number = |value: &procedure::Value| value.value.map(|v| v.to_string()).unwrap_or_default();
            let numbers: Vec<String> = row.values[..8].iter().map(number).collect();
            format!("{},{}", row.index, numbers.join(","))
        })
        .collect();
    let history: Vec<&str> = recorded["history"].as_array().unwrap().iter().map(|l| l.as_str().unwrap()).collect();
    let columns: Vec<&str> = ran.rows[0].values.iter().map(|value| &*value.name).collect();
    assert_eq!(format!("generation,{}", columns[..8].join(",")), history[0]);
    assert_eq!(lines, history[1..], "{name}");

    let report = serde_json::to_value(&ran.report).unwrap();
    let winner = &recorded["winner"];
    assert_eq!(report["winner"]["generation"], winner["generation"], "{name}");
    assert_eq!(report["winner"]["candidate"], winner["candidate"], "{name}");
    assert_eq!(report["winner"]["score"], winner["fitness"], "{name}");
    assert_eq!(report["winner_scores"]["fresh"], winner["fresh"], "{name}");
    let reference = sim_core::base::score::mean(&ran.report.winner_scores.reference);
    assert_eq!(reference, winner["reference"].as_f64(), "{name}");
    let genotype: Vec<&serde_json::Value> = winner["genome"].as_array().unwrap().iter().map(|p| &p["value"]).collect();
    assert_eq!(report["winner"]["genome"].as_array().unwrap().iter().collect::<Vec<_>>(), genotype, "{name}");

    let finishing = usize::from(job.finish().is_some());
    let phases: Vec<&str> = ["preparing"]
        .into_iter()
        .chain(vec!["searching"; history.len() - 1])
        .chain(vec!["finishing"; finishing])
        .chain(["reporting"])
        .collect();
    assert_eq!(ran.phases, phases, "{name}");
}

#[test]
fn golden_jobs_on_lockstep_keep_their_scores() {
    assert_recorded("quadropod-ga-lockstep");
    assert_recorded("lizard-sine-lockstep-real");
}

#[test]
fn golden_job_with_a_finish_keeps_its_scores() {
    assert_recorded("quadropod-finish");
}

#[test]
fn golden_jobs_on_rapier_keep_their_scores() {
    assert_recorded("lizard-coverage-3d");
    assert_recorded("lizard-pso-rapier");
    assert_recorded("quadropod-constriction-goal");
    assert_recorded("lizard-stairs-rapier");
}

pub const SMALL: &str = "name = \"small\"\nrobot = \"quadropod\"\nenvironment = \"empty\"\n\
    gaits = { count = 2, duration = 1.0 }\nfitness = { kind = \"coverage\" }\nplanner = { iterations = 8 }\n\
    optimiser = { kind = \"ga\", population = 4, generations = 2 }\nphysics = { engine = \"lockstep\" }\n\
    finish = { archive = 2, seeds = 2, steps_per_second = 30, substeps = 8 }\n";

pub fn small() -> Checked {
    Checked::from_toml(SMALL).unwrap()
}

#[test]
fn batches_and_their_order_change_no_bit() {
    let job = small();
    let [full, backwards, even_odd] =
        [Batches::Full, Batches::BackwardsAlone, Batches::EvenOdd].map(|batches| run(&job, batches));
    for other in [&backwards, &even_odd] {
        assert_eq!(full.states, other.states);
        assert_eq!(full.rows, other.rows);
        assert_eq!(full.report, other.report);
    }
}

/// Returns the job's procedure at the first round of `phase`; the rounds before have made-up scores.
fn at_phase(job: &Checked, bench: &Bench, phase: &str) -> Box<dyn Procedure> {
    let mut procedure = procedure::start(job).unwrap();
    while procedure.round().phase != phase {
        let round = procedure.round();
        let results: Vec<Arc<[u8]>> = match round.phase {
            "preparing" => results_of(&*procedure, bench, Batches::Full),
            _ => (0..round.tasks).map(|i| made_up(&procedure.task(i)).encode().into()).collect(),
        };
        for (i, result) in results.iter().enumerate() {
            procedure.check(i as u32, result).unwrap();
        }
        assert_eq!(procedure.tell(&results).step, Step::Next);
    }
    procedure
}

/// Returns a made-up, valid result of a task.
fn made_up(task: &[u8]) -> TaskResult {
    match Task::decode(task).unwrap() {
        Task::Evaluate { generation, candidate, .. } => evaluated(Some(f64::from(10 * generation + candidate))),
        Task::Examine(examination) => {
            let trees = if examination.question == Question::WithoutReuse { 1 } else { 2 };
            TaskResult::Examined { scores: vec![Some(1.5); trees], counts: Counts::default(), traces: None }
        }
    }
}

pub fn evaluated(score: Option<f64>) -> TaskResult {
    TaskResult::Evaluated { genotype: None, score, descriptors: Vec::new(), counts: Counts::default() }
}

/// Asserts that each of these results is refused for its reason, and that the procedure does not change.
pub fn assert_refused(procedure: &dyn Procedure, index: u32, results: Vec<(Vec<u8>, &str)>) {
    let before = procedure.save();
    for (result, reason) in results {
        let refused = procedure.check(index, &result).expect_err(reason).to_string();
        let subject = format!("the result of {} is refused: ", procedure.describe(index));
        assert!(refused.starts_with(&subject) && refused.contains(reason), "\"{refused}\" must contain \"{reason}\"");
    }
    assert_eq!(procedure.save(), before);
}

#[test]
fn impossible_results_of_an_evaluation_are_refused() {
    let job = small();
    let bench = Bench::open(&job.to_toml()).unwrap();
    let procedure = at_phase(&job, &bench, "searching");
    assert_eq!(procedure.describe(3), "the evaluation of candidate 3 of generation 0");
    let counted = |counts: Counts| {
        let result = TaskResult::Evaluated { genotype: None, score: Some(1.0), descriptors: Vec::new(), counts };
        result.encode()
    };
    let with = |genotype, descriptors| {
        TaskResult::Evaluated { genotype, score: Some(1.0), descriptors, counts: Counts::default() }.encode()
    };
    let sound = evaluated(Some(1.0)).encode();
    procedure.check(0, &sound).unwrap();
    procedure.check(0, &evaluated(None).encode()).unwrap();
    let mut refused: Vec<(Vec<u8>, &str)> = vec![
        (Vec::new(), "it is empty"),
        (vec![7], "its format is 7"),
        ([&sound[..], &[0]].concat(), "it is not canonical"),
        (procedure.task(0), "another kind of value"),
        (evaluated(Some(f64::NAN)).encode(), "score NaN is out of range"),
        (evaluated(Some(f64::INFINITY)).encode(), "score inf is out of range"),
        (evaluated(Some(-0.1)).encode(), "score -0.1 is out of range: allowed is 0 to 100"),
        (evaluated(Some(100.1)).encode(), "score 100.1 is out of range"),
        (with(Some(vec![0.0].into()), Vec::new()), "a genotype other than the one sent"),
        (with(None, vec![1.0]), "descriptors"),
        (counted(Counts { rollouts: 17, ..Counts::default() }), "rollouts, 17, is impossible: at most 16"),
        (counted(Counts { rollouts: 1, unstable: 2, ..Counts::default() }), "unstable rollouts, 2"),
        (counted(Counts { rollouts: 1, simulated_ms: 16_001, ..Counts::default() }), "simulated milliseconds, 16001"),
        (counted(Counts { edges: 17, ..Counts::default() }), "edges, 17"),
        (counted(Counts { edges: 1, rejected: 2, ..Counts::default() }), "rejected edges, 2"),
        (counted(Counts { nodes: u64::MAX, ..Counts::default() }), "nodes, "),
        (
            TaskResult::Examined { scores: vec![], counts: Counts::default(), traces: None }.encode(),
            "it is the result of an examination, not of an evaluation",
        ),
    ];
    refused.extend((1..sound.len()).map(|cut| (sound[..cut].to_vec(), "it can't be decoded")));
    assert_refused(&*procedure, 0, refused);
    assert!(procedure.check(4, &sound).is_err());
}

#[test]
fn impossible_results_of_an_examination_are_refused() {
    let job = small();
    let bench = Bench::open(&job.to_toml()).unwrap();
    let procedure = at_phase(&job, &bench, "finishing");
    let (round, last) = (procedure.round(), procedure.round().tasks - 1);
    assert_eq!((round.at_most, round.lanes, round.kept), (1, 1, false));
    assert!(
        procedure.describe(last).starts_with("the examination of the scores on the reference setting of candidate ")
    );
    let examined =
        |scores: Vec<Option<f64>>, traces| TaskResult::Examined { scores, counts: Counts::default(), traces }.encode();
    procedure.check(last, &examined(vec![None; 2], None)).unwrap();
    let refused = vec![
        (examined(vec![Some(1.0)], None), "it has 1 scores; 2 are needed"),
        (examined(vec![Some(1.0); 3], None), "it has 3 scores; 2 are needed"),
        (examined(vec![Some(1.0), None], None), "they fail together"),
        (examined(vec![Some(1.0), Some(f64::NAN)], None), "score NaN"),
        (examined(vec![Some(1.0); 2], Some(Traces::default())), "traces, which were not requested"),
        (evaluated(Some(1.0)).encode(), "it is the result of an evaluation, not of an examination"),
    ];
    assert_refused(&*procedure, last, refused);
}

#[test]
fn impossible_traces_are_refused() {
    let job = small();
    let bench = Bench::open(&job.to_toml()).unwrap();
    let procedure = at_phase(&job, &bench, "reporting");
    let round = procedure.round();
    let is_traces =
        |i: &u32| matches!(Task::decode(&procedure.task(*i)), Ok(Task::Examine(e)) if e.question == Question::Traces);
    let index = (0..round.tasks).find(is_traces).unwrap();
    let tasks = [(index, procedure.task(index))];
    let result = bench.run(round.number, &round.shared, &tasks, &never()).unwrap().swap_remove(0);
    procedure.check(index, &result).unwrap();
    assert_eq!(procedure.show(&result), "traces");
    let Ok(TaskResult::Examined { scores, counts, traces: Some(traces) }) = TaskResult::decode(&result) else {
        panic!("the result must have traces")
    };
    let with = |change: &dyn Fn(&mut Traces)| {
        let mut traces = traces.clone();
        change(&mut traces);
        TaskResult::Examined { scores: scores.clone(), counts, traces: Some(traces) }.encode()
    };
    let refused = vec![
        (TaskResult::Examined { scores: scores.clone(), counts, traces: None }.encode(), "its traces are missing"),
        (with(&|t| *t = Traces::default()), "0 gaits instead of 2"),
        (with(&|t| t.gaits[1].parameters[0] += 1e-9), "its parameters are not those of the genome"),
        (with(&|t| t.gaits[0].joints[0].push('x')), "its joints are not the robot's"),
        (with(&|t| t.gaits[0].samples.clear()), "it has no samples"),
        (with(&|t| t.gaits[0].unstable = Some("x".repeat(5000))), "the reason of its instability"),
        (with(&|t| t.gaits[0].samples[1].angles.push(0.0)), "targets and angles"),
        (with(&|t| t.gaits[0].samples[1].yaw = f64::NAN), "not finite"),
        (with(&|t| t.gaits[0].samples[1].time = 0.0), "sample 1 is at 0 s"),
        (with(&|t| t.gaits[0].samples[1].time = 99.0), "sample 1 is at 99 s"),
        (with(&|t| t.tree.nodes.clear()), "its tree has 0 nodes"),
        (with(&|t| t.tree.nodes = vec![t.tree.nodes[0].clone(); 18]), "its tree has 18 nodes"),
        (with(&|t| t.tree.nodes[1].parent = Some(1)), "node 1 of its tree"),
        (with(&|t| t.tree.nodes[1].gait = Some(2)), "node 1 of its tree"),
        (with(&|t| t.tree.nodes[1].x = f64::INFINITY), "node 1 of its tree"),
        (with(&|t| t.tree.best_path = vec![0, 0]), "its best path"),
        (with(&|t| t.tree.best_path.clear()), "its best path"),
        (with(&|t| t.paths.truncate(2)), "instead of the three modes"),
        (with(&|t| t.paths[1].end_error = -1.0), "all its numbers finite"),
        (with(&|t| t.paths[2].way.clear()), "at least one point"),
    ];
    assert_refused(&*procedure, index, refused);
}

#[test]
fn search_without_a_success_fails_the_job() {
    let job = small();
    let bench = Bench::open(&job.to_toml()).unwrap();
    let mut procedure = at_phase(&job, &bench, "searching");
    let failed: Vec<Arc<[u8]>> = vec![evaluated(None).encode().into(); 4];
    let told = procedure.tell(&failed);
    assert_eq!(told.step, Step::Next);
    assert_eq!(told.row.unwrap().values[0].value, None);
    let Step::Failed(reason) = procedure.tell(&failed).step else { panic!("the job must fail") };
    assert!(reason.starts_with("all 8 evaluations failed"), "{reason}");
}

#[test]
fn tasks_of_another_job_are_not_run() {
    let job = small();
    let bench = Bench::open(&job.to_toml()).unwrap();
    let shared = job.prepare(&|| false).unwrap().encode();
    let evaluate =
        |numbers: Vec<f64>| Task::Evaluate { generation: 0, candidate: 0, genotype: numbers.into() }.encode();
    let length = job.space().longest();
    for (round, shared, task) in [
        (0, &[][..], vec![1]),
        (1, &shared[..], vec![]),
        (1, &shared[..], evaluate(vec![0.5; length + 1])),
        (1, &shared[..], evaluate(vec![f64::NAN; length])),
        (1, &shared[..], evaluate(vec![-9.0; length])),
        (1, &[][..], evaluate(vec![0.5; length])),
    ] {
        let ran = bench.run(round, shared, &[(0, task)], &never());
        assert!(matches!(ran, Err(NotRun::Task(_))), "{ran:?}");
    }
}

#[test]
fn damaged_state_is_refused_or_loaded_exactly() {
    let job = small();
    let bench = Bench::open(&job.to_toml()).unwrap();
    for phase in ["preparing", "searching", "finishing", "reporting"] {
        let saved = at_phase(&job, &bench, phase).save();
        for at in (0..saved.len()).step_by(if saved.len() > 2000 { 7 } else { 1 }) {
            let mut damaged = saved.clone();
            damaged[at] ^= 0x81;
            if let Ok(loaded) = procedure::load(&job, &damaged) {
                assert_eq!(loaded.save(), damaged, "byte {at} of {phase}");
                assert!(loaded.round().tasks > 0);
            }
            assert!(procedure::load(&job, &saved[..at]).is_err());
        }
        let other = Checked::from_toml(&SMALL.replace("population = 4", "population = 6")).unwrap();
        if phase != "preparing" {
            let refused = procedure::load(&other, &saved).map(|_| ()).unwrap_err().to_string();
            assert!(refused.starts_with("the stored state can't be used: "), "{refused}");
        }
    }
}

#[test]
pub fn results_of_each_kind_have_their_own_format() {
    let result = evaluated(Some(12.5));
    assert_eq!(result.to_string(), "score 12.5 (bits 4029000000000000)");
    assert_eq!(evaluated(None).to_string(), "failed");
    assert!(matches!(Task::decode(&result.encode()), Err(encoding::Unreadable::Format { .. })));
    assert!(matches!(PreparationOutcome::decode(&result.encode()), Err(encoding::Unreadable::Format { .. })));
}
