//! A procedure of another kind than those that ship: registered, run, saved and loaded.

use sim_core::base::error::Invalid;
use sim_core::problem::{Checked, Job};
use sim_core::procedure::{
    Artefact, BadState, Bench, Hooks, NotRun, Procedure, ProcedureKind, Progress, Rejected, Round, Step, Told, kinds,
    load_as, start_as,
};
use std::sync::Arc;

/// One round of two tasks, each of which reports the height of the settled pivot times its task's byte.
struct Heights;

struct Asked;

impl ProcedureKind for Heights {
    fn name(&self) -> &'static str {
        "heights"
    }

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

#[test]
fn procedure_of_another_kind_runs_after_the_preparation() {
    let job = Checked::from_toml(
        "name = \"a\"\nrobot = \"quadropod\"\nenvironment = \"empty\"\ngaits = { count = 1, duration = 1.0 }\n\
         fitness = { kind = \"coverage\" }\noptimiser = { kind = \"pso\" }\nfinish = { kind = \"none\" }",
    )
    .unwrap();
    let bench = Bench::of_kind(&Heights, job.clone());
    let mut procedure = start_as(&Heights, &job).unwrap();
    let mut phases = Vec::new();
    let heights = loop {
        procedure = load_as(&Heights, &job, &procedure.save()).unwrap();
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
}

#[test]
fn every_kind_of_procedure_has_a_name_of_its_own() {
    let names: Vec<&str> = kinds::KINDS.iter().map(|kind| kind.name()).collect();
    let distinct: std::collections::BTreeSet<&str> = names.iter().copied().collect();
    assert_eq!(distinct.len(), names.len());
    assert_eq!(names[0], "evolve");
}
