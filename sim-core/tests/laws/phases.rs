//! Tests of controllers that continue from the end phase of an earlier motion.

use sim_core::base::random::{Purpose, Stream};
use sim_core::base::registry::Registered;
use sim_core::control::{Controller, Run};
use sim_core::model::{Phase, Robot, RobotSpec, catalogue};
use sim_core::physics::Motion;

fn quadropod() -> RobotSpec {
    toml::from_str(catalogue::find(catalogue::robots(), "quadropod").unwrap().toml).unwrap()
}

/// The quadropod, with a greatest speed of all joints, rad/s.
fn robot(speed: Option<f32>) -> Robot {
    let mut robot = Robot::compile(&quadropod()).unwrap();
    robot.hinges.iter_mut().for_each(|hinge| hinge.speed = speed);
    robot
}

fn gait(controller: &dyn Controller, joints: usize) -> Vec<f64> {
    let mut stream = Stream::new(3, Purpose::Sample, 0, 0, 0);
    let each = controller.parameters();
    (0..joints).flat_map(|_| each).map(|p| stream.uniform(p.bounds.0, p.bounds.1)).collect()
}

/// Controllers that move the quadropod.
fn of_any_robot() -> impl Iterator<Item = &'static dyn Controller> {
    let robot = robot(None);
    <dyn Controller>::registry().all().into_iter().filter(move |controller| controller.fits(&robot).is_ok())
}

/// Bits of a motion's targets at every tick from `first` on.
fn rows(motion: &Motion, first: usize) -> Vec<Vec<u32>> {
    motion.targets().rows().skip(first).map(|row| row.iter().map(|target| target.to_bits()).collect()).collect()
}

#[test]
fn motion_continued_from_a_phase_keeps_its_bits() {
    for controller in of_any_robot() {
        for speed in [None, Some(1.5)] {
            let robot = robot(speed);
            let gait = gait(controller, robot.hinges.len());
            let run = |duration, from| {
                controller
                    .compile(&Run { from, ..Run::new(&robot, duration) }, &gait)
                    .expect("the gait must have a motion")
            };
            let whole = run(3.0, None);
            let first = run(1.2, None);
            let second = run(1.8, Some(first.end_phase()));
            assert_eq!(rows(&second, 0), rows(&whole, 240), "{} at speed {speed:?}", controller.name());
            assert_eq!(second.end_phase(), whole.end_phase(), "{}", controller.name());
        }
    }
}

#[test]
fn phase_of_another_gait_is_refused() {
    let robot = robot(None);
    for controller in of_any_robot() {
        let gait = gait(controller, robot.hinges.len());
        let right = controller.compile(&Run::new(&robot, 0.5), &gait).unwrap().end_phase().clone();
        for length in (0..right.0.len()).chain([right.0.len() + 1]) {
            let mut bytes = right.0.clone();
            bytes.resize(length, 0);
            let phase = Phase(bytes);
            let refused = controller.compile(&Run { from: Some(&phase), ..Run::new(&robot, 0.5) }, &gait).unwrap_err();
            assert!(refused.to_string().contains("that of another gait"), "{}: {refused}", controller.name());
        }
    }
}
