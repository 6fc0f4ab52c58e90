//! Errors of job files, each with the change of a valid job that causes it.

mod common;
#[path = "common/refusals.rs"]
mod refusals;

use common::run;
use refusals::{BODIES, EVOLVE, YARD, changed, folder, must_be_valid, of_lines, refusal, titled};

/// Job that plans with a given gait.
const PLAN: &str = r#"
name = "small"
procedure = "plan"
robot = "robot.toml"
environment = "yard.toml"
gaits.count = 1
gaits.duration = 3.0
gaits.controller = "sine"
plan.seeds = 2
plan.gaits = { joints = ["a", "b"], genome = [[0.5, 0.0, 2.0, 0.0, 0.5, 0.0, 2.0, 1.0]] }
"#;

/// Job that simulates a gait twice.
const STEPS: &str = r#"
name = "small"
procedure = "simulate"
robot = "robot.toml"
environment = "yard.toml"
gaits.count = 1
gaits.duration = 3.0
gaits.controller = "sine"
simulate.steps = [1, 1]
simulate.gaits = { joints = ["a", "b"], genome = [[0.5, 0.0, 2.0, 0.0, 0.5, 0.0, 2.0, 1.0]] }
"#;

/// Job that simulates a table of joint targets.
const TABLE: &str = r#"
name = "small"
procedure = "simulate"
robot = "robot.toml"
environment = "yard.toml"
simulate.targets = { joints = ["a", "b"], rows = [[0.0, 0.0, 0.0], [1.0, 0.5, -0.5]] }
"#;

#[test]
fn unchanged_jobs_are_valid() {
    for job in [EVOLVE, PLAN, STEPS, TABLE] {
        must_be_valid(&[("job.toml", job)]);
    }
}

