//! Tests of jobs that simulate a given motion: the work of motors is the energy that they gave, a plan replays with the
//! bits of its tree, each repeat has its own random numbers, and results do not depend on how tasks are distributed.

use crate::planning::{NEAR, Never, gaits, run, text as planning_text};
use sim_core::base::math::{Pose, Rotation, Vector};
use sim_core::control::Run as Compile;
use sim_core::engines::engine;
use sim_core::model::{Robot, RobotSpec, State};
use sim_core::physics::{EngineKind, JointKind, Motion, Outcome, Physics, Request, Scale, TICK, Targets};
use sim_core::problem::{Checked, Job, Way};
use sim_core::procedure::plan::PlanReport;
use sim_core::procedure::simulate::{Drawn, Ended, Run, SimulationReport, Task, TaskResult};
use sim_core::procedure::{self, Bench, Hooks, Step};

/// Job file of a quadropod that executes two random gaits. `simulate`: keys of that table; `more`: other tables.
fn text(environment: &str, simulate: &str, more: &str) -> String {
    format!(
        "name = \"simulation\"\nprocedure = \"simulate\"\nseed = 3\nrobot = \"quadropod\"\nenvironment = {environment}\n\
         gaits = {{ count = 2, duration = 4.0 }}\n{more}\n[simulate]\n{simulate}\n[simulate.gaits]\n{}",
        gaits()
    )
}

const OPEN: &str = r#"{ name = "open", size = [40, 40], start = { x = -1, y = 2, yaw = 0.5 } }"#;

fn simulated(text: &str) -> SimulationReport {
    run::<SimulationReport>(text, 3).1
}

/// In free flight without gravity all kinetic energy comes from the motor. The rollouts end while the axle still turns.
#[test]
fn work_of_motors_in_flight_is_kinetic_energy() {
    let robot: RobotSpec = toml::from_str(
        "name = \"axle\"\npivot = \"block\"\n[[body]]\nname = \"block\"\nmass = 4.0\ninertia = [0.7, 0.9, 0.9, 0, 0, 0]\n\
         [[body.box]]\nhalf = [0.5, 0.5, 0.5]\n[[body]]\nname = \"rotor\"\nmass = 1.0\ncenter_of_mass = [0.3, 0, 0]\n\
         inertia = [0.1, 0.2, 0.2, 0, 0, 0]\n\
         hinge = { name = \"axis\", parent = \"block\", anchor = [0.8, 0, 0], axis = [1, 0, 0] }\n\
         [[body.box]]\ncenter = [0.3, 0, 0]\nhalf = [0.2, 0.2, 0.2]\n",
    )
    .unwrap();
    let robot = Robot::compile(&robot).unwrap();
    let pivot = Pose::from_parts(Vector::new(0.0, 0.0, 20.0), Rotation::IDENTITY);
    let start = State::new(pivot, vec![0.0]);
    for (kind, joints) in [
        (EngineKind::Rapier, JointKind::Impulse),
        (EngineKind::Rapier, JointKind::Multibody),
        (EngineKind::Lockstep, JointKind::Impulse),
    ] {
        let substeps = if kind == EngineKind::Lockstep { 2 } else { 8 };
        let paper = Physics::of_scale(Scale::Paper);
        let physics = Physics { gravity: 0.0, steps_per_second: 1000, substeps, joints, ..paper };
        for (target, seconds) in [(0.6, 0.05), (0.6, 0.1), (-0.4, 0.15)] {
            // A target that moves at constant speed for 0.12 s, then stands.
            let ramp: Vec<f64> = (0..=40).map(|tick| target * (f64::from(tick) * TICK / 0.12).min(1.0)).collect();
            let motion = Motion::from(Targets::new(&[ramp], seconds));
            let rollout =
                engine(kind).run(&robot, &physics, &[], &[Request { start: &start, motion: &motion }]).swap_remove(0);
            assert_eq!(rollout.outcome, Outcome::Completed);
            let velocities = rollout.end.velocities.as_ref().unwrap();
            let (block, rate) = (f64::from(velocities.pivot.angular.x), f64::from(velocities.rates[0]));
            let kinetic = 0.5 * (0.7 * block * block + 0.1 * (block + rate) * (block + rate));
            let work = rollout.effort.work;
            // rapier does not report torques, so they are estimated there.
            let tolerance = if kind == EngineKind::Lockstep { 1e-4 } else { 0.1 };
            assert!(kinetic > 0.1, "{kind} {joints:?}: {kinetic}");
            assert!((work - kinetic).abs() < tolerance * kinetic, "{kind} {joints:?}: {work}, {kinetic}");
            assert!(rollout.effort.turnover >= work.abs(), "{:?}", rollout.effort);
        }
    }
}

