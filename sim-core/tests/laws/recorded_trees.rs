//! Recorded digests of trees: a faster planner must not change a bit of them.

use sim_core::base::digest::Digest;
use sim_core::evaluate::{Trial, grow, search_streams};
use sim_core::genotype::Genotype;
use sim_core::problem::Job;

/// Digest of the trees, scores and counts of two candidates.
fn recorded(robot: &str, environment: &str, planner: &str, duration: f64) -> String {
    let job = Job::from_toml(&format!(
        r#"
        name = "recorded"
        seed = 11
        robot = "{robot}"
        environment = {environment}
        gaits = {{ count = 3, duration = {duration:?} }}
        fitness = {{ kind = "coverage", cell = 0.5 }}
        optimiser = {{ kind = "pso", particles = 4, generations = 2 }}
        planner = {{ {planner} }}
        physics = {{ engine = "rapier" }}
        "#
    ))
    .unwrap();
    let tolerance = job.spec().planner.reuse_tolerance;
    let of =
        |(index, genotype): (u32, Genotype)| Trial::new(&job, &genotype, tolerance, search_streams(&job, 0, index));
    let mut trials: Vec<Trial> = (0..2).zip(job.optimiser().ask().genotypes).map(of).collect();
    grow(&job, &mut trials, &|| false).unwrap();
    let bits = |trial: &Trial| {
        let trees = trial.growths.iter().map(|growth| {
            let nodes = growth.tree().nodes.iter();
            let node = |n: &sim_core::plan::Node| {
                ([n.place.x, n.place.y, n.place.z, n.place.yaw].map(f64::to_bits), n.edge.unwrap_or((0, 0)))
            };
            nodes.map(node).collect::<Vec<_>>()
        });
        (trees.collect::<Vec<_>>(), trial.score(&job), trial.counts())
    };
    Digest::of("recorded trees", &trials.iter().map(bits).collect::<Vec<_>>()).short()
}

const TIGHT: &str = r#"{ name = "tight", size = [9, 7], start = { x = -2, y = 0 }, obstacle = [
    { center = [1.5, 0], size = [1, 1], top = 2, yaw = 0.6 }, { center = [-3, 2], size = [1, 0.5], top = 1 } ] }"#;
const STAIRS: &str = r#"{ name = "near-stairs", size = [20, 10], start = { x = -5, y = 0 }, terrain = [
    { center = [0, 0], size = [4, 10], top = 0.3 } ] }"#;

#[test]
fn trees_have_their_recorded_digests() {
    for (robot, environment, planner, duration, expected) in [
        ("quadropod", "\"empty\"", "iterations = 150", 4.0, "4600fe153bc5"),
        ("quadropod", "\"empty\"", "iterations = 100, algorithm = \"original\", repeats = 3", 4.0, "bb89fbefe506"),
        ("lizard", TIGHT, "iterations = 150, repeats = 2", 6.0, "db400ce45907"),
        ("lizard", TIGHT, "iterations = 20, reuse_tolerance = 0.0", 4.0, "9997e2367a21"),
        ("quadropod", STAIRS, "iterations = 25", 6.0, "ca03c1eb6471"),
        ("quadropod", "\"column\"", "iterations = 2000, yaw_weight = 0.0", 4.0, "945aa4aaf62a"),
    ] {
        assert_eq!(recorded(robot, environment, planner, duration), expected, "{robot} on {environment}, {planner}");
    }
}