#[test]
fn tables_of_another_procedure_are_refused() {
    let said = [
        of_lines(
            EVOLVE,
            &[],
            &[
                &[r#"procedure = "evlove""#],
                &["without gaits"],
                &["without fitness"],
                &["without optimiser"],
                &["plan.gaits = { joints = [], genome = [] }"],
                &["simulate.stand = 1.0"],
            ],
        ),
        of_lines(
            PLAN,
            &[],
            &[
                &["without gaits"],
                &["without plan"],
                &[r#"optimiser.kind = "pso""#],
                &["simulate.stand = 1.0"],
                &[r#"finish.kind = "none""#],
                &["planner.repeats = 2"],
            ],
        ),
        of_lines(
            STEPS,
            &[],
            &[
                &["without gaits"],
                &["without simulate"],
                &[r#"fitness.kind = "distance""#],
                &[r#"optimiser.kind = "pso""#],
                &["plan.gaits = { joints = [], genome = [] }"],
                &[r#"finish.kind = "none""#],
                &["planner.iterations = 10"],
                &["planner.repeats = 2", "simulate.replan = {}"],
            ],
        ),
        of_lines(TABLE, &[], &[&["gaits.count = 1"]]),
    ]
    .concat();
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn values_of_wrong_type_are_refused_with_their_line() {
    let said = [
        of_lines(
            EVOLVE,
            &[],
            &[
                &["name = 3"],
                &["seed = 1.5"],
                &["environment = 3"],
                &["without gaits", "gaits = 3"],
                &[r#"gaits.controller = "saw""#],
                &["gaits.bounds = 1.0"],
                &["gaits.bounds.mu = [0.5]"],
                &[r#"planner.algorithm = "rrt""#],
                &["planner.stop_at_goal = 1"],
                &["without fitness", r#"fitness = "coverage""#],
                &[r#"fitness.kind = "path-length""#, "fitness.yaw_weight = 1.0"],
                &[r#"optimiser.kind = "cma""#],
                &["physics.engine = 3"],
                &[r#"physics.engine = "mujoco""#],
                &[r#"physics.scale = "small""#],
                &[r#"physics.joints = "soft""#],
                &[r#"finish.kind = "best""#],
            ],
        ),
        of_lines(PLAN, &[], &[&["plan.gaits = 3"], &["without plan", "plan.seeds = 3"]]),
        of_lines(
            STEPS,
            &[],
            &[
                &["simulate.steps = 1"],
                &["simulate.steps = [1, -1]"],
                &["simulate.places = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]"],
                &[r#"simulate.ways = ["jumping"]"#],
                &["simulate.vary.friction = [0.5]"],
                &["simulate.vary.mass = [0.5, 1.0]"],
                &["simulate.replan.often = 3"],
            ],
        ),
    ]
    .concat();
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn unusable_gaits_and_finish_are_refused() {
    let said = of_lines(
        EVOLVE,
        &[],
        &[
            &["gaits.count = 33"],
            &["gaits.duration = 0.05"],
            &["gaits.duration = 3.01"],
            &["gaits.bounds.mu = [-1001.0, 1.0]"],
            &["gaits.bounds.mu = [0.5, inf]"],
            &["gaits.bounds.mu = [1.0, 0.5]"],
            &[
                r#"gaits.controller = "sine""#,
                "gaits.bounds = { amplitude = [1.0, 1.0], offset = [0.0, 0.0], omega = [2.0, 2.0], phase = [1, 1] }",
            ],
            &["finish.archive = 0"],
            &["finish.seeds = 1001"],
            &["finish.steps_per_second = 0"],
            &["finish.substeps = 1001"],
            &["gaits.duration = 2.5", "finish.steps_per_second = 7"],
            &["finish.steps_per_second = 6000", "finish.substeps = 50"],
            &[r#"finish.kind = "none""#, "finish.archive = 5"],
            &[r#"finish.kind = "none""#, "finish.seeds = 5"],
            &[r#"finish.kind = "none""#, "finish.steps_per_second = 60"],
            &[r#"finish.kind = "none""#, "finish.substeps = 5"],
            &[r#"finish.kind = "none""#, "finish.audit = true"],
        ],
    );
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn planner_settings_out_of_range_are_refused() {
    let said = of_lines(
        EVOLVE,
        &[],
        &[
            &["planner.iterations = 100001"],
            &["planner.yaw_weight = -0.5"],
            &["planner.metric.z = nan"],
            &["planner.metric.roll = 1001.0"],
            &["planner.metric.pitch = -1.0"],
            &["planner.metric.joints = inf"],
            &["planner.reuse_tolerance = 1.5"],
            &["planner.variants = 17"],
            &["planner.repeats = 0"],
            &["planner.max_rollouts = 1"],
            &["planner.iterations = 100000", "planner.repeats = 1000"],
            &[r#"environment = "empty""#, "planner.stop_at_goal = true"],
        ],
    );
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn physics_out_of_range_is_refused() {
    let pillar = YARD.replace("[[obstacle]]", "[[terrain]]");
    let files = [("pillar.toml", pillar.as_str()), ("rod.toml", BODIES)];
    let said = of_lines(
        EVOLVE,
        &files,
        &[
            &["physics.gravity = -9.81"],
            &["physics.friction = 11.0"],
            &["physics.stiffness = -1.0"],
            &["physics.damping = 1e8"],
            &["physics.max_torque = nan"],
            &["physics.steps_per_second = 0"],
            &["physics.substeps = 1001"],
            &["physics.steps_per_second = 10000", "physics.substeps = 1000"],
            &[
                r#"robot = "h-shape""#,
                "physics.steps_per_second = 10000",
                "physics.substeps = 10",
                "finish.steps_per_second = 10000",
                "finish.substeps = 10",
                "planner.max_rollouts = 100",
            ],
            &[
                r#"robot = "lizard""#,
                "physics.steps_per_second = 10000",
                "physics.substeps = 10",
                r#"physics.joints = "multibody""#,
                r#"finish.kind = "none""#,
                "planner.max_rollouts = 100",
            ],
            &[r#"physics.engine = "lockstep""#, r#"physics.joints = "multibody""#],
            &[r#"physics.engine = "lockstep""#, r#"environment = "pillar.toml""#],
            &[r#"physics.engine = "lockstep""#, r#"robot = "rod.toml""#],
        ],
    );
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn fitness_that_does_not_fit_job_is_refused() {
    let said = of_lines(
        EVOLVE,
        &[],
        &[
            &["fitness.cell = 0.001"],
            &["fitness.dimensions = 4"],
            &["fitness.height = 3.0"],
            &["fitness.dimensions = 3", "fitness.height = 0.5"],
            &["fitness.dimensions = 3", "fitness.height = 1.0", "fitness.cell = 0.01"],
            &[r#"fitness.kind = "distance""#, "fitness.yaw_weight = -1.0"],
            &[r#"fitness.kind = "distance""#, "fitness.z_weight = 1001.0"],
            &[r#"fitness.kind = "distance""#, "fitness.yaw_weight = 1.0"],
            &[r#"fitness.kind = "distance""#, "fitness.z_weight = 1.0"],
            &[r#"fitness.kind = "path-length""#, r#"environment = "empty""#],
        ],
    );
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn optimiser_settings_out_of_range_are_refused() {
    let said = of_lines(
        EVOLVE,
        &[],
        &[
            &["optimiser.generations = 1000001"],
            &["optimiser.particles = 10001"],
            &["optimiser.inertia_weight = 2.5"],
            &["optimiser.cognitive = -1.0"],
            &["optimiser.social = 11.0"],
            &[r#"optimiser.kind = "pso-constriction""#, "optimiser.cognitive = nan"],
            &[r#"optimiser.kind = "pso-constriction""#, "optimiser.social = 10.5"],
            &[r#"optimiser.kind = "pso-constriction""#, "optimiser.social = 1.5"],
            &[r#"optimiser.kind = "ga""#, "optimiser.population = 1"],
            &[r#"optimiser.kind = "ga""#, "optimiser.tournament = 21"],
            &[r#"optimiser.kind = "ga""#, "optimiser.elite = 20"],
            &[r#"optimiser.kind = "ga""#, "optimiser.crossover_rate = 1.5"],
            &[r#"optimiser.kind = "ga""#, "optimiser.crossover_eta = -1.0"],
            &[r#"optimiser.kind = "ga""#, "optimiser.mutation_rate = 2.0"],
            &[r#"optimiser.kind = "ga""#, "optimiser.mutation_scale = 2.0"],
        ],
    );
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn plans_with_unusable_gaits_are_refused() {
    let said = of_lines(
        PLAN,
        &[],
        &[
            &["plan.seeds = 1001"],
            &["plan.seeds = 1000", "planner.iterations = 2000"],
            &["gaits.count = 2"],
            &[r#"plan.gaits = { joints = ["a", "c"], genome = [[0.5, 0.0, 2.0, 0.0, 0.5, 0.0, 2.0, 1.0]] }"#],
            &[r#"plan.gaits = { joints = ["a", "b"], genome = [[0.5, 0.0, 2.0, 0.0]] }"#],
            &[r#"plan.gaits = { joints = ["a", "b"], genome = [[0.5, 0.0, 2.0, 0.0, 0.5, 0.0, 5.0, 1.0]] }"#],
            &[r#"plan.gaits = { joints = ["a", "b"], genome = [[0.5, 0.0, nan, 0.0, 0.5, 0.0, 2.0, 1.0]] }"#],
            &["without gaits", r#"plan.gaits = "gaits.json""#],
        ],
    );
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn impossible_motions_are_refused() {
    let said = [
        of_lines(
            STEPS,
            &[],
            &[
                &["without simulate.steps"],
                &["simulate.stand = 1.0"],
                &["without simulate.gaits"],
                &["without simulate.steps", "without gaits", "simulate.stand = 1.0"],
                &["simulate.steps = []"],
                &["simulate.steps = [1, 2]"],
                &["simulate.places = [[0.0, 0.0, 0.0, 0.0]]"],
                &["simulate.places = [[0.0, 0.0, 0.0, 4.0], [20000.0, 0.0, 0.0, 0.0]]"],
                &["simulate.places = [[0.0, 0.0, 0.0, 0.0], [11.0, 0.0, 0.0, 0.0]]"],
                &[r#"simulate.ways = ["continuous", "continuous"]"#],
                &[r#"simulate.ways = ["continuous"]"#, "simulate.steps = [1]"],
                &["simulate.repeats = 5"],
                &["simulate.repeats = 1001", "simulate.vary.friction = [0.6, 1.0]"],
                &[r#"simulate.gaits = { joints = ["a"], genome = [[0.5, 0.0, 2.0, 0.0]] }"#],
                &["gaits.count = 2"],
            ],
        ),
        of_lines(
            TABLE,
            &[],
            &[
                &["without simulate.targets", "simulate.stand = 0.05"],
                &["without simulate.targets", "simulate.stand = 601.0"],
            ],
        ),
    ]
    .concat();
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn impossible_variations_are_refused() {
    let said = of_lines(
        STEPS,
        &[],
        &[
            &["simulate.vary.friction = [-0.5, 1.0]"],
            &["simulate.vary.friction = [0.5, 11.0]"],
            &["simulate.vary.friction = [1.0, 0.6]"],
            &["simulate.vary.motor_strength = [-1.0, 1.0]"],
            &["simulate.vary.x = [-20000.0, 0.0]"],
            &["simulate.vary.y = [0.0, nan]"],
            &["simulate.vary.yaw = [-4.0, 4.0]"],
            &["simulate.vary.dead_joints = 3"],
            &["simulate.vary.target_noise = 4.0"],
        ],
    );
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn impossible_replanning_is_refused() {
    let said = of_lines(
        STEPS,
        &[],
        &[
            &["simulate.replan.deviation = -1.0"],
            &["simulate.replan.most = 0"],
            &["simulate.replan = {}", r#"environment = "empty""#],
            &["simulate.replan.physics.substeps = 0"],
            &["simulate.replan.most = 1000", "planner.iterations = 100000"],
            &["simulate.replan = {}", "without simulate.steps", "simulate.stand = 1.0"],
            &["simulate.replan = {}", r#"simulate.ways = ["continuous"]"#],
            &["simulate.replan = {}", "without simulate.gaits"],
        ],
    );
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn impossible_target_tables_are_refused() {
    let said = of_lines(
        TABLE,
        &[],
        &[
            &[r#"simulate.targets = { joints = ["a", "c"], rows = [[0.0, 0.0, 0.0], [1.0, 0.5, -0.5]] }"#],
            &["simulate.targets = { joints = [], rows = [[0.0], [1.0]] }"],
            &[r#"simulate.targets = { joints = ["a", "b"], rows = [[0.0, 0.0], [1.0, 0.5, -0.5]] }"#],
            &[r#"simulate.targets = { joints = ["a", "b"], rows = [[0.0, 0.0, 0.0], [1.0, 3.5, -0.5]] }"#],
            &[r#"simulate.targets = { joints = ["a", "b"], rows = [[0.5, 0.0, 0.0], [1.0, 0.5, -0.5]] }"#],
            &[r#"simulate.targets = { joints = ["a", "b"], rows = [[0.0, 0.0, 0.0], [0.0, 0.5, -0.5]] }"#],
            &[r#"simulate.targets = { joints = ["a", "b"], rows = [[0.0, 0.0, 0.0], [601.0, 0.5, -0.5]] }"#],
            &[r#"simulate.targets = { joints = ["a", "b"], rows = [[0.0, 0.0, 0.0]] }"#],
        ],
    );
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn too_long_texts_and_lists_are_refused() {
    let refused = |cause: &str, job: &str, changes: &[&str]| {
        titled(cause, &refusal(&["validate", "job.toml"], &[("job.toml", &changed(job, changes))]))
    };
    let steps = |count: usize| format!("simulate.steps = [{}]", vec!["1"; count].join(", "));
    let many = steps(100);
    let costly = ["gaits.duration = 600.0", "physics.steps_per_second = 10000", "physics.substeps = 10", &many];
    let said = [
        refused("description of 5000 bytes", EVOLVE, &[&format!("description = \"{}\"", "x".repeat(5000))]),
        refused("name of 65 letters", EVOLVE, &[&format!("name = \"{}\"", "x".repeat(65))]),
        refused("1001 steps", STEPS, &[&steps(1001)]),
        refused("100 steps, each of 60 million physics steps", STEPS, &costly),
    ];
    insta::assert_snapshot!(said.join("\n"));
}

/// Unlike other faults, this one is found by a run, which takes some tenths of a second.
#[test]
fn runs_beyond_their_rollouts_fail() {
    let failed = |job: &str, changes: &[&str]| {
        let folder = folder(&[("job.toml", &changed(job, changes))]);
        let seen = run(folder.path(), &["run", "job.toml", "--out", "out", "--quiet"]);
        assert_eq!((seen.code, seen.out.as_str()), (1, ""), "{}", seen.err);
        let (_, reason) = seen.err.rsplit_once(") failed: ").expect("the job must fail with a reason");
        titled(&changes.join(", "), reason)
    };
    let small = ["planner.iterations = 5", "planner.reuse_tolerance = 0.0", "gaits.duration = 1.0"];
    let evolve = [&["planner.max_rollouts = 2"][..], &small, &["optimiser.particles = 2", "optimiser.generations = 1"]];
    let plan = [&["planner.max_rollouts = 1"][..], &small];
    let said = [failed(EVOLVE, &evolve.concat()), failed(PLAN, &plan.concat())];
    insta::assert_snapshot!(said.join("\n"));
}
