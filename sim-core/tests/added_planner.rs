//! A planner of another program: a job file can use it once it is in the registry.

use sim_core::base::random::Stream;
use sim_core::base::registry::{Component, Registered};
use sim_core::evaluate::{Trial, grow, search_streams};
use sim_core::model::Place;
use sim_core::plan::{Ask, Node, Planner, PlannerKind, PlannerSettings, Tree};
use sim_core::problem::{Checked, Job};

/// Expands nodes in the order in which they were added, and adds wherever a gait arrives.
struct BreadthFirst;

impl Component for BreadthFirst {
    fn name(&self) -> &'static str {
        "breadth-first"
    }
}

impl PlannerKind for BreadthFirst {
    fn start(&self, settings: PlannerSettings, root: Place, _: Stream) -> Box<dyn Planner> {
        Box::new(Growing { tree: Tree::new(root), expanded: 0, most: settings.iterations as usize })
    }
}

#[derive(Debug)]
struct Growing {
    tree: Tree,
    expanded: usize,
    most: usize,
}

impl Planner for Growing {
    fn ask(&mut self, _: &dyn Fn(f64, f64) -> f64) -> Ask {
        let last = self.expanded == self.most.min(self.tree.nodes.len());
        if last { Ask::Done } else { Ask::Expand(self.expanded) }
    }

    fn tell(&mut self, arrivals: Vec<Option<Place>>) {
        for (gait, place) in arrivals.into_iter().enumerate() {
            self.tree.nodes.extend(place.map(|place| Node { place, edge: Some((self.expanded, gait)) }));
        }
        self.expanded += 1;
    }

    fn tree(&self) -> &Tree {
        &self.tree
    }

    fn at_goal(&self) -> bool {
        false
    }
}

fn job(algorithm: &str) -> String {
    format!(
        r#"
        name = "added"
        robot = "quadropod"
        environment = "empty"
        gaits = {{ count = 2, duration = 1.0 }}
        fitness = {{ kind = "coverage" }}
        optimiser = {{ kind = "pso", particles = 2, generations = 1 }}
        planner = {{ iterations = 3, algorithm = "{algorithm}" }}
        "#
    )
}

#[test]
fn added_planner_is_used_by_a_job_file() {
    let refused = Checked::from_toml(&job("breadth-first")).unwrap_err().to_string();
    assert!(refused.contains("unknown variant `breadth-first`, expected `flood-fill` or `original`"), "{refused}");

    <dyn PlannerKind>::registry().add(&BreadthFirst).unwrap();
    let checked = Checked::from_toml(&job("breadth-first")).unwrap();
    assert_eq!(Checked::from_toml(&checked.to_toml()).unwrap().digest(), checked.digest());
    assert_ne!(Checked::from_toml(&job("flood-fill")).unwrap().digest(), checked.digest());

    let job = Job::from_toml(&job("breadth-first")).unwrap();
    let genotype = &job.optimiser().ask().genotypes[0];
    let mut trials = [Trial::new(&job, genotype, job.reuse().tolerance, search_streams(&job, 0, 0))];
    grow(&job, &mut trials, &|| false).unwrap();
    // Without obstacles no arrival is rejected: three expansions of two gaits.
    let edges: Vec<_> = trials[0].tree().nodes.iter().map(|node| node.edge).collect();
    let expected = [None, Some((0, 0)), Some((0, 1)), Some((1, 0)), Some((1, 1)), Some((2, 0)), Some((2, 1))];
    assert_eq!(edges, expected);
}
