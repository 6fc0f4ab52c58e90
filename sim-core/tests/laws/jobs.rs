//! Tests of job files: identity, round trips, and validity of everything that ships.

use sim_core::engines::{Why, engine_digest, engine_digests, engines_digest};
use sim_core::job::{JobSpec, Reference};
use sim_core::model::{Robot, RobotSpec, catalogue};
use sim_core::physics::{EngineChoice, EngineKind, JointKind};
use sim_core::problem::{Checked, Job};

fn text(more: &str) -> String {
    format!(
        r#"
        name = "a"
        robot = "lizard"
        environment = "empty"
        gaits = {{ count = 2 }}
        fitness = {{ kind = "coverage" }}
        optimiser = {{ kind = "pso" }}
        {more}
        "#
    )
}

#[test]
fn shipped_jobs_are_valid_and_survive_round_trips() {
    for entry in catalogue::jobs() {
        let job = Job::from_toml(entry.toml).unwrap_or_else(|e| panic!("{}: {e}", entry.name));
        let again = Job::from_toml(&job.to_toml()).unwrap();
        assert_eq!(again.digest(), job.digest(), "{}", entry.name);
        assert_eq!(again.to_toml(), job.to_toml(), "{}", entry.name);
        assert_eq!(job.spec().name, entry.name);
    }
    for entry in catalogue::environments() {
        let environment = sim_core::model::environment::Environment::from_toml(entry.toml).unwrap();
        assert_eq!(environment.name, entry.name);
    }
}

#[test]
fn distance_weights_need_matching_goal_fields() {
    let job = |goal: &str, weights: &str| {
        let map = format!(
            "{{ name = \"map\", size = [20, 20], start = {{ x = 0, y = 0 }}, goal = {{ x = 3, y = 4{goal} }} }}"
        );
        let text = text("").replace("\"empty\"", &map).replace("\"coverage\"", &format!("\"distance\"{weights}"));
        Checked::from_toml(&text)
    };
    let planar = job("", "").unwrap().digest();
    assert_ne!(job(", yaw = 1.0", ", yaw_weight = 0.5").unwrap().digest(), planar);
    assert!(job(", z = 0.5, yaw = 1.0", ", yaw_weight = 0.5, z_weight = 1.0").is_ok());
    for (goal, weights, said) in [
        ("", ", yaw_weight = 0.5", "fitness.yaw_weight: the goal of environment \"map\" has no yaw: add one to it"),
        (
            ", yaw = 1.0",
            ", z_weight = 1.0",
            "fitness.z_weight: the goal of environment \"map\" has no z: add one to it",
        ),
        (", yaw = 100.0", "", "environment.goal.yaw = 100 is out of range"),
    ] {
        let told = job(goal, weights).expect_err(said).to_string();
        assert!(told.contains(said), "{told}");
    }
}

/// Robots with the failures of Vonásek and Faigl 2016, section V.
fn with_variants() -> impl Iterator<Item = &'static catalogue::Entry> {
    catalogue::robots().iter().filter(|entry| entry.toml.contains("[variants]"))
}

#[test]
fn variants_e1_e2_fail_one_and_two_modules() {
    for entry in with_variants() {
        let spec: RobotSpec = toml::from_str(entry.toml).unwrap();
        assert_eq!(spec.name, entry.name);
        let healthy = Robot::compile(&spec).unwrap();
        for (variant, failed) in [("E1", 1), ("E2", 2)] {
            let damaged = Robot::compile(&spec.variant(variant).unwrap()).unwrap();
            assert_eq!(damaged.hinges.len(), healthy.hinges.len() - failed, "{} {variant}", entry.name);
            assert_eq!(damaged.bodies.len(), healthy.bodies.len() - failed);
            assert!((damaged.mass() - healthy.mass()).abs() < 1e-9);
        }
        let body_mass: f32 = healthy.bodies.iter().map(|b| b.mass).sum();
        assert!((f64::from(body_mass) - healthy.mass()).abs() < 1e-5);
    }
}

#[test]
fn every_variant_of_every_robot_settles() {
    for entry in with_variants() {
        for variant in ["E1", "E2"] {
            let more = format!("variant = \"{variant}\"");
            let text = text(&more).replace("\"lizard\"", &format!("\"{}\"", entry.name));
            Job::from_toml(&text).unwrap_or_else(|e| panic!("{} {variant}: {e}", entry.name));
        }
    }
}

