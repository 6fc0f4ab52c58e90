//! Tests of RRT-MP's trees and of evaluations.

use sim_core::base::random::{Purpose, Stream};
use sim_core::evaluate::{Trial, evaluate, grow, search_streams};
use sim_core::genotype::Genotype;
use sim_core::model::Place;
use sim_core::physics::{Change, Event, Request};
use sim_core::plan::{Arrival, Ask, Planner, PlannerSettings, Posture, Root};
use sim_core::problem::{Checked, Job};

/// Small job with short gaits. `planner`: keys of the planner.
fn job(environment: &str, planner: &str) -> Job {
    Job::from_toml(&text(environment, planner)).unwrap()
}

fn text(environment: &str, planner: &str) -> String {
    format!(
        r#"
        name = "small"
        seed = 5
        robot = "quadropod"
        environment = "{environment}"
        gaits = {{ count = 3, duration = 4.0 }}
        fitness = {{ kind = "coverage", cell = 0.5 }}
        optimiser = {{ kind = "pso", particles = 4, generations = 2 }}
        [planner]
        {planner}
        "#
    )
}

fn trial(job: &Job, candidate: u32) -> Trial {
    let genotype = &job.optimiser().ask().genotypes[candidate as usize];
    let tolerance = job.spec().planner.reuse_tolerance;
    let mut trials = [Trial::new(job, genotype, tolerance, search_streams(job, 0, candidate))];
    grow(job, &mut trials, &|| false).unwrap();
    let [trial] = trials;
    trial
}

/// Asserts that every edge of the tree can be reproduced: simulates it again from its parent's representative, and
/// places the result at the parent.
fn assert_edges_are_reproduced(job: &Job, trial: &Trial) {
    let growth = &trial.growths[0];
    let nodes = &growth.tree().nodes;
    assert!(nodes.len() > 3, "a tree of {} nodes is too small for this test", nodes.len());
    for (i, node) in nodes.iter().enumerate().skip(1) {
        let (parent, gait) = node.edge.unwrap();
        let key = growth.transition_to(i).unwrap();
        assert_eq!(key.gait, gait);
        let start = trial.table.start(key.start);
        let terrain = if trial.table.is_in_place(key.start) { job.environment().terrain.as_slice() } else { &[] };
        let request = Request { start, motion: &trial.motions[gait] };
        let again = job.engine().run(job.robot(), job.physics(), terrain, &[request]).swap_remove(0);
        let transition = trial.table.get(key).unwrap();
        assert_eq!(again, transition.rollout, "edge to node {i}");
        let frame = growth.frame(&trial.table, parent, key);
        assert_eq!(frame.then(&transition.end), node.place, "edge to node {i}");
    }
}

/// A gait that the engine refuses during the rollout adds no node, and each of its rollouts is counted.
#[test]
fn refused_rollouts_are_rejected_edges() {
    let job = job("empty", "iterations = 20");
    let streams = search_streams(&job, 0, 0);
    let mut trials = [Trial::new(&job, &job.optimiser().ask().genotypes[0], 0.0, streams)];
    let change = Change::Replace { module: 0 };
    trials[0].motions[1] = trials[0].motions[1].clone().with_events(vec![Event { tick: 100, change }]);
    grow(&job, &mut trials, &|| false).unwrap();
    let [trial] = trials;
    let nodes = &trial.tree().nodes;
    assert!(nodes.len() > 3 && nodes.iter().all(|node| node.edge.is_none_or(|(_, gait)| gait != 1)));
    let counts = trial.counts();
    assert!(counts.rejected >= counts.edges / 3, "{counts:?}");
    assert!(counts.unstable >= counts.rollouts / 3, "{counts:?}");
}

#[test]
fn edges_start_at_their_parents_representative() {
    let job = job("empty", "iterations = 40");
    let trial = trial(&job, 0);
    assert_edges_are_reproduced(&job, &trial);
    assert!(trial.counts().rollouts < trial.counts().edges, "nothing was reused");
}

