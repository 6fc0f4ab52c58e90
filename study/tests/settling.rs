//! Tests of settling: a robot that can rest is accepted at every heading, and a robot that can't rest is refused.

use sim_core::base::math::{Pose, Vector, about_z};
use sim_core::base::random::{Purpose, Stream};
use sim_core::engines::{engine, engines_digest, settle_quietly};
use sim_core::exchange;
use sim_core::job::{JobSpec, Reference};
use sim_core::model::{Robot, RobotSpec};
use sim_core::physics::{EngineKind, JointKind, Motion, Physics, Scale, settle};
use sim_core::problem::Job;
use study::soundness::{random_arms, random_robot};

const HEADINGS: [f64; 4] = [0.0, 0.7, std::f64::consts::FRAC_PI_2, 2.0];
const ROBOTS: u32 = 6;

fn stream(index: u32) -> Stream {
    Stream::new(7, Purpose::Sample, index, 0, 0)
}

/// Returns the robot turned by `angle` (rad) about the vertical axis. In the neutral configuration all bodies share the
/// robot's orientation.
fn turned(robot: &Robot, angle: f64) -> Robot {
    let turn = about_z(angle);
    let mut robot = robot.clone();
    for body in &mut robot.bodies {
        let pose = Pose::from_parts(Vector::ZERO, turn);
        body.boxes.iter_mut().for_each(|part| part.pose = pose * part.pose);
        body.capsules.iter_mut().for_each(|part| part.ends = part.ends.map(|end| turn * end));
        body.center_of_mass = turn * body.center_of_mass;
        // R I Rᵀ: the columns of R I are R applied to those of I, which is symmetric.
        let columns = body.inertia.map(|row| (turn * Vector::from_array(row)).to_array());
        let rows = [0, 1, 2].map(|i| turn * Vector::new(columns[0][i], columns[1][i], columns[2][i]));
        body.inertia = rows.map(|row| row.to_array());
    }
    for hinge in &mut robot.hinges {
        hinge.anchor = turn * hinge.anchor;
        hinge.axis = turn * hinge.axis;
    }
    robot
}

/// Settles all robots at all headings. Returns the number of cases that needed a quiet setting.
fn settle_all(scale: Scale, robots: impl Iterator<Item = Robot>) -> usize {
    let physics = Physics::of_scale(scale);
    let mut quiet = 0;
    for (i, robot) in robots.enumerate() {
        for heading in HEADINGS {
            let settled = settle_quietly(EngineKind::Rapier, &turned(&robot, heading), &physics);
            let settled = settled.unwrap_or_else(|e| panic!("robot {i}, heading {heading}: {e}"));
            quiet += usize::from(settled.quiet.is_some());
        }
    }
    quiet
}

#[test]
fn random_robots_of_modules_settle_at_every_heading() {
    let robots = || (0..ROBOTS).map(|i| random_robot(&mut stream(i)));
    let quiet = [Scale::Paper, Scale::Real].map(|scale| settle_all(scale, robots()));
    assert!(quiet.iter().all(|&n| n > 0), "some robots of each scale must need a quiet setting: {quiet:?}");
}

#[test]
fn random_robots_of_boxes_settle_at_every_heading() {
    let robots = || (0..ROBOTS).map(|i| random_arms(&mut stream(i), false));
    let quiet = [Scale::Paper, Scale::Real].map(|scale| settle_all(scale, robots()));
    assert!(quiet.iter().all(|&n| n > 0), "some robots of each scale must need a quiet setting: {quiet:?}");
}

#[test]
fn random_robots_with_capsules_settle_at_every_heading() {
    let robots = || (0..ROBOTS).map(|i| random_arms(&mut stream(i), true));
    let quiet = [Scale::Paper, Scale::Real].map(|scale| settle_all(scale, robots()));
    assert!(quiet.iter().all(|&n| n > 0), "some robots of each scale must need a quiet setting: {quiet:?}");
}

#[test]
fn robot_settled_on_its_setting_keeps_its_start() {
    for entry in sim_core::model::catalogue::robots() {
        let robot = Robot::compile(&toml::from_str(entry.toml).unwrap()).unwrap();
        for kind in [EngineKind::Rapier, EngineKind::Lockstep] {
            let standing = Motion::standing(robot.hinges.len(), 1.0);
            if engine(kind).supports(&robot, &[], &standing).is_err() {
                continue;
            }
            let physics = Physics::of(kind, Scale::Paper);
            let settled = settle_quietly(kind, &robot, &physics).unwrap();
            assert_eq!(settled.quiet, None, "{}", entry.name);
            assert_eq!(Ok(settled.state), settle(engine(kind), &robot, &physics), "{}", entry.name);
        }
    }
}

