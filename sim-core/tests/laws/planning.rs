//! Tests of jobs that plan with given gaits: trees end at the goal, plans are paths through their trees, impossible
//! results are refused, and results do not depend on how tasks are distributed.

use serde::de::DeserializeOwned;
use sim_core::evaluate;
use sim_core::model::Place;
use sim_core::plan::Tree;
use sim_core::problem::{Checked, Job};
use sim_core::procedure::plan::{Grown, PlanReport, Task, TaskResult, Tried, stream};
use sim_core::procedure::{self, Bench, Hooks, Step};
use sim_core::report::{PathMode, end_of_plan};
use std::sync::Arc;

/// Hooks that never stop the work.
pub struct Never;

impl Hooks for Never {
    fn stop(&self) -> bool {
        false
    }
}

/// Table of gaits for a quadropod: of four random sets of two gaits, the one with the best coverage.
pub fn gaits() -> String {
    let evolving = Job::from_toml(
        "name = \"a\"\nseed = 4\nrobot = \"quadropod\"\nenvironment = \"empty\"\ngaits = { count = 2, duration = 4.0 }\n\
         fitness = { kind = \"coverage\" }\noptimiser = { kind = \"pso\", particles = 4 }\nfinish = { kind = \"none\" }",
    )
    .unwrap();
    let best = evaluate::evaluate(&evolving, 0, &candidates(&evolving), &|| false).unwrap();
    let best = best.iter().max_by(|a, b| a.score.partial_cmp(&b.score).unwrap()).unwrap().candidate;
    let genotype = &evolving.optimiser().ask().genotypes[best as usize];
    let gaits: Vec<String> = genotype.gaits(2).map(|gait| format!("{gait:?}")).collect();
    format!("joints = {:?}\ngenome = [{}]\n", evolving.robot().joint_names(), gaits.join(", "))
}

/// Job file that plans with these gaits. `planner`: keys of the planner; `more`: keys of the plan.
pub fn text(environment: &str, planner: &str, more: &str) -> String {
    format!(
        "name = \"plan\"\nprocedure = \"plan\"\nseed = 3\nrobot = \"quadropod\"\nenvironment = {environment}\n\
         gaits = {{ count = 2, duration = 4.0 }}\nplanner = {{ {planner} }}\n\
         [plan]\n{more}\n[plan.gaits]\n{}",
        gaits()
    )
}

fn candidates(job: &Job) -> Vec<(u32, sim_core::genotype::Genotype)> {
    (0..).zip(job.optimiser().ask().genotypes).collect()
}

/// A map with a goal near the start.
pub const NEAR: &str = r#"{ name = "near", size = [30, 20], start = { x = -5, y = 0 }, goal = { x = -3, y = 1, radius = 0.7 },
    obstacle = [{ center = [0, 3], size = [2, 1], top = 2 }] }"#;

/// Runs all rounds of a job with `at_once` tasks per batch, and saves and loads the procedure before each round.
/// Returns the results of each round, and the report.
pub fn run<R: DeserializeOwned>(text: &str, at_once: usize) -> (Vec<Vec<Vec<u8>>>, R) {
    let job = Checked::from_toml(text).unwrap();
    let bench = Bench::open(&job.to_toml()).unwrap();
    let mut procedure = procedure::start(&job).unwrap();
    let mut rounds = Vec::new();
    loop {
        procedure = procedure::load(&job, &procedure.save()).unwrap();
        let round = procedure.round();
        let tasks: Vec<(u32, Vec<u8>)> = (0..round.tasks).map(|i| (i, procedure.task(i))).collect();
        let mut results: Vec<Vec<u8>> = Vec::new();
        for some in tasks.chunks(at_once) {
            results.extend(bench.run(round.number, &round.shared, some, &Never).unwrap());
        }
        for (i, result) in results.iter().enumerate() {
            procedure.check(i as u32, result).unwrap();
        }
        let told: Vec<Arc<[u8]>> = results.iter().map(|result| result.as_slice().into()).collect();
        rounds.push(results);
        match procedure.tell(&told).step {
            Step::Next => {}
            Step::Done(artefacts) => return (rounds, serde_json::from_slice(&artefacts[0].content).unwrap()),
            step => panic!("{step:?}"),
        }
    }
}

