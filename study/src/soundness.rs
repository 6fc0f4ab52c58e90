//! Soundness of engines: random robots execute random gaits from random starts, and an observer checks the rollouts
//! that an engine returns. The engine must have reported every rollout that leaves a bound as unstable.
//!
//! The observer uses only the configurations of the trace. From them it computes, in f64, the positions of the centres
//! of mass, their speeds between samples, and kinetic and potential energy. The work of a motor is at most its greatest
//! torque times the angle that its joint turned through in the trace.

use rapier3d::parry::query::intersection_test;
use rapier3d::parry::shape::Cuboid;
use serde::Serialize;
use sim_core::base::math::{Pose, Rotation, Vector};
use sim_core::base::random::{Purpose, Stream};
use sim_core::control::{Controller, Hopf, Run};
use sim_core::exchange;
use sim_core::model::{Robot, RobotSpec, State};
use sim_core::physics::{Bound, Motion, Outcome, Physics, Rollout};
use std::collections::BTreeMap;

/// Least and greatest number of hinges of a random robot.
pub const HINGES: (u32, u32) = (4, 16);
/// Greatest angle of a joint at a random start, rad.
const SPREAD: f64 = 1.0;
/// Greatest height of the lowest point at a random start, mu.
const HEIGHT: f64 = 1.0;
/// Tolerance of the energy balance, as the height in mu to which this energy lifts the robot. Samples are 0.05 s apart,
/// so the angles that joints turn through between samples are underestimated.
const UNEXPLAINED: f64 = 0.5;
/// Factor on the motors' greatest work in the trace, which makes up for the underestimated angles.
const UNDERRATED: f64 = 1.5;

/// Returns a random tree of [`HINGES`] CoSMO modules, which are connected at random faces with random turns and do not
/// overlap.
pub fn random_robot(stream: &mut Stream) -> Robot {
    const FACES: [&str; 10] =
        ["back", "front", "a-left", "a-right", "a-top", "a-bottom", "b-left", "b-right", "b-top", "b-bottom"];
    let mut pick = |n: u32| (stream.unit() * f64::from(n)) as u32;
    let count = HINGES.0 + pick(HINGES.1 - HINGES.0 + 1);
    let module = |i: u32, attach: &str| format!("[[module]]\nname = \"m{i}\"\nkind = \"cosmo\"\n{attach}");
    let mut text = format!("name = \"random\"\npivot = \"m0\"\n{}", module(0, ""));
    let mut robot = None;
    let mut made = 1;
    while made < count {
        let (to, face, turn) = (pick(made), FACES[pick(10) as usize], 90 * pick(4));
        let attach = format!("attach = {{ to = \"m{to}\", port = \"{face}\", turn = {turn} }}\n");
        let longer = text.clone() + &module(made, &attach);
        // A module that does not fit is tried elsewhere. The ends of the tree always have room.
        let spec: RobotSpec = toml::from_str(&longer).expect("a generated robot must be valid");
        if let Ok(compiled) = Robot::compile(&spec) {
            (text, robot) = (longer, Some(compiled));
            made += 1;
        }
    }
    robot.expect("a random robot must have at least 4 modules")
}

/// Returns a random box with one to four hinged arms 0.3 to 1 mu long: capsules if `capsules` is true, else boxes.
pub fn random_arms(stream: &mut Stream, capsules: bool) -> Robot {
    let half = [stream.uniform(0.2, 0.5), stream.uniform(0.2, 0.5), stream.uniform(0.1, 0.3)];
    let mut arms = String::new();
    for i in 0..1 + stream.below(4) as usize {
        let (length, width) = (stream.uniform(0.15, 0.5), stream.uniform(0.05, 0.15));
        let (along, sign) = (i / 2, if i % 2 == 0 { 1.0 } else { -1.0 });
        let on_axis = |offset: f64| (0..3).map(move |a| if a == along { sign * offset } else { 0.0 });
        let text = |numbers: Vec<f64>| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
        let axis = ["0 1 0", "0 0 1", "1 0 0"][stream.below(3) as usize];
        let sides = (0..3).map(|a| if a == along { length } else { width }).collect();
        let geom = if capsules {
            format!("type=\"capsule\" size=\"{width}\" fromto=\"0 0 0 {}\"", text(on_axis(2.0 * length).collect()))
        } else {
            format!("type=\"box\" size=\"{}\" pos=\"{}\"", text(sides), text(on_axis(length).collect()))
        };
        let at = text(on_axis(half[along] + 0.02).collect());
        arms += &format!(
            "<body name=\"b{i}\" pos=\"{at}\"><joint name=\"j{i}\" axis=\"{axis}\" range=\"-90 90\"/>\
             <geom {geom} mass=\"{}\"/></body>",
            stream.uniform(0.2, 1.0)
        );
    }
    let [x, y, z] = half;
    let root = format!("<freejoint/><geom type=\"box\" size=\"{x} {y} {z}\" mass=\"1\"/>{arms}");
    let xml = format!("<mujoco><worldbody><body name=\"root\" pos=\"0 0 1\">{root}</body></worldbody></mujoco>");
    let spec = exchange::read(&xml).expect("a generated robot must be valid").robot;
    Robot::compile(&spec).expect("the arms of a generated robot must not overlap")
}