#[test]
fn job_digest_ignores_names_and_covers_settings() {
    let digest = |text: String| Job::from_toml(&text).unwrap().digest();
    let base = digest(text(""));
    assert_eq!(base, digest(text("").replace("name = \"a\"", "name = \"b\"\ndescription = \"other\"")));
    assert_eq!(
        base,
        digest(text("").replace("{ count = 2 }", "{ count = 2, duration = 30.0, controller = \"hopf\" }"))
    );
    for change in [
        "seed = 2",
        "variant = \"E1\"",
        "planner = { iterations = 151 }",
        "planner = { reuse_tolerance = 0.0 }",
        "planner = { variants = 2 }",
        "physics = { friction = 0.81 }",
        "physics = { scale = \"real\" }",
        "physics = { joints = \"multibody\" }",
        "finish = { kind = \"none\" }",
        "finish = { archive = 19 }",
        "finish = { seeds = 19 }",
        "finish = { audit = false }",
        "finish = { steps_per_second = 120 }",
        "finish = { substeps = 17 }",
    ] {
        assert_ne!(base, digest(text(change)), "{change}");
    }
    assert_ne!(base, digest(text("").replace("\"empty\"", "\"column\"")));
    let engines = ["rapier", "lockstep"].map(|engine| digest(text(&format!("physics = {{ engine = \"{engine}\" }}"))));
    assert_ne!(engines[0], engines[1]);
}

/// The lizard with a failed joint that is not one of its variants, so the fidelity table has no row for it.
fn unknown_robot(more: &str) -> Job {
    let mut spec: JobSpec = toml::from_str(&text(more)).unwrap();
    let lizard = catalogue::find(catalogue::robots(), "lizard").unwrap();
    let mut robot: RobotSpec = toml::from_str(lizard.toml).unwrap();
    robot.failed = vec!["spine3".to_owned()];
    spec.robot = Reference::Inline(Box::new(robot));
    Job::new(spec).unwrap()
}

#[test]
fn automatic_engine_choice_is_recorded_in_resolved_job() {
    let job = unknown_robot("");
    assert_eq!((job.chosen().engine, job.chosen().why), (EngineKind::Rapier, Why::Unmeasured));
    assert_eq!(job.spec().physics.engine, EngineChoice::Rapier);
    let again = Job::from_toml(&job.to_toml()).unwrap();
    assert_eq!((again.chosen().engine, again.chosen().why), (EngineKind::Rapier, Why::Asked));
    assert_eq!((again.digest(), again.to_toml()), (job.digest(), job.to_toml()));
    assert_eq!(job.digest(), unknown_robot("physics = { engine = \"rapier\" }").digest());
}

#[test]
fn lockstep_job_has_own_steps_and_rapier_reference() {
    for (scale, steps) in [("paper", 200), ("real", 600)] {
        let of = |engine: &str, more: &str| {
            Job::from_toml(&text(&format!("physics = {{ scale = \"{scale}\", engine = \"{engine}\" }}\n{more}")))
                .unwrap()
        };
        let (lockstep, rapier) = (of("lockstep", ""), of("rapier", ""));
        assert_eq!((lockstep.physics().steps_per_second, lockstep.physics().substeps), (steps, 2));
        let written: JobSpec = toml::from_str(&lockstep.to_toml()).unwrap();
        assert_eq!(written.physics.engine, EngineChoice::Lockstep);
        assert_eq!(Job::from_toml(&lockstep.to_toml()).unwrap().digest(), lockstep.digest());
        let (a, b) = (lockstep.reference().unwrap(), rapier.reference().unwrap());
        assert_eq!((a.chosen().engine, a.physics()), (EngineKind::Rapier, b.physics()));
        assert_eq!(a.start(), b.start());
        // A finish needs rapier, and a robot that trembles on rapier settles on lockstep. So only a lockstep job
        // without a finish needs a single engine.
        let bare = of("lockstep", "finish = { kind = \"none\" }");
        assert_eq!(bare.engine_digest(), engine_digest(EngineKind::Lockstep));
        for job in [&rapier, &lockstep] {
            assert_eq!(job.engine_digest(), engines_digest(EngineKind::Lockstep, EngineKind::Rapier));
        }
        let offered: Vec<_> = engine_digests().into_iter().map(|(_, digest)| digest).collect();
        for job in [&lockstep, &rapier, &bare] {
            assert!(offered.contains(&job.engine_digest()));
        }
    }
}

#[test]
fn job_on_stairs_uses_rapier_unless_set_otherwise() {
    let on_stairs = |engine: &str| {
        let text = text(&format!("physics = {{ engine = \"{engine}\" }}"));
        Job::from_toml(&text.replace("\"empty\"", "\"stairs\""))
    };
    assert_eq!(on_stairs("lockstep").unwrap().chosen().engine, EngineKind::Lockstep);
    assert_eq!(on_stairs("auto").unwrap().chosen().to_string(), "auto: rapier, since there is terrain");
    let said = on_stairs("bullet").unwrap_err().to_string();
    assert!(said.contains("bullet") && said.contains("`auto`, `rapier`, `lockstep`"), "{said}");
}

