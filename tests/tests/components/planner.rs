//! Planner added by another program. Job files can use it once it is in the registry.

use crate::examples;
use sim_core::evaluate::{Trial, grow, search_streams};
use sim_core::problem::{Checked, Job};

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
fn job_file_can_use_added_planner() {
    let refused = Checked::from_toml(&job("depth-first")).unwrap_err().to_string();
    assert!(
        refused.contains("unknown variant `depth-first`, expected one of `flood-fill`, `original`, `nearest-valid`"),
        "{refused}"
    );

    examples::add();
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