#[test]
fn runs_do_not_depend_on_batches_or_saving() {
    for engine in ["lockstep", "rapier"] {
        let vary =
            "steps = [1, 2, 1]\nrepeats = 5\nvary = { friction = [0.6, 1.0], x = [-0.2, 0.2], target_noise = 0.05 }";
        let text = text(OPEN, vary, &format!("physics = {{ engine = \"{engine}\" }}"));
        let (all, report) = run::<SimulationReport>(&text, 6);
        assert_eq!(all, run::<SimulationReport>(&text, 1).0, "{engine}");
        assert_eq!(all.iter().map(Vec::len).collect::<Vec<_>>(), [1, 6]);
        assert_eq!((report.repeats.len(), report.unvaried.len(), report.bodies.len()), (5, 2, 9));
        for runs in &report.repeats {
            assert_eq!(runs.iter().map(|run| run.way).collect::<Vec<_>>(), [Way::Resimulated, Way::Continuous]);
            assert_eq!(runs[0].drawn, runs[1].drawn, "both ways of a repeat must have the same draws");
            assert_eq!(runs[0].gaits, [0, 1, 0]);
            assert_ne!(runs[0].end, runs[1].end);
        }
        let ends: Vec<[f64; 4]> = report.repeats.iter().map(|runs| runs[0].end).collect();
        assert!((1..5).all(|i| !ends[..i].contains(&ends[i])), "{ends:?}");
    }
}

#[test]
fn draws_lie_in_their_ranges_and_are_independent() {
    let drawn = |vary: &str, repeat: u32| {
        let job = Checked::from_toml(&text(OPEN, &format!("steps = [1]\nvary = {{ {vary} }}"), "")).unwrap();
        Drawn::of(&job, Some(repeat))
    };
    let all = "friction = [0.6, 1.0], motor_strength = [0.5, 0.9], x = [-0.3, 0.1], y = [0.0, 0.5], yaw = [-0.1, 0.1], dead_joints = 3";
    let mut seen = std::collections::BTreeSet::new();
    for repeat in 0..200 {
        let Drawn { friction, motor_strength, start: [x, y, yaw], dead } = drawn(all, repeat);
        assert!((0.6..1.0).contains(&friction) && (0.5..0.9).contains(&motor_strength));
        assert!((-1.3..-0.9).contains(&x) && (2.0..2.5).contains(&y) && (0.4..0.6).contains(&yaw), "{x} {y} {yaw}");
        assert!(dead.len() == 3 && dead.is_sorted() && dead[0] != dead[1] && dead[1] != dead[2] && dead[2] < 8);
        seen.extend(dead);
        let alone = drawn("friction = [0.6, 1.0]", repeat);
        assert_eq!((alone.friction, alone.start), (friction, [-1.0, 2.0, 0.5]));
        assert_eq!((alone.motor_strength, alone.dead), (1.0, Vec::new()));
    }
    assert_eq!(seen.len(), 8, "every joint must be drawn as dead at least once");
    let fixed = drawn("friction = [0.7, 0.7], yaw = [0.2, 0.2]", 9);
    assert_eq!((fixed.friction, fixed.start[2]), (0.7, 0.7));
}