#[test]
fn quiet_setting_keeps_physics_of_the_job() {
    let physics = Physics { friction: 0.5, ..Physics::of_scale(Scale::Paper) };
    for (capsules, kind, joints) in
        [(false, EngineKind::Lockstep, JointKind::Impulse), (true, EngineKind::Rapier, JointKind::Multibody)]
    {
        let trembling = (0..20)
            .map(|i| random_arms(&mut stream(i), capsules))
            .find_map(|robot| settle_quietly(EngineKind::Rapier, &robot, &physics).unwrap().quiet);
        let quiet = trembling.expect("one of 20 random robots must tremble");
        assert_eq!((quiet.engine, quiet.physics.joints), (kind, joints));
        let Physics { steps_per_second, substeps, joints, .. } = quiet.physics;
        assert_eq!(quiet.physics, Physics { steps_per_second, substeps, joints, ..physics });
        assert!(quiet.trembling >= 0.01 && quiet.to_string().contains("keeps trembling at"), "{quiet}");
    }
}

/// Mast with its mass beside its foot, so that it tips over.
const TIPPING: &str = r#"<mujoco model="mast"><worldbody><body name="root" pos="0 0 2"><freejoint/>
    <geom type="box" size="0.05 0.05 1" mass="0.1"/>
    <body name="a" pos="0.06 0 0.9"><joint name="j" axis="0 1 0" range="-90 90"/>
    <geom type="box" size="0.3 0.1 0.1" pos="0.35 0 0" mass="2"/></body></body></worldbody></mujoco>"#;

/// Returns a job of the robot with these entries of `physics`.
fn job(robot: RobotSpec, physics: &str) -> Result<Job, sim_core::base::error::Invalid> {
    let text = format!(
        "name = \"a\"\nrobot = \"lizard\"\nenvironment = \"empty\"\ngaits = {{ count = 1, duration = 1.0 }}\n\
         fitness = {{ kind = \"coverage\" }}\noptimiser = {{ kind = \"pso\" }}\nfinish = {{ kind = \"none\" }}\n\
         physics = {{ {physics} }}"
    );
    let spec: JobSpec = toml::from_str(&text).unwrap();
    Job::new(JobSpec { robot: Reference::Inline(Box::new(robot)), ..spec })
}

#[test]
fn moving_robot_is_refused_with_helpful_settings() {
    // Under so little gravity a mast takes longer to fall than settling lasts.
    for physics in ["gravity = 0.04", "gravity = 0.05", "gravity = 0.07"] {
        for engine in ["rapier", "lockstep"] {
            let physics = format!("engine = \"{engine}\", {physics}");
            let error =
                job(exchange::read(TIPPING).unwrap().robot, &physics).map(|_| ()).expect_err(&physics).to_string();
            assert!(error.starts_with("robot: the robot still moves at "), "{physics}: {error}");
            assert!(error.contains("physics.damping, physics.stiffness or physics.friction"), "{physics}: {error}");
        }
    }
    job(exchange::read(TIPPING).unwrap().robot, "").unwrap();
}

#[test]
fn job_settled_on_another_engine_needs_both_engines() {
    let trembling = r#"<mujoco model="m"><worldbody><body name="root" pos="0 0 .6"><freejoint/>
        <geom type="box" size=".4 .25 .2" mass="1"/>
        <body name="a" pos="0.45 0 0"><joint name="ja" axis="0 1 0" range="-90 90"/>
        <geom type="box" size=".3 .1 .1" pos="0.35 0 0" mass=".5"/></body>
        <body name="b" pos="-0.45 0 0"><joint name="jb" axis="0 1 0" range="-90 90"/>
        <geom type="box" size=".3 .1 .1" pos="-0.35 0 0" mass=".5"/></body></body></worldbody></mujoco>"#;
    let robot = exchange::read(trembling).unwrap().robot;
    let job = job(robot, "").unwrap();
    assert_eq!(job.chosen().engine, EngineKind::Rapier);
    assert_eq!(job.quiet().map(|quiet| quiet.engine), Some(EngineKind::Lockstep));
    assert_eq!(job.engine_digest(), engines_digest(EngineKind::Lockstep, EngineKind::Rapier));
    let again = Job::from_toml(&job.to_toml()).unwrap();
    assert_eq!((again.digest(), again.start(), again.quiet()), (job.digest(), job.start(), job.quiet()));
    // The job's own setting stays in the file.
    let physics = &job.spec().physics;
    assert_eq!((physics.steps_per_second, physics.substeps, physics.joints), (Some(30), Some(8), JointKind::Impulse));
}
