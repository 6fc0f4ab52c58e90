//! A procedure of another kind than those that ship: registered, run, saved and loaded.

use sim_core::base::error::Invalid;
use sim_core::base::registry::{Component, Registered};
use sim_core::problem::{Checked, Job};
use sim_core::procedure::{
    self, Artefact, BadState, Bench, Hooks, NotRun, Procedure, ProcedureKind, Progress, Rejected, Round, Step, Told,
};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

/// One round of two tasks, each of which reports the height of the settled pivot times its task's byte.
struct Heights;

struct Asked;

static REVISION: AtomicU32 = AtomicU32::new(1);

impl Component for Heights {
    fn name(&self) -> &'static str {
        "heights"
    }

    fn revision(&self) -> u32 {
        REVISION.load(Ordering::Relaxed)
    }
}

impl ProcedureKind for Heights {
    fn start(&self, _problem: &Checked) -> Result<Box<dyn Procedure>, Invalid> {
        Ok(Box::new(Asked))
    }

    fn load(&self, _problem: &Checked, saved: &[u8]) -> Result<Box<dyn Procedure>, BadState> {
        if saved == b"asked" { Ok(Box::new(Asked)) } else { Err(BadState("it is not \"asked\"".to_owned())) }
    }

    fn run(&self, problem: &Job, tasks: &[(u32, Vec<u8>)], _hooks: &dyn Hooks) -> Result<Vec<Vec<u8>>, NotRun> {
        let height = f64::from(problem.start().pivot.translation.z);
        Ok(tasks.iter().map(|(_, task)| (height * f64::from(task[0])).to_le_bytes().to_vec()).collect())
    }
}

impl Procedure for Asked {
    fn round(&self) -> Round {
        let shared = Arc::from([].as_slice());
        Round { number: 0, tasks: 2, at_most: 2, lanes: 1, phase: "measuring", shared, kept: false }
    }

    fn task(&self, index: u32) -> Vec<u8> {
        vec![1 + index as u8]
    }

    fn describe(&self, index: u32) -> String {
        format!("height {index}")
    }

    fn check(&self, index: u32, result: &[u8]) -> Result<(), Rejected> {
        let reason = "8 bytes are needed".to_owned();
        if result.len() == 8 { Ok(()) } else { Err(Rejected { task: self.describe(index), reason }) }
    }

    fn show(&self, result: &[u8]) -> String {
        format!("{result:?}")
    }

    fn tell(&mut self, results: &[Arc<[u8]>]) -> Told {
        let content = results.concat();
        let artefact = Artefact { name: "heights".into(), media_type: "application/octet-stream".into(), content };
        Told { row: None, step: Step::Done(vec![artefact]) }
    }

    fn save(&self) -> Vec<u8> {
        b"asked".to_vec()
    }

    fn progress(&self) -> Progress {
        Progress { phase: "measuring".into(), ..Progress::default() }
    }
}

struct Never;

impl Hooks for Never {
    fn stop(&self) -> bool {
        false
    }
}

const JOB: &str = "name = \"a\"\nrobot = \"quadropod\"\nenvironment = \"empty\"\ngaits = { count = 1, duration = 1.0 }\n\
                   fitness = { kind = \"coverage\" }\noptimiser = { kind = \"pso\" }\nfinish = { kind = \"none\" }\n";

#[test]
fn procedure_that_was_added_runs_after_the_preparation() {
    let text = format!("procedure = \"heights\"\n{JOB}");
    let job = Checked::from_toml(&text).unwrap();
    let Err(Invalid::Unknown { field, known, .. }) = procedure::start(&job) else { panic!("nobody added it") };
    assert_eq!((field.as_str(), known), ("procedure", vec!["evolve".to_owned()]));

    <dyn ProcedureKind>::registry().add(&Heights).unwrap();
    assert_eq!(procedure::name(&job).unwrap(), "heights");
    let bench = Bench::open(&job.to_toml()).unwrap();
    let mut procedure = procedure::start(&job).unwrap();
    let mut phases = Vec::new();
    let heights = loop {
        procedure = procedure::load(&job, &procedure.save()).unwrap();
        let round = procedure.round();
        phases.push((round.number, round.phase));
        let tasks: Vec<(u32, Vec<u8>)> = (0..round.tasks).map(|i| (i, procedure.task(i))).collect();
        let results = bench.run(round.number, &round.shared, &tasks, &Never).unwrap();
        for (i, result) in results.iter().enumerate() {
            procedure.check(i as u32, result).unwrap();
        }
        let results: Vec<Arc<[u8]>> = results.into_iter().map(Into::into).collect();
        match procedure.tell(&results).step {
            Step::Next => {}
            Step::Done(artefacts) => break artefacts[0].content.clone(),
            step => panic!("{step:?}"),
        }
    };
    assert_eq!(phases, [(0, "preparing"), (1, "measuring")]);
    let height = f64::from(Job::from_toml(&job.to_toml()).unwrap().start().pivot.translation.z);
    assert_eq!(heights, [height, 2.0 * height].map(f64::to_le_bytes).concat());

    let of_revision = |revision| {
        REVISION.store(revision, Ordering::Relaxed);
        job.digest()
    };
    assert_ne!(of_revision(1), of_revision(2), "what computes something else makes another job");
}

#[test]
fn the_procedure_of_a_job_that_names_none_is_no_part_of_its_identity() {
    let (unnamed, named) = (Checked::from_toml(JOB).unwrap(), format!("procedure = \"evolve\"\n{JOB}"));
    assert_eq!(procedure::name(&unnamed).unwrap(), "evolve");
    assert_eq!(unnamed.digest(), Checked::from_toml(&named).unwrap().digest());
}
