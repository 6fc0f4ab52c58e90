//! Tests of the M-TRAN module: the initial state of Fig. 2 of Yoshida et al. 2003, shapes, servos, and refusals.

use sim_core::base::math::{Pose, Vector};
use sim_core::engines::engine;
use sim_core::exchange::Format;
use sim_core::model::{Robot, RobotSpec, State, catalogue};
use sim_core::physics::{EngineKind, Motion, Outcome, Physics, Request, Scale, TICK, Targets, settle};

fn three() -> RobotSpec {
    toml::from_str(catalogue::find(catalogue::robots(), "mtran-three").unwrap().toml).unwrap()
}

fn compiled(spec: &RobotSpec) -> Robot {
    Robot::compile(spec).unwrap()
}

fn single() -> Robot {
    let text = "name = \"one\"\npivot = \"m/link\"\n[[module]]\nname = \"m\"\nkind = \"mtran\"\n";
    compiled(&toml::from_str(text).unwrap())
}

/// Module m of the paper at p with link y and axes z: its parts' axes lie at p and p + y.
#[test]
fn three_modules_stand_as_in_figure_2() {
    let robot = compiled(&three());
    assert_eq!((robot.bodies.len(), robot.hinges.len()), (7, 6));
    assert_eq!(robot.joint_names(), ["0.0", "0.1", "1.0", "2.0", "1.1", "2.1"].map(str::to_owned));
    assert!((robot.mass() - 3.0).abs() < 1e-6);
    // (p, y, z) of the paper, relative to the middle of module 0's link.
    for (module, p, y, z) in [
        ("0", [0.5, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]),
        ("1", [-0.5, 1.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]),
        ("2", [-0.5, -1.0, 0.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]),
    ] {
        let parts: Vec<_> = robot.parts.iter().filter(|part| part.module == module).collect();
        let near = |found: [f64; 3], expected: [f64; 3]| found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-9);
        assert!(near(parts[0].center, p), "{module}: {:?}", parts[0].center);
        assert!(near(parts[2].center, [0, 1, 2].map(|i| p[i] + y[i])), "{module}: {:?}", parts[2].center);
        let pose = Pose::from_parts(
            Vector::ZERO,
            sim_core::base::math::Rotation::from_array(parts[0].rotation.map(|v| v as f32)),
        );
        let along = |axis: Vector| pose.transform_point(axis).to_array().map(f64::from);
        let close =
            |found: [f64; 3], expected: [f64; 3]| found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(close(along(Vector::Z), z) && close(along(Vector::Y), y), "{module}");
    }
}

/// At every pair of angles in steps of 30° the D-shaped parts of a module stay apart: all corners of part 1 stay on
/// their side of a plane that turns with no part.
#[test]
fn parts_of_module_never_overlap() {
    let robot = single();
    let body = |hinge: &str| 1 + robot.hinges.iter().position(|h| h.name == hinge).unwrap();
    let steps = || (-3..=3).map(|step| step as f32 * std::f32::consts::FRAC_PI_6);
    for (a, b) in steps().flat_map(|a| steps().map(move |b| (a, b))) {
        let poses = robot.body_poses(&State::new(Pose::identity(), vec![a, b]));
        let ys = |hinge: &str| {
            let pose = poses[body(hinge)];
            robot.bodies[body(hinge)].prisms[0].corners().iter().map(|c| (pose * *c).y).collect::<Vec<_>>()
        };
        assert!(ys("m.0").iter().all(|y| *y < -0.005), "part 0 at {a}, {b}");
        assert!(ys("m.1").iter().all(|y| *y > 0.005), "part 1 at {a}, {b}");
    }
}

/// A servo turns at π/6 rad/s, and lifts another module against gravity.
#[test]
fn servo_lifts_another_module_in_its_time() {
    let text = "name = \"two\"\npivot = \"a/0\"\n\
        [[module]]\nname = \"a\"\nkind = \"mtran\"\npose = { rotation = [0.0, 90.0, 0.0] }\n\
        [[module]]\nname = \"b\"\nkind = \"mtran\"\nattach = { to = \"a\", port = \"1/0\", own = \"0/0\" }\n\
        [[module]]\nname = \"c\"\nkind = \"mtran\"\nattach = { to = \"a\", port = \"0/1\", own = \"1/1\" }\n";
    let robot = compiled(&toml::from_str(text).unwrap());
    let physics = Physics { steps_per_second: 120, substeps: 16, ..Physics::of_scale(Scale::Paper) };
    let start = settle(engine(EngineKind::Rapier), &robot, &physics).unwrap();
    let joint = robot.hinges.iter().position(|h| h.name == "a.1").unwrap();
    let mut signals = vec![vec![0.0; Targets::ticks(4.0)]; robot.hinges.len()];
    signals[joint][1..].fill(std::f64::consts::FRAC_PI_2);
    let motion = Motion::from(Targets::new(&signals, 4.0).within(&robot.hinges, None));
    let target = |time: f64| {
        let mut out = vec![0.0; robot.hinges.len()];
        motion.targets().at(time, &mut out);
        f64::from(out[joint])
    };
    assert!((target(1.5) - 1.5 * std::f64::consts::FRAC_PI_6).abs() < 1e-3);
    assert!((target(3.0 + TICK) - std::f64::consts::FRAC_PI_2).abs() < 1e-3);
    let request = Request { start: &start, motion: &motion };
    let rollout = engine(EngineKind::Rapier).run(&robot, &physics, &[], &[request]).swap_remove(0);
    assert_eq!(rollout.outcome, Outcome::Completed);
    let behind = (rollout.end.joints[joint] - std::f32::consts::FRAC_PI_2).abs();
    assert!(behind < 0.06, "{behind} rad");
}

#[test]
fn faces_of_same_gender_are_refused() {
    let text = toml::to_string(&three()).unwrap().replacen("own = \"0/0\"", "own = \"1/0\"", 1);
    let refused = Robot::compile(&toml::from_str(&text).unwrap()).unwrap_err().to_string();
    assert_eq!(
        refused,
        "robot.module[1].attach: face \"1/1\" of module \"0\" and face \"1/0\" of module \"1\" are both active: \
         one of them must be active, the other passive"
    );
}

#[test]
fn formats_and_engines_without_prisms_refuse_them() {
    let (robot, physics) = (compiled(&three()), Physics::of_scale(Scale::Paper));
    let refused = Format::Urdf.write(&robot, &physics).unwrap_err().to_string();
    assert!(refused.starts_with("URDF describes D-shaped parts only by mesh files"), "{refused}");
    let mjcf = Format::Mjcf.write(&robot, &physics).unwrap();
    assert_eq!(mjcf.matches("<mesh ").count(), 6);
    let standing = Motion::standing(6, 1.0);
    let refused = engine(EngineKind::Lockstep).supports(&robot, &[], &standing).unwrap_err().to_string();
    assert_eq!(refused, "the lockstep engine simulates boxes only, and the robot has D-shaped parts");
}