/// Returns a random gait of `duration` s, uniform in the bounds of the Hopf controller.
pub fn random_gait(robot: &Robot, duration: f64, stream: &mut Stream) -> Motion {
    let joints = robot.hinges.len();
    let gait: Vec<f64> = (0..joints)
        .flat_map(|_| Hopf.parameters())
        .map(|parameter| stream.uniform(parameter.bounds.0, parameter.bounds.1))
        .collect();
    Hopf.compile(&Run::new(robot, duration), &gait)
        .expect("the Hopf controller must accept all parameters within its bounds")
}

/// Returns a random start: any orientation, joint angles within ± 1 rad, no overlapping bodies, and the lowest point 0
/// to 1 mu above the ground.
pub fn random_start(robot: &Robot, stream: &mut Stream) -> State {
    let mut state = robot.neutral();
    let mut spread = SPREAD;
    loop {
        for joint in &mut state.joints {
            *joint = stream.uniform(-spread, spread) as f32;
        }
        if !overlaps(robot, &state) {
            break;
        }
        // The neutral configuration does not overlap.
        spread *= 0.8;
    }
    let [x, y, z, w] = [0; 4].map(|_| stream.uniform(-1.0, 1.0) as f32);
    let rotation = Rotation::from_xyzw(x, y, z, w);
    let rotation = if rotation.length() > 1e-3 { rotation.normalize() } else { Rotation::IDENTITY };
    state.pivot = Pose::from_parts(Vector::ZERO, rotation);
    let poses = robot.body_poses(&state);
    let bottoms = robot.bodies.iter().zip(&poses).flat_map(|(body, pose)| {
        body.boxes.iter().map(move |part| {
            let at = *pose * part.pose;
            let down = at.rotation.inverse() * Vector::Z;
            at.translation.z - down.abs().dot(part.half)
        })
    });
    let lowest = bottoms.fold(f32::MAX, f32::min);
    state.pivot.translation.z = stream.uniform(0.0, HEIGHT) as f32 - lowest;
    state
}

/// Returns true if boxes of any two bodies that do not share a hinge overlap.
fn overlaps(robot: &Robot, state: &State) -> bool {
    let poses = robot.body_poses(state);
    let joined = |a: usize, b: usize| robot.hinges[b - 1].parent == a;
    (1..robot.bodies.len()).any(|b| {
        (0..b).filter(|&a| !joined(a, b)).any(|a| {
            robot.bodies[a].boxes.iter().any(|p| {
                robot.bodies[b].boxes.iter().any(|q| {
                    let (at, other) = (poses[a] * p.pose, poses[b] * q.pose);
                    intersection_test(&at, &Cuboid::new(p.half), &other, &Cuboid::new(q.half))
                        .is_ok_and(|found| found.intersecting)
                })
            })
        })
    })
}

