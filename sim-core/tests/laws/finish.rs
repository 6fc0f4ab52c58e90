//! Tests of the examinations of a finish.

use sim_core::base::score::mean;
use sim_core::evaluate::evaluate;
use sim_core::problem::Job;
use sim_core::procedure::evolve::finish::{Answer, Examination, Question, examine};
use sim_core::search::Scored;

fn job(more: &str) -> Job {
    Job::from_toml(&format!(
        r#"
        name = "small"
        seed = 5
        robot = "quadropod"
        environment = "empty-goal"
        gaits = {{ count = 2, duration = 2.0 }}
        fitness = {{ kind = "distance" }}
        optimiser = {{ kind = "pso", particles = 4, generations = 2 }}
        {more}
        "#
    ))
    .unwrap()
}

const PLANNER: &str = "planner = { iterations = 12, repeats = 2 }";

/// A candidate of the first generation, scored as the search does.
fn candidate(job: &Job, index: u32) -> Scored {
    let genotype = job.optimiser().ask().genotypes[index as usize].clone();
    let score = evaluate(job, 0, &[(index, genotype.clone())], &|| false).unwrap()[0].score.unwrap();
    Scored { generation: 0, candidate: index, score, genotype }
}

fn ask(job: &Job, question: Question, candidate: &Scored) -> Answer {
    examine(job, &Examination::new(question, candidate), &|| false).unwrap()
}

fn bits(scores: &[Option<f64>]) -> Vec<Option<u64>> {
    scores.iter().map(|s| s.map(f64::to_bits)).collect()
}

#[test]
fn audit_without_reuse_simulates_every_expansion() {
    let reuses = job(&format!("{PLANNER}\nfinish = {{ seeds = 2 }}"));
    let literal = job(&PLANNER.replace("repeats = 2", "repeats = 2, reuse_tolerance = 0.0"));
    let scored = candidate(&reuses, 1);
    let audit = ask(&reuses, Question::WithoutReuse, &scored);
    assert_eq!(audit.scores.len(), 2, "the audit must grow as many trees as the search");
    assert_eq!(mean(&audit.scores).unwrap().to_bits(), candidate(&literal, 1).score.to_bits());
    assert!(audit.counts.rollouts > ask(&reuses, Question::Fresh, &scored).counts.rollouts);
}

#[test]
fn lockstep_job_is_finished_on_the_rapier_reference() {
    let on = |engine: &str| job(&format!("{PLANNER}\nfinish = {{ seeds = 2 }}\nphysics = {{ engine = \"{engine}\" }}"));
    let (lockstep, rapier) = (on("lockstep"), on("rapier"));
    let scored = candidate(&lockstep, 1);
    let same = |question| {
        let [a, b] = [&lockstep, &rapier].map(|job| ask(job, question, &scored));
        assert_eq!(
            a.scores.len(),
            if question == Question::WithoutReuse { 2 } else { lockstep.fresh_seeds() as usize }
        );
        bits(&a.scores) == bits(&b.scores)
    };
    assert!([Question::Reference, Question::LessFriction, Question::MoreFriction].into_iter().all(same));
    assert!(![Question::Fresh, Question::WithoutReuse].into_iter().any(same));
}

#[test]
fn reference_is_the_job_with_finer_steps() {
    let finish = "finish = { seeds = 3, steps_per_second = 60, substeps = 16 }";
    let coarse = job(&format!("{PLANNER}\n{finish}"));
    let fine = job(&format!("{PLANNER}\n{finish}\nphysics = {{ steps_per_second = 60, substeps = 16 }}"));
    let scored = candidate(&coarse, 0);
    let reference = ask(&coarse, Question::Reference, &scored);
    assert_eq!(reference.scores.len(), 3);
    assert_eq!(bits(&reference.scores), bits(&ask(&fine, Question::Reference, &scored).scores));
    assert_ne!(
        bits(&reference.scores),
        bits(&ask(&fine, Question::Fresh, &scored).scores),
        "fresh seeds must grow other trees"
    );
    // All candidates have the same seeds: they do not depend on a candidate's generation and index.
    let elsewhere = Scored { generation: 7, candidate: 3, ..scored.clone() };
    assert_eq!(reference, ask(&coarse, Question::Reference, &elsewhere));
    assert_eq!(ask(&coarse, Question::Fresh, &scored), ask(&coarse, Question::Fresh, &elsewhere));
}

#[test]
fn friction_questions_change_friction_by_ten_percent() {
    let finish = "finish = { seeds = 2, steps_per_second = 60, substeps = 8 }";
    let slippery = |friction: f64| job(&format!("{PLANNER}\n{finish}\nphysics = {{ friction = {friction} }}"));
    let base = slippery(0.8);
    let scored = candidate(&base, 2);
    let less = ask(&base, Question::LessFriction, &scored);
    assert_eq!(less, ask(&slippery(0.8 * 0.9), Question::Reference, &scored));
    assert_ne!(less, ask(&base, Question::Reference, &scored));
    let more = ask(&base, Question::MoreFriction, &scored);
    assert_eq!(more, ask(&slippery(0.8 * 1.1), Question::Reference, &scored));
}

#[test]
fn traces_hold_the_tree_that_the_search_scored() {
    let job = job(&format!("{PLANNER}\nfinish = {{ kind = \"none\" }}"));
    let scored = candidate(&job, 1);
    let Answer { scores, counts, traces } = ask(&job, Question::Traces, &scored);
    let traces = traces.unwrap();
    assert!(scores.is_empty() && counts.rollouts > 0);
    assert_eq!((traces.gaits.len(), traces.paths.len()), (2, 3));
    assert_eq!(traces.gaits, sim_core::report::gaits(&job, &scored.genotype));
    let (tree, paths) = sim_core::report::plan(&job, &scored, &|| false).unwrap();
    assert_eq!((traces.tree, traces.paths), (tree, paths));
    // A job without a finish has no reference, so the scores on it are missing.
    assert_eq!(ask(&job, Question::Reference, &scored).scores, [None; 20]);
}

#[test]
fn examination_ends_when_it_is_stopped() {
    let job = job(PLANNER);
    let genotype = job.optimiser().ask().genotypes.remove(0);
    let scored = Scored { generation: 0, candidate: 0, score: 0.0, genotype };
    for question in [Question::Fresh, Question::Reference, Question::WithoutReuse, Question::Traces] {
        assert!(examine(&job, &Examination::new(question, &scored), &|| true).is_err());
    }
}