#[test]
fn edges_start_exactly_at_parents_at_tolerance_zero() {
    let job = job("empty", "iterations = 15\nreuse_tolerance = 0.0");
    let trial = trial(&job, 0);
    assert_edges_are_reproduced(&job, &trial);
    assert_eq!(trial.counts().rollouts, trial.counts().edges, "every expansion must be simulated");
    let growth = &trial.growths[0];
    for i in 1..growth.tree().nodes.len() {
        let (parent, _) = growth.tree().nodes[i].edge.unwrap();
        if let Some(before) = growth.transition_to(parent) {
            let reached = trial.table.get(before).unwrap();
            let key = growth.transition_to(i).unwrap();
            assert_eq!(Some(key.start), reached.end_start);
            assert_eq!(trial.table.start(key.start).joints, reached.rollout.end.joints);
        }
    }
}

#[test]
fn edges_on_stairs_are_reproduced_in_place() {
    let job = Job::from_toml(
        r#"
        name = "small-stairs"
        robot = "quadropod"
        environment = { name = "near-stairs", size = [20, 10], start = { x = -5, y = 0 }, goal = { x = 4, y = 0 }, terrain = [
            { center = [0, 0], size = [4, 10], top = 0.3 } ] }
        gaits = { count = 3, duration = 6.0 }
        planner = { iterations = 25 }
        fitness = { kind = "distance" }
        optimiser = { kind = "pso", particles = 6, generations = 2 }
        "#,
    )
    .unwrap();
    let mut placed = 0;
    for candidate in 0..4 {
        let trial = trial(&job, candidate);
        if trial.growths[0].tree().nodes.len() > 3 {
            assert_edges_are_reproduced(&job, &trial);
        }
        placed += (0..trial.table.starts()).filter(|&s| trial.table.is_in_place(sim_core::plan::StartId(s))).count();
    }
    assert!(placed > 0, "no rollout came near the stairs");
}

#[test]
fn added_nodes_are_nearest_to_their_parent() {
    for algorithm in ["flood-fill", "original", "nearest-valid"] {
        let job = job("empty", &format!("iterations = 60\nalgorithm = \"{algorithm}\""));
        let metric = job.planner().metric;
        let trial = trial(&job, 1);
        let nodes = &trial.tree().nodes;
        assert!(nodes.len() <= 1 + 3 * 60);
        if algorithm != "flood-fill" {
            assert!(nodes.len() <= 1 + 60, "{algorithm} adds one node an iteration");
            continue;
        }
        for (i, node) in nodes.iter().enumerate().skip(1) {
            let (parent, _) = node.edge.unwrap();
            let to_parent = metric.squared(&node.place, &nodes[parent].place);
            let before = nodes[..i].iter().enumerate().filter(|(j, _)| *j != parent);
            for (j, other) in before {
                assert!(metric.squared(&node.place, &other.place) > to_parent, "node {i} lies nearer to {j}");
            }
        }
    }
}

#[test]
fn trees_stay_on_the_map_outside_obstacles() {
    let job = Job::from_toml(
        r#"
        name = "tight"
        seed = 2
        robot = "lizard"
        environment = { name = "tight", size = [9, 7], start = { x = -2, y = 0 }, obstacle = [
            { center = [1.5, 0], size = [1, 1], top = 2, yaw = 0.6 } ] }
        gaits = { count = 3, duration = 6.0 }
        planner = { iterations = 40 }
        fitness = { kind = "coverage", cell = 0.5 }
        optimiser = { kind = "pso", particles = 12, generations = 2 }
        "#,
    )
    .unwrap();
    let mut rejected = 0;
    for candidate in 0..12 {
        let trial = trial(&job, candidate);
        rejected += trial.counts().rejected;
        let growth = &trial.growths[0];
        for i in 1..growth.tree().nodes.len() {
            let (parent, _) = growth.tree().nodes[i].edge.unwrap();
            let key = growth.transition_to(i).unwrap();
            let frame = growth.frame(&trial.table, parent, key);
            let rollout = &trial.table.get(key).unwrap().rollout;
            for sample in 0..rollout.trace.len() {
                let state = rollout.trace.state(sample);
                let p = state.pivot.translation;
                let (x, y) = frame.point(p.x.into(), p.y.into());
                assert!(x.abs() <= 4.5 && y.abs() <= 3.5, "({x}, {y}) is off the map");
                assert_clear(&job, &frame, &state);
            }
        }
    }
    assert!(rejected > 0, "no motion was rejected: the map is too wide for this test");
}

