//! Procedure added by another program: it can be run, saved and loaded. Its revision is part of a job's identity.

use crate::examples::{self, Heights};
use sim_core::base::error::Invalid;
use sim_core::base::registry::Registered;
use sim_core::problem::{Checked, Job};
use sim_core::procedure::{self, Bench, Hooks, ProcedureKind, Step};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

struct Never;

impl Hooks for Never {
    fn stop(&self) -> bool {
        false
    }
}

const JOB: &str = "name = \"a\"\nrobot = \"quadropod\"\nenvironment = \"empty\"\ngaits = { count = 1, duration = 1.0 }\n\
                   fitness = { kind = \"coverage\" }\noptimiser = { kind = \"pso\" }\nfinish = { kind = \"none\" }\n";

#[test]
fn added_procedure_runs_after_the_preparation() {
    let of = |procedure: &str| Checked::from_toml(&format!("procedure = \"{procedure}\"\n{JOB}")).unwrap();
    let Err(Invalid::Unknown { field, known, .. }) = procedure::start(&of("depths")) else {
        panic!("an unknown procedure must be refused")
    };
    assert_eq!((field.as_str(), known[0].as_str()), ("procedure", "evolve"));

    examples::add();
    let job = of("heights");
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
    assert_eq!(heights, [1.0, 2.0, 3.0].map(|factor| (height * factor).to_le_bytes()).concat());
}

#[test]
fn procedure_revision_changes_the_job_digest() {
    static REVISED: Heights = Heights { name: "revised", revision: AtomicU32::new(1) };
    <dyn ProcedureKind>::registry().add(&REVISED).unwrap();
    let job = Checked::from_toml(&format!("procedure = \"revised\"\n{JOB}")).unwrap();
    let of_revision = |revision| {
        REVISED.revision.store(revision, Ordering::Relaxed);
        job.digest()
    };
    assert_ne!(of_revision(1), of_revision(2));
}

#[test]
fn default_procedure_does_not_change_the_job_digest() {
    let (unnamed, named) = (Checked::from_toml(JOB).unwrap(), format!("procedure = \"evolve\"\n{JOB}"));
    assert_eq!(procedure::name(&unnamed).unwrap(), "evolve");
    assert_eq!(unnamed.digest(), Checked::from_toml(&named).unwrap().digest());
}
