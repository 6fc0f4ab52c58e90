//! Kind of module with two hinges, added by another program. Robot files can use it once it is in the registry.

use sim_core::base::math::{Vector, about, angle_between};
use sim_core::base::registry::Registered;
use sim_core::engines::engine;
use sim_core::model::{FaceKind, Gender, HingeKind, ModuleKind, PartKind, Robot, RobotSpec};
use sim_core::physics::{EngineKind, Outcome, Physics, Request, Scale, Targets};

const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];

/// Module with two halves at the ends of a link of 1 mu. Each half turns about an axis through its middle; the axes are
/// parallel. Layout of an M-TRAN module (Murata et al. 2002).
static TWO_AXES: ModuleKind = ModuleKind {
    name: "two-axes",
    parts: &[
        PartKind::cuboid("rear", [-0.5, 0.0, 0.0], [0.24; 3], 0.4),
        PartKind::cuboid("link", [0.0; 3], [0.24, 0.2, 0.05], 0.2),
        PartKind::cuboid("front", [0.5, 0.0, 0.0], [0.24; 3], 0.4),
    ],
    hinges: &[
        HingeKind::new("rear", [0, 1], [-0.5, 0.0, 0.0], Y),
        HingeKind {
            limits: [-1.0, 1.2],
            speed: Some(2.0),
            torque: Some(30.0),
            ..HingeKind::new("front", [1, 2], [0.5, 0.0, 0.0], Y)
        },
    ],
    faces: &[
        FaceKind {
            name: "back",
            part: 0,
            position: [-0.75, 0.0, 0.0],
            normal: [-1.0, 0.0, 0.0],
            up: Z,
            gender: Gender::Any,
        },
        FaceKind {
            name: "front",
            part: 2,
            position: [0.75, 0.0, 0.0],
            normal: [1.0, 0.0, 0.0],
            up: Z,
            gender: Gender::Any,
        },
    ],
};

fn robot(failed: &str) -> Robot {
    let text = format!(
        r#"
        name = "pair"
        pivot = "a"
        failed = [{failed}]
        [[module]]
        name = "a"
        kind = "two-axes"
        [[module]]
        name = "b"
        kind = "two-axes"
        attach = {{ to = "a", port = "front" }}
        "#
    );
    Robot::compile(&toml::from_str::<RobotSpec>(&text).unwrap()).unwrap()
}

#[test]
fn kind_with_two_hinges_moves_on_both_engines() {
    let unknown = "name = \"a\"\npivot = \"a\"\n[[module]]\nname = \"a\"\nkind = \"two-axes\"";
    let refused = Robot::compile(&toml::from_str(unknown).unwrap()).unwrap_err().to_string();
    assert!(refused.contains("two-axes") && refused.contains("cosmo"), "{refused}");
    ModuleKind::registry().add(&TWO_AXES).unwrap();

    let whole = robot("");
    assert_eq!(whole.joint_names(), ["a.rear", "a.front", "b.rear", "b.front"]);
    let numbers = |i: usize| (whole.hinges[i].limits, whole.hinges[i].speed, whole.hinges[i].torque);
    assert_eq!(numbers(3), ([-1.0, 1.2], Some(2.0), Some(30.0)));
    // A failed module is rigid: both of its hinges are stuck, and its parts belong to the body that carries it.
    let damaged = robot("\"b\"");
    assert_eq!(damaged.joint_names(), ["a.rear", "a.front"]);
    assert!((damaged.mass() - whole.mass()).abs() < 1e-6);

    for kind in [EngineKind::Rapier, EngineKind::Lockstep] {
        for angle in [0.4f32, -0.7] {
            ends_stay_parallel(kind, &damaged, angle);
        }
    }
}

/// With its hinges at α and −α, a module's front is parallel to its rear. Its position is the end of the link of 1 mu:
/// (cos α, 0, −sin α) from the rear's axis, in the rear's frame. Without gravity nothing else acts on the joints.
fn ends_stay_parallel(kind: EngineKind, robot: &Robot, angle: f32) {
    let physics = Physics { gravity: 0.0, ..Physics::of(kind, Scale::Paper) };
    let mut start = robot.neutral();
    start.pivot.translation.z += 5.0;
    let signal = |angle: f32| vec![f64::from(angle); Targets::ticks(3.0)];
    let targets = Targets::new(&[signal(angle), signal(-angle)], 3.0).within(&robot.hinges, None);
    let request = Request { start: &start, motion: &targets.into() };
    let rollout = engine(kind).run(robot, &physics, &[], &[request]).swap_remove(0);
    assert_eq!(rollout.outcome, Outcome::Completed, "{kind:?}");
    let [rear, front] = [rollout.end.joints[0], rollout.end.joints[1]];
    assert!((rear - angle).abs() < 0.02 && (front + angle).abs() < 0.02, "{kind:?}: {rear} rad, {front} rad");

    let poses = robot.body_poses(&rollout.end);
    assert!(angle_between(poses[0].rotation, poses[2].rotation) < 0.03, "{kind:?}");
    // The origin of the pivot's frame is the middle of the rear, on its axis.
    let seen = poses[0].rotation.inverse() * (poses[2].translation - poses[0].translation);
    let expected = about(Vector::Y, angle) * Vector::X;
    assert!((seen - expected).length() < 0.03, "{kind:?}: {seen} against {expected}");
}