/// Asserts that no corner of the robot's boxes lies inside the obstacle. This check does not use swept boxes.
fn assert_clear(job: &Job, frame: &Place, state: &sim_core::model::State) {
    let block = &job.environment().obstacles[0];
    for (pose, body) in job.robot().body_poses(state).iter().zip(&job.robot().bodies) {
        for part in &body.boxes {
            for corner in 0..8 {
                let sign = |bit: i32| if corner >> bit & 1 == 0 { -1.0 } else { 1.0 };
                let local = part.half * sim_core::base::math::Vector::new(sign(0), sign(1), sign(2));
                let p = pose.transform_point(part.pose.transform_point(local));
                let (x, y) = frame.point(p.x.into(), p.y.into());
                assert!(!block.covers(x, y, 0.0) || f64::from(p.z) > block.top, "({x}, {y}, {}) is inside", p.z);
            }
        }
    }
}

#[test]
fn tree_is_reproducible_and_depends_on_the_seed() {
    let job = job("empty", "iterations = 30");
    assert_eq!(trial(&job, 2).tree(), trial(&job, 2).tree());
    let other = Job::from_toml(&job.to_toml().replace("seed = 5", "seed = 6")).unwrap();
    let genotype = &job.optimiser().ask().genotypes[2];
    let mut trials = [Trial::new(&other, genotype, 0.05, search_streams(&other, 0, 2))];
    grow(&other, &mut trials, &|| false).unwrap();
    assert_ne!(trials[0].tree(), trial(&job, 2).tree());
}

#[test]
fn score_does_not_depend_on_batch_or_order() {
    let job = job("column", "iterations = 20\nrepeats = 2");
    let candidates: Vec<(u32, Genotype)> =
        job.optimiser().ask().genotypes.into_iter().zip(0..).map(|(g, i)| (i, g)).collect();
    let together = evaluate(&job, 0, &candidates, &|| false).unwrap();
    for (candidate, expected) in candidates.iter().zip(&together) {
        let alone = evaluate(&job, 0, std::slice::from_ref(candidate), &|| false).unwrap();
        assert_eq!(&alone[0], expected);
    }
    let reversed: Vec<_> = candidates.iter().rev().cloned().collect();
    let mut back = evaluate(&job, 0, &reversed, &|| false).unwrap();
    back.reverse();
    assert_eq!(back, together);
}

#[test]
fn evaluation_stops_when_asked() {
    let job = job("empty", "iterations = 40");
    let candidates = [(0, job.optimiser().ask().genotypes[0].clone())];
    assert!(evaluate(&job, 0, &candidates, &|| true).is_err());
}

/// Grows a tree of a robot that steps exactly 1 mu along x or y: the planner alone, without physics.
fn stepper(stop_at: Option<(f64, f64, f64)>) -> Box<dyn Planner> {
    let own = job("empty", "iterations = 1").planner();
    let settings = PlannerSettings { map: [20.0, 20.0], iterations: 400, stop_at, ..own };
    let mut rrt = settings.start(Place::ORIGIN, Stream::new(1, Purpose::Planner, 0, 0, 0));
    while let Ask::Expand(node) = rrt.ask(&|_, _| 0.0) {
        let from = rrt.tree().nodes[node].place;
        let step = |x: f64, y: f64| Arrival::Free(from.then(&Place { x, y, ..Place::ORIGIN }));
        rrt.tell(vec![step(1.0, 0.0), step(-1.0, 0.0), step(0.0, 1.0), step(0.0, -1.0)]);
    }
    rrt
}

#[test]
fn tree_ends_at_the_goal_only_if_set() {
    let to_goal = |p: &Place| p.planar_distance(&Place { x: 5.0, y: 2.0, ..*p });
    let whole = stepper(None);
    let stopped = stepper(Some((5.0, 2.0, 0.25)));
    assert!(stopped.at_goal() && !whole.at_goal());
    let end = stopped.tree().least(to_goal);
    assert!(to_goal(&stopped.tree().nodes[end].place) <= 0.25);
    // Both trees are the same up to the goal. The expansion that reaches the goal is completed, then growth ends.
    assert!(stopped.tree().nodes.len() < whole.tree().nodes.len());
    assert_eq!(stopped.tree().nodes[..], whole.tree().nodes[..stopped.tree().nodes.len()]);
    assert_eq!(stopped.tree().nodes.last().unwrap().edge.unwrap().0, stopped.tree().nodes[end].edge.unwrap().0);
    let unreachable = stepper(Some((5.5, 2.5, 0.1)));
    assert!(!unreachable.at_goal());
    assert_eq!(unreachable.tree(), whole.tree());
}