/// Without reuse every transition of a tree starts at its parent's exact end, as in the resimulated way.
#[test]
fn plan_without_reuse_replays_with_its_bits() {
    for (algorithm, engine) in [("original", "lockstep"), ("flood-fill", "lockstep"), ("original", "rapier")] {
        let planner = format!("iterations = 60, algorithm = \"{algorithm}\", reuse_tolerance = 0.0");
        let physics = format!("physics = {{ engine = \"{engine}\" }}");
        let plans = planning_text(NEAR, &planner, "seeds = 4").replace("[plan]", &format!("{physics}\n[plan]"));
        let (_, planned) = run::<PlanReport>(&plans, 4);
        let reached: Vec<_> = planned.plans.iter().flatten().filter(|grown| grown.reached).collect();
        assert!(!reached.is_empty(), "{algorithm} on {engine}: no tree reached the goal");
        for grown in reached {
            let steps: Vec<u32> = grown.plan.iter().map(|step| step.gait + 1).collect();
            let places: Vec<[f64; 4]> = grown.plan.iter().map(|s| [s.x, s.y, s.z, s.yaw]).collect();
            let text = text(NEAR, &format!("steps = {steps:?}\nplaces = {places:?}"), &physics);
            let job = Checked::from_toml(&text).unwrap();
            let report = simulated(&text);
            let run = &report.unvaried[0].run;
            assert_eq!(
                (run.end, run.deviation(&job)),
                (places[places.len() - 1], Some(0.0)),
                "{algorithm} on {engine}"
            );
            assert_eq!(run.distance(&job), grown.distance);
            assert!(run.succeeded(&job), "the plan must end within the goal's radius and touch nothing");
        }
    }
}

#[test]
fn displaced_start_displaces_the_whole_run() {
    let report =
        simulated(&text(OPEN, "steps = [2]\nrepeats = 6\nvary = { x = [-3, 3], y = [-3, 3], yaw = [-2, 2] }", ""));
    let unvaried = report.unvaried[0].run.displacement();
    for runs in &report.repeats {
        let (there, run) = (runs[0].displacement(), &runs[0]);
        for (a, b) in [(there.x, unvaried.x), (there.y, unvaried.y), (there.yaw, unvaried.yaw)] {
            assert!((a - b).abs() < 1e-9, "{there:?} {unvaried:?}");
        }
        assert_eq!((run.work, run.turnover), (report.unvaried[0].run.work, report.unvaried[0].run.turnover));
        assert_ne!(run.drawn.start, report.unvaried[0].run.drawn.start);
    }
}

#[test]
fn varied_quantities_change_the_run() {
    let of = |vary: &str| {
        let report = simulated(&text(OPEN, &format!("steps = [1]\nrepeats = 2\nvary = {{ {vary} }}"), ""));
        (report.unvaried[0].run.clone(), report.repeats[0][0].clone())
    };
    let (unvaried, same) = of("friction = [0.8, 0.8]");
    assert_eq!((same.end, same.work), (unvaried.end, unvaried.work), "0.8 is the default friction of the scale");
    assert!(unvaried.travelled > 0.5 && unvaried.turnover > 1.0, "{unvaried:?}");
    let (_, dead) = of("dead_joints = 8");
    assert!(dead.travelled < 0.05 && dead.turnover < 0.1, "{dead:?}");
    let (_, limp) = of("motor_strength = [0.0, 0.0]");
    assert!(limp.work.abs() < 1e-6 && limp.contact.iter().sum::<f64>() > unvaried.contact.iter().sum(), "{limp:?}");
    for vary in ["friction = [0.1, 0.1]", "target_noise = 0.1", "motor_strength = [0.2, 0.2]"] {
        assert_ne!(of(vary).1.end, unvaried.end, "{vary}");
    }
}

#[test]
fn target_table_moves_like_its_gait() {
    let gait = text(OPEN, "steps = [2]", "");
    let job = Job::from_toml(&gait).unwrap();
    let genes: Vec<f64> = job.given_gaits().unwrap().gaits(2).nth(1).unwrap().to_vec();
    let motion = job.controller().compile(&Compile::new(job.robot(), 4.0), &genes).unwrap();
    let row = |(tick, row): (usize, &[f32])| {
        let numbers: Vec<String> = row.iter().map(|target| f64::from(*target).to_string()).collect();
        format!("[{}, {}]", tick as f64 * TICK, numbers.join(", "))
    };
    let rows: Vec<String> = motion.targets().rows().enumerate().map(row).collect();
    let table = format!(
        "name = \"table\"\nprocedure = \"simulate\"\nrobot = \"quadropod\"\nenvironment = {OPEN}\n\
         [simulate.targets]\njoints = {:?}\nrows = [{}]\n",
        job.robot().joint_names(),
        rows.join(", ")
    );
    let (of_gait, of_table) = (simulated(&gait), simulated(&table));
    assert_eq!(of_gait.unvaried[0].samples, of_table.unvaried[0].samples);
    assert_eq!(of_gait.unvaried[0].run.path, of_table.unvaried[0].run.path);
    assert_eq!(of_table.unvaried[0].run.gaits, [0u32; 0]);
}

