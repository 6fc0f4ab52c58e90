//! Tests of events on both engines: a failed joint keeps its angle and changes no momentum, and an event that the
//! engine does not support ends the rollout at its time.

use sim_core::base::math::{Pose, Vector};
use sim_core::engines::engine;
use sim_core::model::{Connection, Face, Robot, State, Twist, Velocities, catalogue};
use sim_core::physics::{
    Change, EngineKind, Event, JointKind, Motion, Outcome, Physics, Request, Rollout, Scale, TICK, Targets, Unsupported,
};

/// Both engines; rapier with both kinds of joints.
const ENGINES: [(EngineKind, JointKind); 3] = [
    (EngineKind::Rapier, JointKind::Impulse),
    (EngineKind::Rapier, JointKind::Multibody),
    (EngineKind::Lockstep, JointKind::Impulse),
];

const FACES: [Face; 2] = [Face { module: 0, face: 1 }, Face { module: 2, face: 0 }];

fn robot() -> Robot {
    Robot::compile(&toml::from_str(catalogue::robots()[0].toml).unwrap()).unwrap()
}

fn physics((_, joints): (EngineKind, JointKind)) -> Physics {
    Physics { steps_per_second: 200, substeps: 4, joints, ..Physics::of_scale(Scale::Paper) }
}

fn run(kind: (EngineKind, JointKind), robot: &Robot, start: &State, motion: &Motion) -> Rollout {
    engine(kind.0).run(robot, &physics(kind), &[], &[Request { start, motion }]).swap_remove(0)
}

/// Motion of all joints along sines of amplitude 0.6 rad.
fn waves(robot: &Robot, duration: f64) -> Motion {
    let ticks = Targets::ticks(duration);
    let signal = |joint: usize| (0..ticks).map(|t| 0.6 * libm::sin(0.03 * t as f64 + joint as f64)).collect();
    Targets::new(&(0..robot.hinges.len()).map(signal).collect::<Vec<Vec<f64>>>(), duration).into()
}

fn fail(tick: u32, joint: usize) -> Event {
    Event { tick, change: Change::Fail { joint } }
}

#[test]
fn failed_joint_keeps_its_angle() {
    let robot = robot();
    let start = robot.neutral();
    for kind in ENGINES {
        // rapier holds a joint by impulses, so the joint moves by about 0.01 rad.
        let tolerance = if kind.0 == EngineKind::Lockstep { 0.0 } else { 0.02 };
        let rollout = run(kind, &robot, &start, &waves(&robot, 2.0).with_events(vec![fail(100, 1)]));
        assert_eq!(rollout.outcome, Outcome::Completed, "{kind:?}");
        let at = |time: f32| (0..rollout.trace.len()).find(|&i| rollout.trace.time(i) >= time).unwrap();
        let stuck = rollout.trace.joints(at(0.5))[1];
        for i in at(0.5)..rollout.trace.len() {
            let angle = rollout.trace.joints(i)[1];
            assert!((angle - stuck).abs() <= tolerance, "{kind:?}: {angle} rad, stuck at {stuck} rad");
        }
        let sound = run(kind, &robot, &start, &waves(&robot, 2.0));
        let others = |r: &Rollout, from: f32| {
            (at(from)..r.trace.len()).map(|i| r.trace.joints(i)[2]).fold(0.0, |most: f32, a| most.max(a.abs()))
        };
        assert!(others(&rollout, 0.5) > 0.3, "{kind:?}: the other joints must move");
        let spread = (at(0.5)..sound.trace.len()).map(|i| (sound.trace.joints(i)[1] - stuck).abs()).fold(0.0, f32::max);
        assert!(spread > 0.3, "{kind:?}: without the failure the joint must move");
    }
}