/// Two gaits lead to the same place. They end with the only joint at 0 rad and at 1 rad; at the root it is at 1 rad.
#[test]
fn postures_count_by_their_weight_in_the_metric() {
    let nodes = |joints: f64| {
        let own = job("empty", &format!("iterations = 1\nmetric = {{ joints = {joints:?} }}")).planner();
        let posture = |angle: f64| Posture { tilt: [0.0; 2], joints: vec![angle] };
        let root = Root { place: Place::ORIGIN, posture: posture(1.0), limits: vec![[-1.5, 1.5]] };
        let mut rrt = own.start(root, Stream::new(1, Purpose::Planner, 0, 0, 0));
        assert_eq!(rrt.ask(&|_, _| 0.0), Ask::Expand(0));
        rrt.postures(vec![posture(0.0), posture(1.0)]);
        rrt.tell(vec![Arrival::Free(Place { x: 1.0, ..Place::ORIGIN }); 2]);
        rrt.tree().nodes.len()
    };
    // The second node is 1 mu from its parent. Its distance to the first node is the weight.
    assert_eq!([0.0, 0.5, 0.9, 1.1, 2.0].map(nodes), [2, 2, 2, 3, 3]);
}

#[test]
fn posture_weights_change_tree_and_digest() {
    let grown = |planner: &str| {
        let job = job("empty", planner);
        let genotype = job.optimiser().ask().genotypes[0].clone();
        let mut trials = [Trial::new(&job, &genotype, job.reuse().tolerance, search_streams(&job, 0, 0))];
        grow(&job, &mut trials, &|| false).unwrap();
        (trials[0].tree().clone(), job.digest())
    };
    let (plain, digest) = grown("iterations = 30");
    for weights in ["roll = 2.0", "pitch = 2.0", "joints = 2.0", "z = 5.0, joints = 0.5"] {
        let planner = format!("iterations = 30\nmetric = {{ {weights} }}");
        let (tree, other) = grown(&planner);
        assert_eq!((&tree, other), (&grown(&planner).0, grown(&planner).1));
        assert_ne!(other, digest, "{weights}");
        assert_ne!(tree, plain, "{weights}");
    }
    let refused = Checked::from_toml(&text("empty", "metric = { joints = -1.0 }")).unwrap_err().to_string();
    assert!(refused.contains("planner.metric.joints = -1 is out of range: allowed is 0 to 1000 mu/rad"), "{refused}");
}

#[test]
fn original_planner_chooses_before_it_checks_obstacles() {
    let nodes = |algorithm: &str, arrivals: [Arrival; 3]| {
        let own = job("empty", &format!("iterations = 1\nalgorithm = \"{algorithm}\"")).planner();
        let mut rrt = own.start(Place::ORIGIN, Stream::new(1, Purpose::Planner, 0, 0, 0));
        assert_eq!(rrt.ask(&|_, _| 0.0), Ask::Expand(0));
        rrt.tell(arrivals.to_vec());
        assert_eq!(rrt.ask(&|_, _| 0.0), Ask::Done);
        rrt.tree().nodes.iter().filter_map(|node| Some(node.edge?.1)).collect::<Vec<_>>()
    };
    let at = |x: f64| Place { x, ..Place::ORIGIN };
    let free = [Arrival::Free(at(-1.0)), Arrival::Lost, Arrival::Free(at(1.0))];
    let [chosen] = nodes("original", free)[..] else { panic!("one node must be added") };
    assert_eq!(nodes("nearest-valid", free), [chosen], "both must add the same node if all places are free");
    let mut blocked = free;
    blocked[chosen] = Arrival::Blocked(at(chosen as f64 - 1.0));
    assert!(nodes("original", blocked).is_empty(), "its choice is blocked, so no node must be added");
    assert_eq!(nodes("nearest-valid", blocked), [2 - chosen], "the other place must be added");
}