fn tree(job: &Job, seed: u32) -> (Tree, bool) {
    let streams = [stream(job, seed)];
    let mut trials = [evaluate::Trial::new(job, job.given_gaits().unwrap(), job.reuse().tolerance, streams)];
    evaluate::grow(job, &mut trials, &|| false).unwrap();
    (trials[0].tree().clone(), trials[0].growths[0].at_goal())
}

#[test]
fn plans_do_not_depend_on_batches_or_saving() {
    for engine in ["lockstep", "rapier"] {
        let text = text(NEAR, "iterations = 12", "seeds = 7") + &format!("[physics]\nengine = \"{engine}\"\n");
        let (all, report) = run::<PlanReport>(&text, 7);
        assert_eq!(all, run::<PlanReport>(&text, 2).0, "{engine}");
        assert_eq!(all.iter().map(Vec::len).collect::<Vec<_>>(), [1, 7, 1]);
        assert_eq!((report.plans.len(), report.gaits.len()), (7, 2));
        let ways: Vec<_> = report.paths.iter().map(|path| path.mode).collect();
        assert_eq!(ways, [PathMode::Tree, PathMode::Resimulated, PathMode::Continuous]);
    }
}

#[test]
fn plans_are_paths_of_trees_with_matching_scores() {
    for algorithm in ["flood-fill", "original", "nearest-valid"] {
        let text = text(NEAR, &format!("iterations = 40, algorithm = \"{algorithm}\""), "seeds = 6");
        let job = Job::from_toml(&text).unwrap();
        let (_, report) = run::<PlanReport>(&text, 6);
        let goal = job.environment().goal.unwrap();
        let mut reached = 0;
        for (seed, grown) in report.plans.iter().enumerate() {
            let grown = grown.as_ref().expect("without a budget every tree must grow");
            let (tree, at_goal) = tree(&job, seed as u32);
            let mut at = 0;
            for step in &grown.plan {
                at = (at + 1..tree.nodes.len())
                    .find(|&i| {
                        let place = tree.nodes[i].place;
                        tree.nodes[i].edge == Some((at, step.gait as usize))
                            && [place.x, place.y, place.z, place.yaw] == [step.x, step.y, step.z, step.yaw]
                    })
                    .expect("each step must be an edge of the tree");
            }
            assert_eq!(at, end_of_plan(job.environment(), &tree));
            let to_goal = |p: &Place| p.planar_distance(&Place { x: goal.x, y: goal.y, ..*p });
            let least = tree.nodes.iter().map(|node| to_goal(&node.place)).fold(f64::INFINITY, f64::min);
            assert_eq!(grown.distance, Some(least));
            assert_eq!(grown.score, least, "without a fitness table the score must be the distance to the goal");
            assert_eq!((grown.reached, at_goal), (least <= goal.radius, least <= goal.radius));
            reached += usize::from(grown.reached);
            if at_goal && algorithm != "flood-fill" {
                assert_eq!(at, tree.nodes.len() - 1, "growth must end with the node that reaches the goal");
            }
        }
        assert!(reached > 0, "{algorithm}: the goal is too far for this test");
        let scores: Vec<f64> = report.plans.iter().map(|grown| grown.as_ref().unwrap().score).collect();
        let best = scores.iter().copied().fold(f64::INFINITY, f64::min);
        assert_eq!(scores.iter().position(|s| *s == best), Some(report.best as usize));
        // The first path is that of the tree, so it has no end error.
        assert_eq!(report.paths[0].end_error, 0.0);
    }
}

