//! Tests of the dependencies: the numeric crates that results depend on, and crates that sim-core must never depend on.

use std::collections::{BTreeMap, BTreeSet};

fn locked() -> Vec<toml::Table> {
    let lock: toml::Table = include_str!("../../../Cargo.lock").parse().unwrap();
    lock["package"].as_array().unwrap().iter().map(|p| p.as_table().unwrap().clone()).collect()
}

#[test]
fn engine_digest_names_the_locked_versions() {
    for (name, version) in sim_core::engines::NUMERIC_CRATES {
        let found = locked().iter().any(|p| p["name"].as_str() == Some(name) && p["version"].as_str() == Some(version));
        assert!(
            found,
            "{name} {version} is not in Cargo.lock: update NUMERIC_CRATES, which changes the engine digest of all results"
        );
    }
}

#[test]
fn sim_core_depends_on_no_network_or_database() {
    let mut uses: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for package in locked() {
        let dependencies = package.get("dependencies").and_then(|d| d.as_array().cloned()).unwrap_or_default();
        let names = dependencies.iter().filter_map(|d| d.as_str()).map(|d| d.split(' ').next().unwrap().to_owned());
        uses.entry(package["name"].as_str().unwrap().to_owned()).or_default().extend(names);
    }
    let mut seen = BTreeSet::new();
    let mut todo = vec!["sim-core".to_owned()];
    while let Some(name) = todo.pop() {
        if seen.insert(name.clone()) {
            todo.extend(uses.get(&name).cloned().unwrap_or_default());
        }
    }
    assert!(seen.contains("rapier3d"));
    for forbidden in ["tokio", "tonic", "sqlx", "prost", "rayon", "hyper"] {
        assert!(!seen.contains(forbidden), "sim-core depends on {forbidden}");
    }
}