/// Returns the first bound that a rollout's trace leaves, and its time in s. If the engine ended the rollout early,
/// only the trace before that time is checked.
pub fn observe(robot: &Robot, physics: &Physics, start: &State, rollout: &Rollout) -> Option<(f32, Bound)> {
    let until = match rollout.outcome {
        Outcome::Completed => f32::INFINITY,
        Outcome::Unstable { time, .. } | Outcome::Refused { time, .. } => time,
    };
    let mass: f64 = robot.bodies.iter().map(|b| f64::from(b.mass)).sum();
    let gravity = f64::from(physics.gravity);
    let centers = |state: &State| -> Vec<[f64; 3]> {
        let poses = robot.body_poses(state);
        let center = |(pose, body): (&Pose, &sim_core::model::Body)| {
            let at = *pose * body.center_of_mass;
            [at.x, at.y, at.z].map(f64::from)
        };
        poses.iter().zip(&robot.bodies).map(center).collect()
    };
    let height = |at: &[[f64; 3]]| -> f64 { at.iter().zip(&robot.bodies).map(|(p, b)| p[2] * f64::from(b.mass)).sum() };
    let first = height(&centers(start));
    let mut driven = 0.0;
    let mut before: Option<(f32, State, Vec<[f64; 3]>)> = None;
    for i in (0..rollout.trace.len()).take_while(|&i| rollout.trace.time(i) < until) {
        let (time, state) = (rollout.trace.time(i), rollout.trace.state(i));
        let at = centers(&state);
        let numbers = at.iter().flatten().copied().chain(state.joints.iter().map(|&a| f64::from(a)));
        if !numbers.into_iter().all(f64::is_finite) {
            return Some((time, Bound::Finite));
        }
        if at.iter().any(|p| p[2] < -f64::from(Bound::DEPTH)) {
            return Some((time, Bound::Penetration));
        }
        if let Some((earlier, old, places)) = &before {
            let dt = f64::from(time - earlier);
            let square = |x: f64| x * x;
            let speeds = at.iter().zip(places).map(|(p, q)| (0..3).map(|k| square((p[k] - q[k]) / dt)).sum::<f64>());
            let speeds: Vec<f64> = speeds.collect();
            // The bound is on the speed of bodies' origins, and these are speeds of centres of mass: allow twice the
            // bound.
            if speeds.iter().any(|square| square.sqrt() > 2.0 * f64::from(Bound::SPEED)) {
                return Some((time, Bound::Speed));
            }
            let turned = robot.hinges.iter().zip(state.joints.iter().zip(&old.joints));
            driven += turned
                .map(|(hinge, (a, b))| f64::from(hinge.torque_or(physics.max_torque)) * f64::from((a - b).abs()))
                .sum::<f64>();
            let kinetic: f64 = speeds.iter().zip(&robot.bodies).map(|(s, b)| 0.5 * f64::from(b.mass) * s).sum();
            if kinetic > f64::from(Bound::ENERGY) * mass {
                return Some((time, Bound::Energy));
            }
            let gained = kinetic + gravity * (height(&at) - first);
            let given = UNDERRATED * driven;
            if gained > given + UNEXPLAINED * mass * gravity {
                return Some((time, Bound::Work));
            }
        }
        before = Some((time, state, at));
    }
    None
}

/// Results over many rollouts.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Soundness {
    /// Number of rollouts.
    pub rollouts: u64,
    /// Simulated time, s.
    pub simulated: f64,
    /// Number of rollouts that the engine reported as unstable, by the bound that they left.
    pub reported: BTreeMap<String, u64>,
    /// Number of rollouts in which the observer found a bound left that the engine had not reported by then.
    pub unreported: BTreeMap<String, u64>,
}

impl Soundness {
    /// Adds a rollout and the observer's result ([`observe`]).
    pub fn note(&mut self, rollout: &Rollout, seen: Option<(f32, Bound)>) {
        let count = |counts: &mut BTreeMap<String, u64>, bound: Bound| {
            *counts.entry(format!("{bound:?}").to_lowercase()).or_default() += 1;
        };
        self.rollouts += 1;
        self.simulated += rollout.simulated_ms as f64 / 1000.0;
        if let Outcome::Unstable { bound, .. } = rollout.outcome {
            count(&mut self.reported, bound);
        }
        if let Some((_, bound)) = seen {
            count(&mut self.unreported, bound);
        }
    }

    /// Adds the results over other rollouts.
    pub fn add(&mut self, other: &Soundness) {
        self.rollouts += other.rollouts;
        self.simulated += other.simulated;
        for (mine, theirs) in [(&mut self.reported, &other.reported), (&mut self.unreported, &other.unreported)] {
            for (bound, count) in theirs {
                *mine.entry(bound.clone()).or_default() += count;
            }
        }
    }
}

