//! Tests of the budget of an evaluation: every evaluation ends, with the same bits on every machine.

use sim_core::base::limits::MAX_EVALUATION_STEPS;
use sim_core::evaluate::evaluate;
use sim_core::genotype::Genotype;
use sim_core::problem::Job;

fn text(planner: &str, more: &str) -> String {
    format!(
        "name = \"budget\"\nrobot = \"quadropod\"\nenvironment = \"empty\"\n[gaits]\ncount = 2\nduration = 1.0\n\
         [planner]\n{planner}\n[fitness]\nkind = \"coverage\"\n[optimiser]\nkind = \"pso\"\nparticles = 6\n\
         [physics]\nengine = \"lockstep\"\n[finish]\nkind = \"none\"\n{more}"
    )
}

fn job(planner: &str) -> Job {
    Job::from_toml(&text(planner, "")).unwrap()
}

fn refusal(planner: &str) -> String {
    Job::from_toml(&text(planner, "")).unwrap_err().to_string()
}

fn candidates(job: &Job) -> Vec<(u32, Genotype)> {
    (0..).zip(job.optimiser().ask().genotypes).collect()
}

#[test]
fn evaluation_over_budget_fails_without_affecting_others() {
    let free = job("iterations = 20");
    let candidates = candidates(&free);
    let all = evaluate(&free, 0, &candidates, &|| false).unwrap();
    let mut needs: Vec<u64> = all.iter().map(|e| e.counts.rollouts).collect();
    needs.sort_unstable();
    // At least three candidates keep within this budget.
    let budget = needs[2];
    assert!(budget < needs[5], "candidates must need different numbers of rollouts: {needs:?}");

    let tight = job(&format!("iterations = 20\nmax_rollouts = {budget}"));
    let together = evaluate(&tight, 0, &candidates, &|| false).unwrap();
    for (candidate, (free, tight_one)) in candidates.iter().zip(all.iter().zip(&together)) {
        if free.counts.rollouts <= budget {
            assert_eq!(free, tight_one);
        } else {
            assert_eq!(tight_one.score, None);
            assert!((1..=budget).contains(&tight_one.counts.rollouts), "{:?}", tight_one.counts);
        }
        let alone = evaluate(&tight, 0, std::slice::from_ref(candidate), &|| false).unwrap();
        assert_eq!(alone, std::slice::from_ref(tight_one), "other candidates of a batch must change nothing");
    }
    assert_ne!(free.digest(), tight.digest());
}

#[test]
fn default_budget_covers_every_evaluation() {
    // Without reuse every transition that a tree can ask for is simulated.
    let job = job("iterations = 12\nreuse_tolerance = 0.0\nrepeats = 2");
    assert_eq!(job.most_rollouts(), 12 * 2 * 2);
    assert_eq!(job.rollout_budget(2, true), 48);
    for evaluation in evaluate(&job, 0, &candidates(&job), &|| false).unwrap() {
        assert!(evaluation.score.is_some() && evaluation.counts.rollouts <= 48, "{:?}", evaluation.counts);
    }
}

#[test]
fn budget_grows_with_the_number_of_trees() {
    let job = job("iterations = 100\nrepeats = 4\nmax_rollouts = 10");
    assert_eq!([1, 4, 20].map(|trees| job.rollout_budget(trees, true)), [3, 10, 50]);
    assert_eq!(
        job.rollout_budget(4, false),
        100 * 2 * 4,
        "max_rollouts must not limit trees without the search's reuse"
    );
}

#[test]
fn overlong_evaluations_are_refused_with_the_limit() {
    let endless = "iterations = 100000\nrepeats = 1000";
    let message = refusal(endless);
    assert!(
        message.contains(&MAX_EVALUATION_STEPS.to_string()) && message.contains("planner.max_rollouts"),
        "{message}"
    );
    let accepted = job(&format!("{endless}\nmax_rollouts = 5000"));
    assert!(5000 * accepted.steps_per_rollout() <= MAX_EVALUATION_STEPS);

    let message = refusal("max_rollouts = 1");
    assert!(message.contains("planner.max_rollouts = 1 is out of range"), "{message}");
    let message = refusal(&format!("max_rollouts = {MAX_EVALUATION_STEPS}"));
    assert!(message.contains("10000000000 steps are allowed"), "{message}");
    let fine = text("", "").replace("\"lockstep\"", "\"lockstep\"\nsteps_per_second = 10000\nsubsteps = 1000");
    let message = Job::from_toml(&fine).unwrap_err().to_string();
    assert!(message.contains("1000000") && message.contains("out of range"), "{message}");
}
