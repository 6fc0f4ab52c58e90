//! Tests of transition reuse: which transitions are simulated, how often, and the start of each node.

use sim_core::base::math::{Pose, Vector, about_z};
use sim_core::base::random::{Purpose, Stream};
use sim_core::evaluate::{Trial, evaluate, grow, search_streams};
use sim_core::genotype::Genotype;
use sim_core::model::Place;
use sim_core::physics::{Effort, Outcome, Rollout, Span, Trace};
use sim_core::plan::{Arrival, Ask, PlannerSettings, Reuse, StartId, TransitionKey, Transitions};
use sim_core::problem::Job;
use std::collections::BTreeSet;

fn job(planner: &str) -> Job {
    Job::from_toml(&format!(
        r#"
        name = "reused"
        seed = 5
        robot = "quadropod"
        environment = "empty"
        gaits = {{ count = 3, duration = 4.0 }}
        fitness = {{ kind = "coverage", cell = 0.5 }}
        optimiser = {{ kind = "pso", particles = 4, generations = 2 }}
        planner = {{ {planner} }}
        "#
    ))
    .unwrap()
}

fn trial(job: &Job, candidate: u32, tolerance: f64, variants: u32) -> Trial {
    let genotype = &job.optimiser().ask().genotypes[candidate as usize];
    let reuse = Reuse { tolerance, variants };
    let mut trials = [Trial::with_reuse(job, genotype, reuse, search_streams(job, 0, candidate))];
    grow(job, &mut trials, &|| false).unwrap();
    let [trial] = trials;
    trial
}

#[test]
fn unlimited_variants_give_the_tree_of_tolerance_zero() {
    let job = job("iterations = 15");
    for candidate in 0..3 {
        let plain = trial(&job, candidate, 0.0, 1);
        assert!(plain.tree().nodes.len() > 3);
        for tolerance in [0.05, 1.0] {
            let all = trial(&job, candidate, tolerance, u32::MAX);
            assert_eq!(all.tree(), plain.tree(), "candidate {candidate} at tolerance {tolerance}");
            assert!(all.counts().rollouts <= plain.counts().rollouts);
        }
        assert_ne!(
            trial(&job, candidate, 0.05, 1).tree(),
            plain.tree(),
            "reuse must change the tree, or this test shows nothing"
        );
    }
}

#[test]
fn variants_belong_to_their_local_state_within_limit() {
    let job = job("iterations = 60");
    let mut several = 0;
    for (candidate, variants) in [(0, 1), (0, 3), (1, 3), (2, 8)] {
        let trial = trial(&job, candidate, 0.05, variants);
        let growth = &trial.growths[0];
        let mut started = BTreeSet::new();
        for node in 1..growth.tree().nodes.len() {
            let reached = trial.table.get(growth.transition_to(node).unwrap()).unwrap();
            let start = trial.table.start_of_node(reached, node);
            let representative = reached.end_start.unwrap();
            // A node that became a member starts exactly at its rollout's end. Other nodes start within the tolerance
            // of their representative.
            if let Some(member) = reached.end_member {
                assert_eq!(start, member);
                assert_eq!(trial.table.start(member).joints, reached.rollout.end.joints);
            }
            let apart = |joints: &[f32]| {
                let all = joints.iter().zip(&trial.table.start(representative).joints);
                all.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
            };
            assert!(apart(&reached.rollout.end.joints) <= 0.05);
            assert!(apart(&trial.table.start(start).joints) <= 0.05);
            started.insert((representative, start));
        }
        let representatives: BTreeSet<StartId> = started.iter().map(|(r, _)| *r).collect();
        for r in &representatives {
            let members = started.iter().filter(|(of, _)| of == r).count();
            assert!(members <= variants as usize);
            several += usize::from(members > 1);
        }
        let states = representatives.len() as u64 + 1;
        assert!(trial.counts().rollouts <= states * u64::from(variants) * 3);
    }
    assert!(several > 0, "no local state had variants");
}

#[test]
fn variants_do_not_depend_on_the_batch() {
    let job = job("iterations = 30, variants = 4, repeats = 2");
    let candidates: Vec<(u32, Genotype)> = (0..).zip(job.optimiser().ask().genotypes).collect();
    let together = evaluate(&job, 0, &candidates, &|| false).unwrap();
    for (candidate, expected) in candidates.iter().zip(&together) {
        assert_eq!(&evaluate(&job, 0, std::slice::from_ref(candidate), &|| false).unwrap()[0], expected);
    }
}