#[test]
fn whole_trees_grow_on_beyond_the_goal() {
    let stopping = text(NEAR, "iterations = 60, algorithm = \"original\"", "seeds = 3");
    let whole = text(NEAR, "iterations = 60, algorithm = \"original\", stop_at_goal = false", "seeds = 3");
    let (stopping, whole) = (Job::from_toml(&stopping).unwrap(), Job::from_toml(&whole).unwrap());
    assert_ne!(stopping.digest(), whole.digest());
    let ends = |job: &Job| (0..3).map(|seed| tree(job, seed)).collect::<Vec<_>>();
    let mut cut = 0;
    for ((a, at_goal), (b, never)) in ends(&stopping).into_iter().zip(ends(&whole)) {
        assert!(!never && a.nodes[..] == b.nodes[..a.nodes.len()], "both jobs must grow the same tree up to the goal");
        cut += usize::from(at_goal && a.nodes.len() < b.nodes.len());
    }
    assert!(cut > 0);
    let [(first, _), (second, _), _] = &ends(&whole)[..] else { panic!("there must be three trees") };
    assert_ne!(first, second, "each tree must have its own random numbers");
}

#[test]
fn job_without_a_goal_is_scored_by_coverage() {
    let text = text("\"empty\"", "iterations = 10", "seeds = 2");
    let (_, report) = run::<PlanReport>(&text, 2);
    let job = Job::from_toml(&text).unwrap();
    assert_eq!(job.score_label(), ("coverage", "%"));
    for grown in report.plans.iter().flatten() {
        assert_eq!((grown.distance, grown.reached, grown.coverage), (None, false, Some(grown.score)));
        assert!(!grown.plan.is_empty());
    }
}

#[test]
fn impossible_results_of_a_tree_are_refused() {
    let text = text(NEAR, "iterations = 12", "seeds = 2");
    let job = Checked::from_toml(&text).unwrap();
    let bench = Bench::open(&job.to_toml()).unwrap();
    let mut procedure = procedure::start(&job).unwrap();
    let prepared = bench.run(0, &[], &[(0, Vec::new())], &Never).unwrap().remove(0);
    assert_eq!(procedure.tell(&[prepared.into()]).step, Step::Next);
    let round = procedure.round();
    let task = procedure.task(0);
    assert_eq!(Task::decode(&task), Ok(Task::Grow { seed: 0 }));
    let sound = bench.run(1, &round.shared, &[(0, task)], &Never).unwrap().remove(0);
    procedure.check(0, &sound).unwrap();
    let TaskResult::Grown(Tried { grown: Some(grown), counts }) = TaskResult::decode(&sound).unwrap() else {
        panic!("the result must be a tree")
    };
    assert!(!grown.plan.is_empty());
    let with = |change: &dyn Fn(&mut Grown)| {
        let mut grown = grown.clone();
        change(&mut grown);
        TaskResult::Grown(Tried { grown: Some(grown), counts }).encode()
    };
    let many = sim_core::base::score::Counts { nodes: 1000, ..counts };
    let refused: Vec<(Vec<u8>, &str)> = vec![
        (Vec::new(), "it is empty"),
        (with(&|g| g.score = f64::NAN), "score NaN is out of range"),
        (with(&|g| g.score = -1.0), "score -1 is out of range"),
        (with(&|g| g.coverage = Some(100.5)), "its coverage is out of range"),
        (with(&|g| g.distance = None), "not that of its plan's end"),
        (with(&|g| g.distance = g.distance.map(f64::next_up)), "not that of its plan's end"),
        (with(&|g| g.reached = !g.reached), "not that of its plan's end"),
        (with(&|g| g.plan[0].gait = 2), "an unknown gait"),
        (with(&|g| g.plan[0].x = 16.0), "outside the map"),
        (with(&|g| g.plan[0].yaw = f64::INFINITY), "an unknown gait"),
        (with(&|g| g.plan = vec![g.plan[0]; 13]), "13 gaits: at most 12"),
        (TaskResult::Grown(Tried { grown: None, counts: many }).encode(), "its count of nodes, 1000, is impossible"),
    ];
    for (result, reason) in refused {
        let said = procedure.check(0, &result).expect_err(reason).to_string();
        assert!(said.starts_with("the result of tree 0 is refused") && said.contains(reason), "{said}");
    }
    let failed = TaskResult::Grown(Tried { grown: None, counts }).encode();
    procedure.check(0, &failed).unwrap();
    let failed: Arc<[u8]> = failed.into();
    let Step::Failed(reason) = procedure.tell(&[failed.clone(), failed]).step else {
        panic!("the job must fail without a plan")
    };
    assert!(reason.starts_with("all 2 trees failed"), "{reason}");
}

