//! Tests of states with velocities, on both engines: free flight keeps its momenta, a continued rollout stays near the
//! unbroken one, and the same numbers give the same bits.

use sim_core::base::math::{Pose, Rotation, Vector, about, angle_between};
use sim_core::base::random::{Purpose, Stream};
use sim_core::engines::engine;
use sim_core::model::{Phase, Robot, RobotSpec, State, Twist, Velocities, catalogue};
use sim_core::physics::{EngineKind, JointKind, Motion, Outcome, Physics, Request, Rollout, Scale, TICK, Targets};

/// Both engines; rapier with both kinds of joints.
const ENGINES: [(EngineKind, JointKind); 3] = [
    (EngineKind::Rapier, JointKind::Impulse),
    (EngineKind::Rapier, JointKind::Multibody),
    (EngineKind::Lockstep, JointKind::Impulse),
];

/// Physics without gravity and motors.
fn free(kind: (EngineKind, JointKind)) -> Physics {
    Physics { gravity: 0.0, stiffness: 0.0, damping: 0.0, max_torque: 0.0, ..fine(kind) }
}

/// Physics with steps of 1/400 s, half a tick.
fn fine((engine, joints): (EngineKind, JointKind)) -> Physics {
    let substeps = if engine == EngineKind::Lockstep { 2 } else { 8 };
    Physics { steps_per_second: 400, substeps, joints, ..Physics::of_scale(Scale::Paper) }
}

fn run(
    (kind, _): (EngineKind, JointKind),
    robot: &Robot,
    physics: &Physics,
    start: &State,
    motion: &Motion,
) -> Rollout {
    engine(kind).run(robot, physics, &[], &[Request { start, motion }]).swap_remove(0)
}

fn compile(text: &str) -> Robot {
    Robot::compile(&toml::from_str::<RobotSpec>(text).unwrap()).unwrap()
}