#[test]
fn standing_robot_stays_in_place() {
    for robot in ["quadropod", "lizard"] {
        let text = format!(
            "name = \"stand\"\nprocedure = \"simulate\"\nrobot = \"{robot}\"\nenvironment = \"empty\"\nsimulate = {{ stand = 1.03 }}\n"
        );
        let report = simulated(&text);
        let run = &report.unvaried[0].run;
        assert!(run.travelled < 1e-3 && run.turnover < 1e-2, "{run:?}");
        // The duration is rounded up to whole steps and ticks.
        assert!(run.seconds >= 1.03 && run.seconds < 1.2, "{} s", run.seconds);
        assert!(run.contact.contains(&1.0));
    }
}

#[test]
fn robot_replans_until_the_goal_is_reached() {
    let planner = "planner = { iterations = 60, reuse_tolerance = 0.0 }";
    let replan = |keys: &str| {
        text(NEAR, &format!("repeats = 3\nvary = {{ friction = [0.5, 1.1] }}\nreplan = {{ {keys} }}"), planner)
    };
    let job = Checked::from_toml(&replan("")).unwrap();
    let report = simulated(&replan(""));
    for run in report.repeats.iter().flatten().chain(report.unvaried.iter().map(|recorded| &recorded.run)) {
        assert!(run.succeeded(&job) && run.replans >= 1 && !run.gaits.is_empty(), "{run:?}");
    }
    // With the physics that it was planned with, the first plan reaches the goal without any deviation.
    assert_eq!(report.unvaried[0].run.replans, 1);
    assert_eq!(simulated(&replan("deviation = 0.0")).unvaried, report.unvaried);
    // With `most = 1` the first plan is executed to its end, also with another friction.
    let one = simulated(&replan("deviation = 0.0, most = 1"));
    assert!(one.repeats.iter().flatten().all(|run| run.replans == 1));
}

/// The places of the plan are wrong, so the robot replans after the first step.
#[test]
fn wrong_plan_is_replaced_after_its_first_step() {
    let planner = "planner = { iterations = 60, reuse_tolerance = 0.0 }";
    let replan = |keys: &str| {
        let steps = "steps = [1, 1, 1]\nplaces = [[9, 9, 0, 0], [9, 9, 0, 0], [9, 9, 0, 0]]";
        simulated(&text(NEAR, &format!("{steps}\nreplan = {{ {keys} }}"), planner)).unvaried[0].run.clone()
    };
    assert_eq!(replan("").gaits[0], 0, "the first step must be executed as given");
    assert!(replan("").replans >= 1);
    let patient = replan("deviation = 50.0, most = 1");
    assert_eq!(patient.gaits[..3], [0, 0, 0], "no step ends 50 mu from its place in the plan");
}

#[test]
fn blocked_start_is_reported_and_its_run_fails() {
    let vary = "steps = [1]\nrepeats = 4\nvary = { x = [5.0, 5.0], y = [3.0, 3.0] }";
    let report = simulated(&text(NEAR, vary, ""));
    let job = Checked::from_toml(&text(NEAR, vary, "")).unwrap();
    for run in report.repeats.iter().flatten() {
        assert!(
            matches!(&run.ended, Ended::NoStart(reason) if reason.contains("touches environment.obstacle[0]")),
            "{run:?}"
        );
        assert!(!run.succeeded(&job) && run.gaits.is_empty());
    }
    let off = simulated(&text(NEAR, "steps = [1]\nrepeats = 1\nvary = { x = [90, 90] }", ""));
    assert!(matches!(&off.repeats[0][0].ended, Ended::NoStart(reason) if reason.contains("outside the map")));
}