#[test]
fn invalid_planning_jobs_are_refused_by_field() {
    let good = text(NEAR, "iterations = 12", "seeds = 2");
    let job = Checked::from_toml(&good).unwrap();
    let again = Checked::from_toml(&job.to_toml()).unwrap();
    assert_eq!((again.digest(), again.to_toml()), (job.digest(), job.to_toml()));
    let without_procedure = good.replace("procedure = \"plan\"\n", "");
    for (file, said) in [
        (good.replace("seeds = 2", "seeds = 0"), "plan.seeds = 0 is out of range: allowed is 1 to 1000"),
        (
            good.replace("iterations = 12", "iterations = 100000").replace("seeds = 2", "seeds = 11"),
            "1100000 is out of",
        ),
        (good.replace("iterations = 12", "iterations = 12, repeats = 2"), "planner.repeats: a job that plans"),
        (good.replace("count = 2", "count = 3"), "plan.gaits.genome: it has 2 gaits, but gaits.count = 3"),
        (good.replace("\"quadropod\"", "\"lizard\""), "plan.gaits: they belong to a robot with joints "),
        (good.replace("genome = [[", "genome = [[0.0, "), "plan.gaits.genome[0]: it has "),
        (good.replace("duration = 4.0 }", "duration = 4.0, controller = \"sine\" }"), "a gait of controller \"sine\""),
        (
            format!("{good}[optimiser]\nkind = \"pso\"\n"),
            "optimiser: a job with procedure = \"plan\" has no such table",
        ),
        (format!("{good}[finish]\nkind = \"none\"\n"), "finish: a job with procedure = \"plan\" has no such table"),
        (without_procedure, "fitness: a job without `procedure`, which evolves, needs this table"),
        (
            good.replace(NEAR, "\"empty\"").replace("iterations = 12", "stop_at_goal = true"),
            "planner.stop_at_goal: env",
        ),
        (
            good.replace("goal = { x = -3, y = 1", "goal = { x = -30, y = 1"),
            "the goal at (-30, 1) lies outside the map",
        ),
        (good.split("[plan]").next().unwrap().to_owned(), "plan: a job with procedure = \"plan\" needs this table"),
    ] {
        let told = Checked::from_toml(&file).expect_err(said).to_string();
        assert!(told.contains(said), "{said}\n{told}");
    }
    let path = format!("{}gaits = \"runs/a\"\n", good.split("[plan.gaits]").next().unwrap());
    let told = Checked::from_toml(&path).unwrap_err().to_string();
    assert!(told.contains("plan.gaits: \"runs/a\" is a path"), "{told}");
}

#[test]
fn gaits_outside_the_bounds_are_refused_by_index() {
    let good = text(NEAR, "iterations = 12", "seeds = 2");
    let bounded = good.replace("duration = 4.0 }", "duration = 4.0, bounds = { mu = [0.9, 0.90001] } }");
    let told = Checked::from_toml(&bounded).unwrap_err().to_string();
    assert!(told.starts_with("plan.gaits.genome[0][") && told.contains("allowed is 0.9 to 0.90001"), "{told}");
}

#[test]
fn search_trees_stop_at_goal_only_if_set() {
    let job = |planner: &str| {
        Job::from_toml(&format!(
            "name = \"a\"\nrobot = \"quadropod\"\nenvironment = \"empty-goal\"\ngaits = {{ count = 2 }}\n\
             fitness = {{ kind = \"path-length\" }}\noptimiser = {{ kind = \"pso\" }}\n{planner}"
        ))
        .unwrap()
    };
    let (silent, no, yes) =
        (job(""), job("planner = { stop_at_goal = false }"), job("planner = { stop_at_goal = true }"));
    assert_eq!((silent.planner().stop_at, no.planner().stop_at), (None, None));
    assert_eq!(
        (silent.digest(), silent.to_toml()),
        (no.digest(), no.to_toml()),
        "neutral settings must not be written"
    );
    assert_eq!(yes.planner().stop_at, Some((3.0, 0.0, 1.0)));
    assert_ne!(yes.digest(), no.digest());
}