/// A block and a rotor. The axis, x, goes through both centres of mass.
fn axle() -> Robot {
    compile(
        r#"
        name = "axle"
        pivot = "block"
        [[body]]
        name = "block"
        mass = 4.0
        inertia = [0.7, 0.9, 0.9, 0.0, 0.0, 0.0]
        [[body.box]]
        half = [0.5, 0.5, 0.5]
        [[body]]
        name = "rotor"
        hinge = { name = "axis", parent = "block", anchor = [0.8, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }
        mass = 1.0
        center_of_mass = [0.3, 0.0, 0.0]
        inertia = [0.1, 0.2, 0.2, 0.0, 0.0, 0.0]
        [[body.box]]
        center = [0.3, 0.0, 0.0]
        half = [0.2, 0.2, 0.2]
        "#,
    )
}

/// An asymmetric robot of three bodies. `center`: the pivot's centre of mass.
fn crooked(center: [f32; 3]) -> Robot {
    compile(&format!(
        r#"
        name = "crooked"
        pivot = "block"
        [[body]]
        name = "block"
        mass = 4.0
        center_of_mass = {center:?}
        inertia = [0.7, 0.9, 1.1, 0.1, 0.0, -0.1]
        [[body.box]]
        half = [0.5, 0.5, 0.5]
        [[body]]
        name = "arm"
        hinge = {{ name = "shoulder", parent = "block", anchor = [0.8, 0.2, 0.0], axis = [0.0, 0.6, 0.8] }}
        mass = 1.0
        center_of_mass = [0.5, 0.1, 0.0]
        inertia = [0.05, 0.2, 0.2, 0.0, 0.0, 0.0]
        [[body.box]]
        center = [0.5, 0.0, 0.0]
        half = [0.3, 0.1, 0.1]
        [[body]]
        name = "hand"
        hinge = {{ name = "wrist", parent = "arm", anchor = [1.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }}
        mass = 0.5
        center_of_mass = [0.3, 0.0, 0.1]
        inertia = [0.02, 0.05, 0.05, 0.0, 0.0, 0.0]
        [[body.box]]
        center = [0.3, 0.0, 0.0]
        half = [0.2, 0.1, 0.1]
        "#
    ))
}

/// The asymmetric robot for an engine. rapier moves the root of a multibody by the velocity of its centre of mass. So
/// with multibody joints the pivot's centre of mass is at its origin, as it is for all modules.
fn crooked_for((_, joints): (EngineKind, JointKind)) -> Robot {
    crooked(if joints == JointKind::Multibody { [0.0; 3] } else { [0.1, -0.2, 0.15] })
}

/// State high above the ground, turned and moving.
fn flying(robot: &Robot, seed: u64) -> State {
    let mut stream = Stream::new(seed, Purpose::Sample, 0, 0, 0);
    let mut draw = |spread: f64| stream.uniform(-spread, spread) as f32;
    let mut vector = |spread: f64| Vector::new(draw(spread), draw(spread), draw(spread));
    let turn = Rotation::from_xyzw(0.2, -0.4, 0.3, 0.8).normalize();
    let pose = Pose::from_parts(Vector::new(1.0, 2.0, 60.0), turn);
    let joints = (0..robot.hinges.len()).map(|_| vector(0.3).x).collect();
    let pivot = Twist { angular: vector(1.0), linear: vector(2.0) };
    let rates = (0..robot.hinges.len()).map(|_| vector(0.5).x).collect();
    State { velocities: Some(Velocities { pivot, rates }), ..State::new(pose, joints) }
}

/// Linear momentum, angular momentum about the centre of mass, and kinetic energy, summed over the bodies.
fn momenta(robot: &Robot, state: &State) -> (Vector, Vector, f32) {
    let poses = robot.body_poses(state);
    let twists = robot.body_twists(state, &poses).expect("the state must have velocities");
    let mass: f32 = robot.bodies.iter().map(|b| b.mass).sum();
    let centers: Vec<Vector> = robot.bodies.iter().zip(&poses).map(|(b, p)| *p * b.center_of_mass).collect();
    let center = robot.bodies.iter().zip(&centers).map(|(b, c)| *c * b.mass).sum::<Vector>() / mass;
    let (mut linear, mut angular, mut energy) = (Vector::ZERO, Vector::ZERO, 0.0);
    for (i, body) in robot.bodies.iter().enumerate() {
        let Twist { angular: turn, linear: origin } = twists[i];
        let velocity = origin + turn.cross(poses[i].rotation * body.center_of_mass);
        let own = poses[i].rotation.inverse() * turn;
        let [x, y, z] = body.inertia.map(|row| Vector::from_array(row).dot(own));
        let spin = poses[i].rotation * Vector::new(x, y, z);
        linear += velocity * body.mass;
        angular += spin + (centers[i] - center).cross(velocity * body.mass);
        energy += 0.5 * (body.mass * velocity.dot(velocity) + turn.dot(spin));
    }
    (linear, angular, energy)
}

/// No force acts on two bodies that spin about their common axis: p = p₀ + v t, R = R(ω t) R₀, θ = θ₀ + θ̇ t.
#[test]
fn spinning_free_flight_follows_the_closed_form() {
    let robot = axle();
    for kind in ENGINES {
        let mut start = flying(&robot, 1);
        let axis = start.pivot.rotation * Vector::X;
        let linear = Vector::new(0.5, -1.0, 2.0);
        start.joints = vec![0.3];
        start.velocities = Some(Velocities { pivot: Twist { angular: axis * 1.2, linear }, rates: vec![0.7] });
        let rollout = run(kind, &robot, &free(kind), &start, &Motion::standing(1, 1.0));
        assert_eq!(rollout.outcome, Outcome::Completed, "{kind:?}");
        let end = &rollout.end;
        let place = start.pivot.translation + linear;
        assert!((end.pivot.translation - place).length() < 2e-3, "{kind:?}: {} against {place}", end.pivot.translation);
        let turned = angle_between(end.pivot.rotation, about(axis, 1.2) * start.pivot.rotation);
        assert!(turned < 2e-3, "{kind:?}: rotation differs by {turned} rad");
        assert!((end.joints[0] - 1.0).abs() < 2e-3, "{kind:?}: {} rad", end.joints[0]);
        let moves = end.velocities.as_ref().expect("velocities at the end");
        assert!((moves.pivot.linear - linear).length() < 2e-3, "{kind:?}: {moves:?}");
        assert!((moves.pivot.angular - axis * 1.2).length() < 2e-3, "{kind:?}: {moves:?}");
        assert!((moves.rates[0] - 0.7).abs() < 2e-3, "{kind:?}: {moves:?}");
    }
}

/// For random velocities, momenta and energy at the end of a rollout are those of its start.
#[test]
fn free_flight_from_a_state_keeps_momenta_and_energy() {
    for kind in ENGINES {
        let robot = crooked_for(kind);
        for seed in 0..5 {
            let start = flying(&robot, seed);
            let rollout = run(kind, &robot, &free(kind), &start, &Motion::standing(2, 0.5));
            let ((p, l, e), (p1, l1, e1)) = (momenta(&robot, &start), momenta(&robot, &rollout.end));
            assert!((p1 - p).length() < 0.01 * p.length(), "{kind:?}: momentum {p}, then {p1}");
            assert!((l1 - l).length() < 0.02 * l.length(), "{kind:?}: angular momentum {l}, then {l1}");
            assert!((e1 - e).abs() < 0.02 * e, "{kind:?}: energy {e}, then {e1}");
        }
    }
}

/// The velocities at a rollout's end are the rates of change of its poses and angles.
#[test]
fn end_velocities_are_the_rates_of_the_last_step() {
    for kind in ENGINES {
        let (robot, physics) = (crooked_for(kind), free(kind));
        let before = run(kind, &robot, &physics, &flying(&robot, 3), &Motion::standing(2, 0.25)).end;
        let after = run(kind, &robot, &physics, &before, &Motion::standing(2, TICK)).end;
        let moves = before.velocities.as_ref().unwrap();
        let per_second = |difference: f32| difference / TICK as f32;
        let linear = (after.pivot.translation - before.pivot.translation) / TICK as f32;
        assert!((linear - moves.pivot.linear).length() < 0.05, "{kind:?}: {linear} against {moves:?}");
        let turn = after.pivot.rotation * before.pivot.rotation.inverse();
        let angular = Vector::new(turn.x, turn.y, turn.z) * 2.0 * turn.w.signum() / TICK as f32;
        assert!((angular - moves.pivot.angular).length() < 0.05, "{kind:?}: {angular} against {moves:?}");
        for i in 0..2 {
            let rate = per_second(after.joints[i] - before.joints[i]);
            assert!((rate - moves.rates[i]).abs() < 0.05, "{kind:?}: {rate} against {moves:?}");
        }
    }
}

fn waves(robot: &Robot, from: f64, duration: f64) -> Motion {
    let signal = |joint: usize| {
        let ticks = 0..Targets::ticks(duration);
        ticks.map(|t| 0.5 * libm::sin(3.0 * (from + TICK * t as f64) + joint as f64)).collect::<Vec<_>>()
    };
    Targets::new(&(0..robot.hinges.len()).map(signal).collect::<Vec<_>>(), duration).into()
}

#[test]
fn split_flight_stays_near_the_unbroken_one() {
    for kind in ENGINES {
        let (robot, physics) = (crooked_for(kind), fine(kind));
        let start = flying(&robot, 4);
        let whole = run(kind, &robot, &physics, &start, &waves(&robot, 0.0, 1.0)).end;
        let half = run(kind, &robot, &physics, &start, &waves(&robot, 0.0, 0.5)).end;
        let split = run(kind, &robot, &physics, &half, &waves(&robot, 0.5, 0.5)).end;
        let apart = (whole.pivot.translation - split.pivot.translation).length();
        let turned = angle_between(whole.pivot.rotation, split.pivot.rotation);
        let bent = whole.joints.iter().zip(&split.joints).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(apart < 0.01 && turned < 0.01 && bent < 0.01, "{kind:?}: {apart} mu, {turned} rad, {bent} rad");
        let ((p, l, e), (p1, l1, e1)) = (momenta(&robot, &whole), momenta(&robot, &split));
        assert!((p1 - p).length() < 0.01 * p.length(), "{kind:?}: momentum {p} and {p1}");
        assert!((l1 - l).length() < 0.02 * l.length(), "{kind:?}: angular momentum {l} and {l1}");
        assert!((e1 - e).abs() < 0.02 * e, "{kind:?}: energy {e} and {e1}");
    }
}

/// A state's velocities, base twist and joint rates, are lockstep's own coordinates, and its contacts have no memory.
/// So a continued rollout has the bits of the unbroken one, on the ground too.
#[test]
fn lockstep_continues_on_the_ground_with_the_same_bits() {
    let robot = compile(catalogue::robots()[0].toml);
    let kind = (EngineKind::Lockstep, JointKind::Impulse);
    // 128 and 2 are powers of two, so targets at a step are the same numbers in the halves and in the whole.
    let physics = Physics { steps_per_second: 128, substeps: 2, ..Physics::of_scale(Scale::Paper) };
    let held = |value: f64, duration: f64| {
        let signals = vec![vec![value; Targets::ticks(duration)]; robot.hinges.len()];
        Motion::from(Targets::new(&signals, duration))
    };
    let start = robot.neutral();
    let whole = run(kind, &robot, &physics, &start, &held(0.6, 1.0)).end;
    let half = run(kind, &robot, &physics, &start, &held(0.6, 0.5)).end;
    assert!(
        half.velocities.as_ref().unwrap().rates.iter().any(|rate| rate.abs() > 1e-3),
        "the robot must move: {half:?}"
    );
    assert_eq!(format!("{:?}", run(kind, &robot, &physics, &half, &held(0.6, 0.5)).end), format!("{whole:?}"));
}

#[test]
fn state_continues_with_same_bits_in_every_batch() {
    for kind in ENGINES {
        let (robot, physics) = (crooked_for(kind), fine(kind));
        let motion = waves(&robot, 0.0, 0.5);
        let states: Vec<State> = (0..5).map(|seed| flying(&robot, seed)).collect();
        let first = run(kind, &robot, &physics, &states[0], &motion).end;
        let alone = run(kind, &robot, &physics, &first, &motion);
        let starts = [&states[1], &first, &states[2], &states[3], &first, &states[4]];
        let requests = starts.map(|start| Request { start, motion: &motion });
        let together = engine(kind.0).run(&robot, &physics, &[], &requests);
        for i in [1, 4] {
            assert_eq!(format!("{:?}", together[i]), format!("{alone:?}"), "{kind:?}");
        }
    }
}

#[test]
fn zero_velocities_are_the_same_as_rest() {
    for kind in ENGINES {
        let (robot, physics) = (crooked_for(kind), fine(kind));
        let rest = flying(&robot, 2).at_rest();
        assert_eq!(rest.velocities, None);
        let still = Twist { angular: Vector::ZERO, linear: Vector::ZERO };
        let zero = State { velocities: Some(Velocities { pivot: still, rates: vec![0.0; 2] }), ..rest.clone() };
        let motion = waves(&robot, 0.0, 0.5);
        let ends = [&rest, &zero].map(|start| format!("{:?}", run(kind, &robot, &physics, start, &motion)));
        assert_eq!(ends[0], ends[1], "{kind:?}");
    }
}

#[test]
fn completed_rollout_ends_in_the_phase_of_its_motion() {
    for kind in ENGINES {
        let robot = crooked_for(kind);
        let motion = Motion::standing(2, 0.05).with_end_phase(Phase(vec![1, 2, 3]));
        let end = run(kind, &robot, &fine(kind), &flying(&robot, 0), &motion).end;
        assert_eq!(end.phase, Phase(vec![1, 2, 3]), "{kind:?}");
        assert_eq!(end.at_rest().phase, Phase::default());
    }
}