#[test]
fn impossible_results_of_a_run_are_refused() {
    let text = text(NEAR, "steps = [1, 2]\nrepeats = 2\nvary = { friction = [0.6, 1.0] }", "");
    let job = Checked::from_toml(&text).unwrap();
    let bench = Bench::open(&job.to_toml()).unwrap();
    let mut procedure = procedure::start(&job).unwrap();
    let prepared = bench.run(0, &[], &[(0, Vec::new())], &Never as &dyn Hooks).unwrap().remove(0);
    assert_eq!(procedure.tell(&[prepared.into()]).step, Step::Next);
    let round = procedure.round();
    let result = |index: u32| bench.run(1, &round.shared, &[(index, procedure.task(index))], &Never).unwrap().remove(0);
    let (repeat, unvaried) = (result(0), result(2));
    assert_eq!(Task::decode(&procedure.task(2)), Ok(Task::Unvaried));
    procedure.check(0, &repeat).unwrap();
    procedure.check(2, &unvaried).unwrap();
    let TaskResult::Repeated(runs, counts) = TaskResult::decode(&repeat).unwrap() else {
        panic!("the result must be that of a repeat")
    };
    let with = |change: &dyn Fn(&mut Run)| {
        let mut runs = runs.clone();
        change(&mut runs[1]);
        TaskResult::Repeated(runs, counts).encode()
    };
    let many = sim_core::base::score::Counts { rollouts: 1000, ..counts };
    let refused: Vec<(Vec<u8>, &str)> = vec![
        (Vec::new(), "it is empty"),
        (unvaried.clone(), "not of the kind that the task needs"),
        (with(&|run| run.way = Way::Resimulated), "not of the kind that the task needs"),
        (with(&|run| run.drawn.friction = 0.7), "not those of its random numbers"),
        (with(&|run| run.end[0] = f64::NAN), "not finite"),
        (with(&|run| run.travelled = -1.0), "negative"),
        (with(&|run| run.work = 2.0 * run.turnover + 1.0), "is more than its turnover"),
        (with(&|run| run.contact[0] = 1.5), "must be a share of 0 to 1 for each body"),
        (with(&|run| run.contact.push(0.0)), "must be a share of 0 to 1 for each body"),
        (with(&|run| run.gaits = vec![1, 0]), "not those of the motion"),
        (with(&|run| run.gaits = vec![0]), "not those of the motion"),
        (with(&|run| run.replans = 1), "not those of the motion"),
        (with(&|run| run.seconds = 100.0), "exceed the 16 s of the motion"),
        (with(&|run| run.path.clear()), "its path has 0 points"),
        (with(&|run| run.ended = Ended::Broken(String::new())), "its reason must have"),
        (TaskResult::Repeated(runs.clone(), many).encode(), "its count of rollouts, 1000, is impossible"),
    ];
    for (result, reason) in refused {
        let said = procedure.check(0, &result).expect_err(reason).to_string();
        assert!(said.starts_with("the result of repeat 0 is refused") && said.contains(reason), "{said}");
    }
    let TaskResult::Unvaried(mut recorded, counts) = TaskResult::decode(&unvaried).unwrap() else {
        panic!("the result must be that of the unvaried runs")
    };
    recorded[0].touching[0].pop();
    let said = procedure.check(2, &TaskResult::Unvaried(recorded, counts).encode()).unwrap_err().to_string();
    assert!(said.contains("the contacts of each body"), "{said}");
}