#[test]
fn rollout_before_a_failure_equals_one_without_failure() {
    let robot = robot();
    let start = robot.neutral();
    for kind in ENGINES {
        let sound = run(kind, &robot, &start, &waves(&robot, 1.0));
        let failing = run(kind, &robot, &start, &waves(&robot, 1.0).with_events(vec![fail(100, 1)]));
        for i in (0..sound.trace.len()).take_while(|&i| sound.trace.time(i) <= 0.5) {
            assert_eq!(sound.trace.state(i), failing.trace.state(i), "{kind:?}: sample {i}");
        }
        assert_ne!(sound.end, failing.end, "{kind:?}");
    }
}

#[test]
fn failure_in_one_rollout_changes_no_bit_of_another() {
    let robot = robot();
    let start = robot.neutral();
    for kind in ENGINES {
        let motions =
            [waves(&robot, 1.0), waves(&robot, 1.0).with_events(vec![fail(50, 3), fail(120, 0)]), waves(&robot, 1.0)];
        let requests = motions.each_ref().map(|motion| Request { start: &start, motion });
        let together = engine(kind.0).run(&robot, &physics(kind), &[], &requests);
        for (motion, rollout) in motions.iter().zip(&together) {
            assert_eq!(&run(kind, &robot, &start, motion), rollout, "{kind:?}");
        }
    }
}

/// The forces that lock a joint are internal, so the robot's momentum does not change.
#[test]
fn failure_in_flight_changes_no_momentum() {
    let robot = robot();
    let mut start = robot.neutral();
    start.pivot.translation.z = 60.0;
    let linear = Vector::new(1.0, -2.0, 0.5);
    let pivot = Twist { angular: Vector::ZERO, linear };
    start.velocities = Some(Velocities { pivot, rates: vec![0.0; robot.hinges.len()] });
    let center = |state: &State| {
        let poses = robot.body_poses(state);
        let sum: Vector = robot.bodies.iter().zip(&poses).map(|(b, pose)| *pose * b.center_of_mass * b.mass).sum();
        sum / robot.bodies.iter().map(|b| b.mass).sum::<f32>()
    };
    for kind in ENGINES {
        let weightless = Physics { gravity: 0.0, ..physics(kind) };
        let motion = waves(&robot, 1.0).with_events(vec![fail(60, 0), fail(100, 2)]);
        let request = Request { start: &start, motion: &motion };
        let end = engine(kind.0).run(&robot, &weightless, &[], &[request]).swap_remove(0).end;
        let moved = center(&end) - center(&start);
        assert!((moved - linear).length() < 0.03, "{kind:?}: {moved} against {linear}");
    }
}

#[test]
fn unsupported_event_ends_the_rollout_as_refused() {
    let robot = robot();
    let start = robot.neutral();
    let changes = [
        Change::Connect { faces: FACES },
        Change::Disconnect { faces: FACES },
        Change::Place { module: 1, pose: Pose::IDENTITY },
        Change::Replace { module: 1 },
    ];
    for kind in ENGINES {
        for change in changes {
            let reason = Unsupported::Event(change.name());
            // Tick 81 is at 0.405 s and tick 80 at 0.4 s. A step of 5 ms begins at each tick.
            let motion = waves(&robot, 1.0).with_events(vec![Event { tick: 81, change }, fail(20, 1)]);
            assert_eq!(engine(kind.0).supports(&robot, &[], &motion), Err(reason), "{kind:?}");
            let rollout = run(kind, &robot, &start, &motion);
            let Outcome::Refused { time, event, reason: given } = rollout.outcome else {
                panic!("{kind:?}: {}", rollout.outcome)
            };
            assert_eq!((time, event, given), (0.405, Some(1), reason), "{kind:?}");
            assert_eq!(rollout.simulated_ms, 405);
            let last = rollout.trace.len() - 1;
            assert_eq!(rollout.trace.time(last), 0.405);
            assert_eq!(rollout.trace.state(last), rollout.end.clone().at_rest());
            assert_eq!(rollout.swept[rollout.swept.len() - 1].last, last);
            let shorter = run(kind, &robot, &start, &waves(&robot, 0.405).with_events(vec![fail(20, 1)]));
            assert_eq!(
                shorter.end.joints, rollout.end.joints,
                "{kind:?}: everything before the event must be simulated"
            );
            assert_eq!(shorter.end.pivot, rollout.end.pivot, "{kind:?}");
            assert!(rollout.outcome.to_string().contains(change.name()), "{}", rollout.outcome);
        }
    }
}