/// Simulates and observes `rollouts` random rollouts of `duration` s of one random robot. The seed and index define the
/// robot, its starts and gaits.
pub fn of_robot(
    engine: &dyn sim_core::physics::Engine,
    physics: &Physics,
    (seed, index): (u64, u32),
    rollouts: u32,
    duration: f64,
) -> Soundness {
    let stream = |which: u32| Stream::new(seed, Purpose::Sample, index, which, 2);
    let robot = random_robot(&mut stream(0));
    let drawn: Vec<(State, Motion)> = (1..=rollouts)
        .map(|which| {
            let mut stream = stream(which);
            (random_start(&robot, &mut stream), random_gait(&robot, duration, &mut stream))
        })
        .collect();
    let requests: Vec<_> = drawn.iter().map(|(start, motion)| sim_core::physics::Request { start, motion }).collect();
    let mut found = Soundness::default();
    for (rollout, (start, _)) in engine.run(&robot, physics, &[], &requests).iter().zip(&drawn) {
        found.note(rollout, observe(&robot, physics, start, rollout));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use sim_core::physics::lockstep::LockstepEngine;
    use sim_core::physics::{Effort, Scale, Span, Trace};

    fn physics() -> Physics {
        Physics { steps_per_second: 200, substeps: 2, ..Physics::of_scale(Scale::Paper) }
    }

    #[test]
    fn random_robots_start_clear_of_ground_and_themselves() {
        let mut counts = std::collections::BTreeSet::new();
        for index in 0..20 {
            let mut stream = Stream::new(1, Purpose::Sample, index, 0, 2);
            let robot = random_robot(&mut stream);
            counts.insert(robot.hinges.len());
            let start = random_start(&robot, &mut stream);
            assert!(!overlaps(&robot, &start));
            for (body, pose) in robot.bodies.iter().zip(robot.body_poses(&start)) {
                for part in &body.boxes {
                    for corner in [-1.0, 1.0].map(|x| Vector::new(x, 1.0, 1.0)).into_iter().chain([Vector::NEG_ONE]) {
                        assert!((pose * part.pose * (part.half * corner)).z > -1e-4);
                    }
                }
            }
        }
        assert!(counts.iter().all(|c| (4..=16).contains(c)) && counts.len() > 5, "{counts:?}");
    }

    #[test]
    fn lockstep_reports_every_bound_that_is_left() {
        let mut found = Soundness::default();
        for index in 0..12 {
            found.add(&of_robot(&LockstepEngine, &physics(), (2, index), 16, 1.0));
        }
        assert_eq!(found.rollouts, 192);
        assert!(found.simulated > 150.0, "{found:?}");
        assert_eq!(found.unreported, BTreeMap::new(), "{found:?}");
    }

    /// Returns a rollout with a pivot at the given heights (mu), 0.05 s apart.
    fn made_up(robot: &Robot, heights: &[f32]) -> Rollout {
        let mut trace = Trace::new(robot.hinges.len());
        let mut state = robot.neutral();
        for (i, height) in heights.iter().enumerate() {
            state.pivot.translation.z = *height;
            trace.push(0.05 * i as f32, &state);
        }
        let swept: Vec<Span> = Vec::new();
        Rollout {
            end: state,
            end_speed: 0.0,
            trace,
            swept,
            outcome: Outcome::Completed,
            simulated_ms: 1000,
            effort: Effort::default(),
        }
    }

    #[test]
    fn observer_detects_impossible_rollouts() {
        let robot = random_robot(&mut Stream::new(1, Purpose::Sample, 0, 0, 2));
        let mut start = robot.neutral();
        start.pivot.translation.z = 5.0;
        let seen = |heights: &[f32]| observe(&robot, &physics(), &start, &made_up(&robot, heights)).map(|s| s.1);
        assert_eq!(seen(&[5.0, 4.99, 4.95]), None);
        assert_eq!(seen(&[5.0, f32::NAN]), Some(Bound::Finite));
        assert_eq!(seen(&[5.0, 40.0]), Some(Bound::Speed));
        assert_eq!(seen(&[5.0, -3.0]), Some(Bound::Penetration));
        assert_eq!(
            seen(&[5.0, 5.1, 5.5]),
            Some(Bound::Work),
            "a robot that rises while no joint turns must leave the bound of work"
        );
    }

    #[test]
    fn results_are_counted_by_bound() {
        let robot = random_robot(&mut Stream::new(1, Purpose::Sample, 0, 0, 2));
        let mut rollout = made_up(&robot, &[5.0]);
        let mut found = Soundness::default();
        found.note(&rollout, None);
        rollout.outcome = Outcome::Unstable { time: 0.5, bound: Bound::Work };
        found.note(&rollout, Some((0.3, Bound::Speed)));
        let mut twice = found.clone();
        twice.add(&found);
        assert_eq!((twice.rollouts, twice.simulated), (4, 4.0));
        assert_eq!(twice.reported, BTreeMap::from([("work".to_owned(), 2)]));
        assert_eq!(twice.unreported, BTreeMap::from([("speed".to_owned(), 2)]));
    }
}