#[test]
fn node_is_expanded_and_simulated_only_once() {
    for algorithm in ["flood-fill", "original", "nearest-valid"] {
        let own = job(&format!("algorithm = \"{algorithm}\"")).planner();
        let settings = PlannerSettings { iterations: 2000, map: [12.0, 12.0], ..own };
        let mut rrt = settings.start(Place::ORIGIN, Stream::new(1, Purpose::Planner, 0, 0, 0));
        let mut asked = BTreeSet::new();
        while let Ask::Expand(node) = rrt.ask(&|_, _| 0.0) {
            assert!(asked.insert(node), "{algorithm:?} expands node {node} twice");
            let from = rrt.tree().nodes[node].place;
            let step = |x: f64, y: f64| {
                let to = from.then(&Place { x, y, ..Place::ORIGIN });
                if to.x.abs() <= 6.0 && to.y.abs() <= 6.0 { Arrival::Free(to) } else { Arrival::Blocked(to) }
            };
            rrt.tell(vec![step(1.0, 0.0), step(-1.0, 0.0), step(0.0, 1.0), step(0.0, -1.0)]);
        }
        assert!(asked.len() > 50 && asked.len() <= rrt.tree().nodes.len());
        let edges: BTreeSet<_> = rrt.tree().nodes.iter().filter_map(|n| n.edge).collect();
        assert_eq!(edges.len() + 1, rrt.tree().nodes.len(), "{algorithm:?} added an edge twice");
    }
    for (algorithm, tolerance) in [("flood-fill", 0.0), ("original", 0.0), ("flood-fill", 0.05)] {
        let job = job(&format!("iterations = 25, algorithm = \"{algorithm}\""));
        let trial = trial(&job, 1, tolerance, 1);
        let simulated = (0..trial.table.starts()).flat_map(|s| (0..3).map(move |g| (StartId(s), g)));
        let simulated = simulated.filter(|&(start, gait)| {
            let key = TransitionKey { start, gait };
            trial.table.get(key).is_some()
        });
        assert_eq!(trial.counts().rollouts, simulated.count() as u64, "a transition was simulated twice");
        assert!(trial.counts().edges <= 25 * 3);
    }
}

/// Path of a robot that repeats a step of 1 mu and a turn. The angle of the turn depends chaotically on its first
/// joint.
fn staggered(reuse: Reuse) -> Vec<Place> {
    let job = job("");
    let mut table = Transitions::new(1, reuse, job.start());
    let (mut start, mut way) = (StartId(0), vec![Place::ORIGIN]);
    while way.len() < 5000 {
        let key = TransitionKey { start, gait: 0 };
        if table.get(key).is_none() {
            let start = table.start(start).clone();
            let chaos = f64::from(start.joints[0]) * 100.0;
            let chaos = if (0.01..0.99).contains(&chaos) { chaos } else { 0.37 };
            let mut end = start.clone();
            end.joints[0] = (4.0 * chaos * (1.0 - chaos) / 100.0) as f32;
            let step = Vector::new(1.0, 0.0, start.pivot.translation.z);
            end.pivot = Pose::from_parts(step, about_z(1.6 * (chaos - 0.5) + 0.4) * start.pivot.rotation);
            let mut trace = Trace::new(start.joints.len());
            trace.push(0.0, &start);
            trace.push(1.0, &end);
            let (low, high) = job.robot().bounds(&start);
            let swept = vec![Span { first: 0, last: 1, low, high: high + Vector::X }];
            let outcome = Outcome::Completed;
            table.insert(
                key,
                Rollout { end, end_speed: 0.0, trace, swept, outcome, simulated_ms: 1000, effort: Effort::default() },
            );
        }
        let transition = table.get(key).unwrap();
        start = table.start_of_node(transition, way.len());
        way.push(way[way.len() - 1].then(&transition.end));
    }
    way
}

#[test]
fn variants_break_the_polygon_of_a_repeated_transition() {
    let farthest = |tolerance, variants| {
        let way = staggered(Reuse { tolerance, variants });
        way.iter().map(|p| p.planar_distance(&Place::ORIGIN)).fold(0.0, f64::max)
    };
    let (plain, frozen, varied) = (farthest(0.0, 1), farthest(0.05, 1), farthest(0.05, 16));
    // The first transition turns by 1.6 (0.37 − 0.5) + 0.4 = 0.192 rad. Its repetition gives a polygon in a circle of
    // diameter 1 / sin(0.096) mu.
    assert!(frozen <= 1.0 / libm::sin(0.096) + 1e-3, "{frozen}");
    assert!(plain > 2.0 * frozen && varied > 2.0 * frozen, "plain {plain}, 1 variant {frozen}, 16 variants {varied}");
}