#[test]
fn default_settings_are_written_out() {
    let job = Job::from_toml(&text("")).unwrap();
    let written: JobSpec = toml::from_str(&job.to_toml()).unwrap();
    assert_eq!(written.physics.steps_per_second, Some(job.physics().steps_per_second));
    assert!(job.to_toml().contains("reuse_tolerance = 0.05"));
    assert!(job.to_toml().contains("friction = 0.8\n"));
    assert!(job.to_toml().contains("joints = \"impulse\"\n"));
}

#[test]
fn joint_kind_round_trips_and_unknown_is_refused() {
    let job = Job::from_toml(&text("physics = { joints = \"multibody\" }")).unwrap();
    assert_eq!(job.physics().joints, JointKind::Multibody);
    let again = Job::from_toml(&job.to_toml()).unwrap();
    assert_eq!((again.physics(), again.digest()), (job.physics(), job.digest()));
    let default = Job::from_toml(&text("physics = { joints = \"impulse\" }")).unwrap();
    assert_eq!(default.digest(), Job::from_toml(&text("")).unwrap().digest());
    let refused = Job::from_toml(&text("physics = { joints = \"glue\" }")).unwrap_err().to_string();
    assert!(refused.contains("glue") && refused.contains("impulse") && refused.contains("multibody"), "{refused}");
}

#[test]
fn finish_is_written_with_reference_of_its_scale() {
    for (scale, steps, substeps) in [("paper", 60, 16), ("real", 120, 32)] {
        let job = Job::from_toml(&text(&format!("physics = {{ scale = \"{scale}\" }}"))).unwrap();
        let written: JobSpec = toml::from_str(&job.to_toml()).unwrap();
        let finish = written.finish.as_ref().expect("the finish must be written out");
        assert_eq!((finish.archive, finish.seeds, finish.audit), (Some(20), Some(20), Some(true)));
        assert_eq!((finish.steps_per_second, finish.substeps), (Some(steps), Some(substeps)));
        let reference = job.reference().unwrap();
        assert_eq!((reference.physics().steps_per_second, reference.physics().substeps), (steps, substeps));
        let same = |job: &Job| (job.physics().gravity, job.physics().friction, job.physics().max_torque);
        assert_eq!(same(reference), same(&job));
        assert!(reference.finish().is_none() && reference.reference().is_none());
    }
    let bare = Job::from_toml(&text("finish = { kind = \"none\" }")).unwrap();
    assert!(bare.to_toml().contains("[finish]\nkind = \"none\"\n"), "{}", bare.to_toml());
    assert!(bare.reference().is_none());
    assert_eq!(bare.fresh_seeds(), 20);
}

#[test]
fn invalid_finish_is_refused_by_field_and_range() {
    for (finish, said) in [
        ("archive = 0", "finish.archive = 0 is out of range: allowed is 1 to 1000"),
        ("seeds = 1001", "finish.seeds = 1001 is out of range: allowed is 1 to 1000"),
        ("substeps = 0", "finish.substeps = 0 is out of range: allowed is 1 to 1000"),
        ("steps_per_second = 10001", "finish.steps_per_second = 10001 is out of range: allowed is 1 to 10000"),
        ("kind = \"none\", audit = false", "finish.audit: a finish of kind \"none\" has no settings"),
        ("kind = \"best\"", "unknown variant `best`, expected `reference` or `none`"),
        ("trees = 3", "unknown field `trees`"),
    ] {
        let error = Job::from_toml(&text(&format!("finish = {{ {finish} }}"))).unwrap_err().to_string();
        assert!(error.contains(said), "{finish}: {error}");
    }
    // Gaits of 0.1 s are a whole number of steps at 30 steps per second, but not at 64.
    let short = text("finish = { steps_per_second = 64 }").replace("count = 2", "count = 2, duration = 0.1");
    let error = Job::from_toml(&short).unwrap_err().to_string();
    assert!(error.starts_with("finish.steps_per_second: 0.1 s is not a whole number"), "{error}");
}

#[test]
fn invalid_number_of_variants_is_refused_with_limits() {
    for wrong in [0, 17] {
        let error = Job::from_toml(&text(&format!("planner = {{ variants = {wrong} }}"))).unwrap_err().to_string();
        assert_eq!(error, format!("planner.variants = {wrong} is out of range: allowed is 1 to 16"));
    }
}