/// At 200 steps per second tick 0 is step 0. At 30 steps per second the first step at or after tick 7 (0.035 s) begins
/// at 2/30 s.
#[test]
fn event_acts_at_its_tick_or_next_step() {
    let (robot, kind) = (robot(), ENGINES[0]);
    let start = robot.neutral();
    let change = Change::Disconnect { faces: FACES };
    for (rate, tick, steps) in [(200, 0, 0), (200, 7, 7), (30, 7, 2), (30, 20, 3), (30, 0, 0), (400, 3, 6)] {
        let physics = Physics { steps_per_second: rate, ..physics(kind) };
        let motion = waves(&robot, 0.5).with_events(vec![Event { tick, change }]);
        let request = Request { start: &start, motion: &motion };
        let outcome = engine(kind.0).run(&robot, &physics, &[], &[request]).swap_remove(0).outcome;
        let Outcome::Refused { time, .. } = outcome else { panic!("{outcome}") };
        assert_eq!(
            time,
            steps as f32 / rate as f32,
            "tick {tick} at {rate} steps a second, {} s",
            f64::from(tick) * TICK
        );
    }
}

#[test]
fn failure_of_a_missing_joint_is_refused() {
    let robot = robot();
    let joints = robot.hinges.len();
    let reason = Unsupported::Joint { joint: joints, joints };
    for kind in ENGINES {
        let motion = waves(&robot, 0.2).with_events(vec![fail(10, joints)]);
        assert_eq!(engine(kind.0).supports(&robot, &[], &motion), Err(reason));
        let outcome = run(kind, &robot, &robot.neutral(), &motion).outcome;
        assert!(matches!(outcome, Outcome::Refused { event: Some(0), reason: r, .. } if r == reason), "{outcome}");
        let working = waves(&robot, 0.2).with_events(vec![fail(10, joints - 1)]);
        assert_eq!(engine(kind.0).supports(&robot, &[], &working), Ok(()));
    }
}

#[test]
fn start_with_connections_is_refused_at_time_zero() {
    let robot = robot();
    let connection = Connection { faces: FACES, relative: Pose::IDENTITY };
    let start = State { connections: vec![connection], ..robot.neutral() };
    for kind in ENGINES {
        let rollout = run(kind, &robot, &start, &waves(&robot, 0.2));
        let reason = Unsupported::Connections;
        assert_eq!(rollout.outcome, Outcome::Refused { time: 0.0, event: None, reason }, "{kind:?}");
        assert_eq!((rollout.trace.len(), rollout.simulated_ms), (1, 0));
        assert_eq!(rollout.end.connections, start.connections);
    }
}

#[test]
fn lockstep_refuses_capsules_at_the_start() {
    let mut robot = robot();
    let capsule = sim_core::model::CollisionCapsule { ends: [Vector::ZERO, Vector::X], radius: 0.1 };
    robot.bodies[1].capsules.push(capsule);
    let (motion, start) = (waves(&robot, 0.2), robot.neutral());
    let lockstep = ENGINES[2];
    assert_eq!(engine(lockstep.0).supports(&robot, &[], &motion), Err(Unsupported::Capsules));
    let rollout = run(lockstep, &robot, &start, &motion);
    let reason = Unsupported::Capsules;
    assert_eq!(rollout.outcome, Outcome::Refused { time: 0.0, event: None, reason });
    assert_eq!(rollout.end, start);
}