#[test]
fn invalid_simulation_jobs_are_refused_by_field() {
    let good = text(NEAR, "steps = [1, 2]\nrepeats = 2\nvary = { friction = [0.6, 1.0] }", "");
    let job = Checked::from_toml(&good).unwrap();
    let again = Checked::from_toml(&job.to_toml()).unwrap();
    assert_eq!((again.digest(), again.to_toml()), (job.digest(), job.to_toml()));
    let bare = |simulate: &str| {
        format!(
            "name = \"a\"\nprocedure = \"simulate\"\nrobot = \"quadropod\"\nenvironment = \"empty\"\n[simulate]\n{simulate}\n"
        )
    };
    let steps = |keys: &str| good.replace("steps = [1, 2]", keys);
    for (file, said) in [
        (steps("steps = [1, 3]"), "simulate.steps[1] = 3 is out of range: allowed is 1 to 2"),
        (steps("steps = []"), "number of simulate.steps = 0 is out of range"),
        (steps("steps = [1, 2]\nstand = 1.0"), "simulate: it needs one motion"),
        (steps(""), "simulate: it needs one motion"),
        (steps("steps = [1, 2]\nplaces = [[0, 0, 0, 0]]"), "simulate.places: 1 places for 2 steps"),
        (
            steps("steps = [1]\nplaces = [[16, 0, 0, 0]]"),
            "simulate.places[0]: it lies outside the map of environment \"near\"",
        ),
        (steps("steps = [1]\nways = [\"continuous\"]"), "simulate.ways: only a motion of several steps"),
        (steps("steps = [1, 2]\nways = []"), "simulate.ways: allowed are"),
        (good.replace("[0.6, 1.0]", "[1.0, 0.6]"), "simulate.vary.friction: the range begins at 1, above its end 0.6"),
        (
            good.replace("friction = [0.6, 1.0]", "dead_joints = 9"),
            "simulate.vary.dead_joints = 9 is out of range: allowed is 0 to 8",
        ),
        (good.replace("friction = [0.6, 1.0]", "target_noise = 4.0"), "simulate.vary.target_noise = 4 is out of range"),
        (good.replace("vary = { friction = [0.6, 1.0] }", ""), "simulate.repeats: nothing varies"),
        (good.replace("repeats = 2", "repeats = 1001"), "simulate.repeats = 1001 is out of range"),
        (good.replace("count = 2", "count = 3"), "simulate.gaits.genome: it has 2 gaits, but gaits.count = 3"),
        (good.replace("\"quadropod\"", "\"lizard\""), "simulate.gaits: they belong to a robot with joints "),
        (
            good.replace("gaits = { count = 2, duration = 4.0 }\n", ""),
            "gaits: a job with procedure = \"simulate\" needs this table",
        ),
        (format!("{good}[planner]\niterations = 5\n"), "planner: a job that simulates grows trees only if it replans"),
        (
            format!("{good}[fitness]\nkind = \"coverage\"\n"),
            "fitness: a job with procedure = \"simulate\" has no such table",
        ),
        (steps("steps = [1]\nreplan = { most = 0 }"), "simulate.replan.most = 0 is out of range"),
        (text("\"empty\"", "replan = { }", ""), "simulate.replan: plans lead to a goal, and the environment has none"),
        (bare("stand = 1.0\nreplan = { }"), "simulate.replan: plans are made of gaits"),
        (bare("stand = 0.0"), "simulate.stand = 0 is out of range: allowed is 0.1 to 600 s"),
        (bare("stand = 1.0\ngaits = \"out\""), "simulate.gaits: neither simulate.steps nor simulate.replan uses them"),
        (bare("targets = \"a.csv\""), "\"a.csv\" is a path, and only the `evogait` command reads paths"),
        (
            bare("targets = { joints = [\"a\"], rows = [[0, 1], [1, 1]] }"),
            "simulate.targets.joints: they are a, but robot",
        ),
        (bare("targets = { joints = [\"a\"], rows = [[0, 1], [1]] }"), "simulate.targets.rows[1]: it has 1 numbers"),
        (bare("targets = { joints = [\"a\"], rows = [[0, 1], [0, 1]] }"), "simulate.targets.rows[1]: its time is 0 s"),
        (
            bare("targets = { joints = [\"a\"], rows = [[0, 4], [1, 1]] }"),
            "simulate.targets.rows[0]: target 4 is out of range",
        ),
        (
            bare("targets = { joints = [\"a\"], rows = [] }"),
            "time of the last row of simulate.targets = 0 is out of range",
        ),
        (good.replace("[simulate]", "simulat = 1\n[simulate]"), "unknown field `simulat`"),
    ] {
        let told = Checked::from_toml(&file).expect_err(said).to_string();
        assert!(told.contains(said), "{said}:\n{told}");
    }
}
