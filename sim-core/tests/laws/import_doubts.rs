//! Tests of imports that are accepted but may not be what was meant: implausible inertia and another unit of length.

use crate::import_kinds::{mjcf, robot, urdf};
use sim_core::base::math::Vector;
use sim_core::exchange::read_in;
use sim_core::model::Robot;

#[test]
fn implausible_inertia_is_reported_as_doubtful() {
    let doubts = |text: &str| Robot::compile(&robot(text)).unwrap().doubts();
    assert!(doubts(&urdf(&[])).is_empty() && doubts(&mjcf(&[])).is_empty());
    let absurd = [
        ("ixx=\".02\" iyy=\".03\" izz=\".04\"", "ixx=\"4\" iyy=\"4\" izz=\"4\""),
        ("value=\"1\"", "value=\".001\""),
        ("<box size=\".6 .3 .2\"/>", "<box size=\".06 .03 .02\"/>"),
    ];
    for change in absurd {
        let told = doubts(&urdf(&[change]));
        assert!(told.len() == 1 && told[0].starts_with("body \"b\": with an inertia of"), "{change:?}: {told:?}");
    }
}

#[test]
fn robot_in_metres_is_detected_and_scaled() {
    let small = urdf(&[
        ("<box size=\".6 .3 .2\"/>", "<box size=\".06 .03 .02\"/>"),
        ("<box size=\".6 .2 .2\"/>", "<box size=\".06 .02 .02\"/>"),
        ("<origin xyz=\".35 0 0\"/><geometry>", "<origin xyz=\".035 0 0\"/><geometry>"),
        ("<origin xyz=\".35 0 0\"/><mass", "<origin xyz=\".035 0 0\"/><mass"),
        ("xyz=\".8 0 0\"", "xyz=\".08 0 0\""),
        ("ixx=\".02\" iyy=\".03\" izz=\".04\"", "ixx=\".0002\" iyy=\".0003\" izz=\".0004\""),
        ("ixx=\".02\" iyy=\".03\" izz=\".04\"", "ixx=\".0002\" iyy=\".0003\" izz=\".0004\""),
    ]);
    let metres = Robot::compile(&robot(&small)).unwrap();
    assert_eq!(metres.unit_in_doubt(), Some(0.06));
    let scaled = Robot::compile(&read_in(&small, 0.1).unwrap().robot).unwrap();
    assert_eq!(scaled.unit_in_doubt(), None);
    let expected = Robot::compile(&robot(&urdf(&[]))).unwrap();
    let close = |a: Vector, b: Vector| (a - b).length() < 1e-6;
    assert!(close(scaled.hinges[0].anchor, expected.hinges[0].anchor));
    for (a, b) in scaled.bodies.iter().zip(&expected.bodies) {
        assert!(close(a.center_of_mass, b.center_of_mass) && close(a.boxes[0].half, b.boxes[0].half));
        assert!((a.inertia[0][0] - b.inertia[0][0]).abs() < 1e-6 && a.mass == b.mass);
    }
    for shipped in sim_core::model::catalogue::robots() {
        let robot = Robot::compile(&toml::from_str(shipped.toml).unwrap()).unwrap();
        assert_eq!((robot.unit_in_doubt(), robot.doubts()), (None, Vec::new()), "{}", shipped.name);
    }
}
