//! Tests of MJCF and URDF: a robot that is written and read again is the same, and unsupported content is refused by
//! name.

use proptest::prelude::*;
use sim_core::base::error::Invalid;
use sim_core::base::math::{Vector, angle_between};
use sim_core::engines::engine;
use sim_core::exchange::{self, Format};
use sim_core::job::{JobSpec, Reference};
use sim_core::model::{HingeSpec, QUARTER_TURNS, Robot, RobotSpec, catalogue};
use sim_core::physics::{EngineKind, Motion, Outcome, Physics, Request, Scale, Targets, settle};
use sim_core::problem::Job;

/// Reads a robot and drops the notes of the import.
fn read(text: &str) -> Result<RobotSpec, Invalid> {
    Ok(exchange::read(text)?.robot)
}

fn physics() -> Physics {
    Physics::of_scale(Scale::Paper)
}

/// Every shipped robot of boxes: its variant E2, with two failed modules, and the whole robot.
fn robots() -> Vec<(RobotSpec, Robot)> {
    let of_boxes = catalogue::robots().iter().filter(|entry| entry.toml.contains("[variants]"));
    let specs = of_boxes.flat_map(|entry| {
        let spec: RobotSpec = toml::from_str(entry.toml).unwrap();
        [spec.variant("E2").unwrap(), spec]
    });
    specs.map(|spec| (Robot::compile(&spec).unwrap(), spec)).map(|(robot, spec)| (spec, robot)).collect()
}

fn through(format: Format, robot: &Robot) -> Robot {
    let text = format.write(robot, &physics()).unwrap();
    let spec = read(&text).unwrap_or_else(|e| panic!("{}: {e}\n{text}", robot.name));
    let written: RobotSpec = toml::from_str(&toml::to_string(&spec).unwrap()).unwrap();
    assert_eq!(written, spec, "a robot file must hold the whole robot");
    Robot::compile(&written).unwrap_or_else(|e| panic!("{}: {e}", robot.name))
}

fn assert_near(a: &Robot, b: &Robot, tolerance: f32) {
    let near = |x: Vector, y: Vector| (x - y).length() <= tolerance;
    assert_eq!(a.name, b.name);
    assert_eq!(a.joint_names(), b.joint_names());
    assert_eq!(a.bodies.len(), b.bodies.len());
    for (x, y) in a.hinges.iter().zip(&b.hinges) {
        assert_eq!(x.parent, y.parent, "{} {}", a.name, x.name);
        assert!(near(x.anchor, y.anchor) && near(x.axis, y.axis), "{} {}", a.name, x.name);
    }
    for (x, y) in a.bodies.iter().zip(&b.bodies) {
        let what = format!("{} {}", a.name, x.name);
        assert_eq!(x.name, y.name, "{what}");
        assert!((x.mass - y.mass).abs() <= tolerance && near(x.center_of_mass, y.center_of_mass), "{what}");
        let moments = x.inertia.iter().flatten().zip(y.inertia.iter().flatten());
        assert!(moments.clone().all(|(m, n)| (m - n).abs() <= tolerance), "{what}");
        assert_eq!((x.boxes.len(), x.capsules.len()), (y.boxes.len(), y.capsules.len()), "{what}");
        for (p, q) in x.boxes.iter().zip(&y.boxes) {
            assert!(near(p.half, q.half) && near(p.pose.translation, q.pose.translation), "{what}");
            assert!(angle_between(p.pose.rotation, q.pose.rotation) <= tolerance, "{what}");
        }
        for (p, q) in x.capsules.iter().zip(&y.capsules) {
            let ([a, b], [c, d]) = (p.ends, q.ends);
            assert!((p.radius - q.radius).abs() <= tolerance, "{what}");
            assert!((near(a, c) && near(b, d)) || (near(a, d) && near(b, c)), "{what}");
        }
    }
}

#[test]
fn mjcf_round_trip_keeps_robot_and_motion() {
    for (_, robot) in robots() {
        let again = through(Format::Mjcf, &robot);
        assert_near(&robot, &again, 0.0);
        let rapier = engine(EngineKind::Rapier);
        let start = settle(rapier, &robot, &physics()).unwrap();
        assert_eq!(settle(rapier, &again, &physics()).unwrap(), start);
        let wave = |joint: usize| (0..=400).map(|t| libm::sin(0.01 * f64::from(t) + joint as f64)).collect();
        let motion = Motion::from(Targets::new(&(0..robot.hinges.len()).map(wave).collect::<Vec<_>>(), 2.0));
        let request = Request { start: &start, motion: &motion };
        let run = |robot: &Robot| rapier.run(robot, &physics(), &[], &[request]).swap_remove(0);
        assert_eq!(run(&robot), run(&again), "{}", robot.name);
    }
}

#[test]
fn urdf_round_trip_keeps_robot_up_to_rounding() {
    for (_, robot) in robots() {
        assert_near(&robot, &through(Format::Urdf, &robot), 1e-6);
    }
}

/// A stuck hinge joins two bodies into one. It has the mass, inertia and shapes of the body that a failed module makes.
#[test]
fn stuck_hinge_joins_bodies_like_a_failed_module() {
    for (spec, damaged) in robots().into_iter().filter(|(spec, _)| !spec.failed.is_empty()) {
        let healthy = Robot::compile(&RobotSpec { failed: Vec::new(), ..spec.clone() }).unwrap();
        let imported = read(&Format::Mjcf.write(&healthy, &physics()).unwrap()).unwrap();
        let stuck = Robot::compile(&RobotSpec { failed: spec.failed.clone(), ..imported }).unwrap();
        assert_eq!(stuck.joint_names(), damaged.joint_names());
        for (a, b) in stuck.bodies.iter().zip(&damaged.bodies) {
            assert!((a.mass - b.mass).abs() < 1e-6 && (a.center_of_mass - b.center_of_mass).length() < 1e-6);
            let moments = a.inertia.iter().flatten().zip(b.inertia.iter().flatten());
            assert!(moments.clone().all(|(m, n)| (m - n).abs() < 1e-5), "{} {}", spec.name, b.name);
        }
        let at_rest = damaged.neutral();
        let ((low, high), (low_b, high_b)) = (stuck.bounds(&stuck.neutral()), damaged.bounds(&at_rest));
        assert!((low - low_b).length() + (high - high_b).length() < 1e-5, "{}", spec.name);
    }
}

/// The expected values are those of MuJoCo 4.0.1 for the same file. The file has defaults, all notations of
/// orientations, welded bodies, density and capsules.
#[test]
fn oracle_file_is_read_as_mujoco_reads_it() {
    let robot = Robot::compile(&read(include_str!("oracle.xml")).unwrap()).unwrap();
    let close = |a: &[f32], b: &[f32]| {
        a.len() == b.len() && a.iter().zip(b).all(|(x, y)| (x - y).abs() < 2e-6 * y.abs().max(1.0))
    };
    // Name, mass, centre of mass, inertia (xx, yy, zz, xy, xz, yz), all along the axes of the world.
    let bodies: [(&str, f32, [f32; 3], [f32; 6]); 4] = [
        ("torso", 40.4, [0.0, 0.0, 0.0148515], [0.8331724, 1.4794224, 1.6735833, 0.0, -0.0108253, 0.0]),
        (
            "head",
            0.7,
            [0.0563397, -0.02, 0.1175833],
            [0.0238494, 0.0263125, 0.0398381, -0.0047635, 0.001348, 0.0011765],
        ),
        ("leg", 9.11921, [0.0, 0.3, -0.1], [0.2828637, 0.0913741, 0.2349913, 0.0, 0.0, 0.0957448]),
        (
            "foot",
            4.088259,
            [0.0, 0.1414214, 0.1414214],
            [0.0625953, 0.0225457, 0.0551922, -0.007542, -0.0034715, -0.0190668],
        ),
    ];
    assert_eq!(robot.bodies.iter().map(|b| b.name.as_str()).collect::<Vec<_>>(), bodies.map(|b| b.0));
    for (body, (name, mass, center, inertia)) in robot.bodies.iter().zip(bodies) {
        let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] = body.inertia;
        assert!(close(&[body.mass], &[mass]), "{name}: {}", body.mass);
        assert!(close(&body.center_of_mass.to_array(), &center), "{name}: {:?}", body.center_of_mass);
        assert!(close(&[xx, yy, zz, xy, xz, yz], &inertia), "{name}: {:?}", body.inertia);
    }
    let hinges: [(&str, [f32; 3], [f32; 3]); 3] = [
        ("neck", [0.2, 0.0, 0.6464102], [0.0, -1.0, 0.0]),
        ("hip", [0.0, 0.4, 0.0], [-1.0, 0.0, 0.0]),
        ("ankle", [0.0, 0.6, -0.2], [-std::f32::consts::FRAC_1_SQRT_2, 0.5, -0.5]),
    ];
    for (hinge, (name, anchor, axis)) in robot.hinges.iter().zip(hinges) {
        assert_eq!(hinge.name, name);
        assert!(close(&hinge.anchor.to_array(), &anchor), "{name}: {:?}", hinge.anchor);
        assert!(close(&hinge.axis.to_array(), &axis), "{name}: {:?}", hinge.axis);
    }
    // The second box is welded to the first and stands on it.
    let mast = &robot.bodies[0].boxes[1].pose;
    assert!(close(&mast.translation.to_array(), &[0.0, 0.0, 0.3]));
    assert!(close(&(mast.rotation * Vector::Z).to_array(), &[0.5, 0.0, 0.8660254]));
    let head = &robot.bodies[1].boxes[0].pose;
    assert!(close(&head.translation.to_array(), &[0.0066987, 0.0, 0.1116025]));
    assert!(close(&(head.rotation * Vector::Y).to_array(), &[0.5, 0.0, 0.8660254]));
    let [low, high] = robot.bodies[3].capsules[0].ends;
    assert!(close(&low.to_array(), &[-0.0244764, 0.0069894, 0.0795428]), "{low}");
    assert!(close(&high.to_array(), &[0.0244764, 0.2758533, 0.2032999]), "{high}");
    assert_near(&robot, &through(Format::Mjcf, &robot), 1e-7);
    assert_near(&robot, &through(Format::Urdf, &robot), 2e-6);
}

/// Three capsules in a row along x, radius 0.1 mu, from −1.6 to 1.6.
const WORM: &str = r#"
    <robot name="worm">
      <link name="middle">
        <inertial><mass value="1"/><inertia ixx="0.01" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
        <collision>
          <origin rpy="0 1.5707963267948966 0"/>
          <geometry><capsule radius="0.1" length="0.8"/></geometry>
        </collision>
      </link>
      <link name="left">
        <inertial>
          <origin xyz="-0.5 0 0"/><mass value="1"/><inertia ixx="0.01" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
        </inertial>
        <collision>
          <origin xyz="-0.55 0 0" rpy="0 1.5707963267948966 0"/>
          <geometry><capsule radius="0.1" length="0.8"/></geometry>
        </collision>
      </link>
      <link name="right">
        <inertial>
          <origin xyz="0.5 0 0"/><mass value="1"/><inertia ixx="0.01" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
        </inertial>
        <collision>
          <origin xyz="0.55 0 0" rpy="0 1.5707963267948966 0"/>
          <geometry><capsule radius="0.1" length="0.8"/></geometry>
        </collision>
      </link>
      <joint name="one" type="revolute">
        <parent link="middle"/><child link="left"/><origin xyz="-0.55 0 0"/><axis xyz="0 0 1"/>
        <limit lower="-1.5707964" upper="1.5707964" effort="60" velocity="10"/>
      </joint>
      <joint name="two" type="revolute">
        <parent link="middle"/><child link="right"/><origin xyz="0.55 0 0"/><axis xyz="0 0 1"/>
        <limit lower="-1.5707964" upper="1.5707964" effort="60" velocity="10"/>
      </joint>
    </robot>"#;

#[test]
fn robot_of_capsules_rests_at_their_radius() {
    let robot = Robot::compile(&read(WORM).unwrap()).unwrap();
    let (low, high) = robot.bounds(&robot.neutral());
    assert!((low - Vector::new(-1.6, -0.1, 0.0)).length() < 1e-5, "{low}");
    assert!((high - Vector::new(1.6, 0.1, 0.2)).length() < 1e-5, "{high}");
    let rapier = engine(EngineKind::Rapier);
    let start = settle(rapier, &robot, &physics()).unwrap();
    assert!((start.pivot.translation.z - 0.1).abs() < 2e-3, "{}", start.pivot.translation.z);
    let motion = Motion::from(Targets::new(&[vec![0.8; 401], vec![-0.8; 401]], 2.0));
    let rollout = rapier.run(&robot, &physics(), &[], &[Request { start: &start, motion: &motion }]).swap_remove(0);
    assert_eq!(rollout.outcome, Outcome::Completed);
    assert!((rollout.end.joints[0] - 0.8).abs() < 0.05 && (rollout.end.joints[1] + 0.8).abs() < 0.05);
}

/// The tip of the last capsule is 1.6 mu from the robot's middle. The block's face is placed just beyond the tip, or
/// just before it.
#[test]
fn capsule_touches_an_obstacle_at_its_round_end() {
    let job = |face: f64| {
        let block = format!("center = [{}, 0.0], size = [1.0, 1.0], top = 1.0", face + 0.5);
        let text = format!(
            r#"
            name = "a"
            robot = "lizard"
            gaits = {{ count = 1 }}
            fitness = {{ kind = "coverage" }}
            optimiser = {{ kind = "pso" }}
            [environment]
            name = "e"
            size = [20.0, 20.0]
            start = {{ x = 0.0, y = 0.0 }}
            obstacle = [{{ {block} }}]
            "#
        );
        let mut spec: JobSpec = toml::from_str(&text).unwrap();
        spec.robot = Reference::Inline(Box::new(read(WORM).unwrap()));
        Job::new(spec)
    };
    let free = job(1.61).unwrap();
    assert!(job(1.59).unwrap_err().to_string().contains("obstacle"));
    assert!(job(-1.59 - 1.0).unwrap_err().to_string().contains("obstacle"));
    let again = Job::from_toml(&free.to_toml()).unwrap();
    assert_eq!(again.digest(), free.digest(), "a resolved job must contain the whole robot");
    assert!(free.to_toml().contains("[[robot.body.capsule]]"));
}

/// A root with a second body that contains `more`. `sections` come before the world.
fn mjcf(more: &str, sections: &str) -> String {
    format!(
        r#"<mujoco><compiler angle="radian"/>{sections}<worldbody>
        <body name="a"><freejoint/><geom type="box" size=".1 .1 .1"/>
        <body name="b" pos=".5 0 0">{more}</body></body></worldbody></mujoco>"#
    )
}

const HINGE: &str = r#"<joint name="j" axis="0 0 1" range="-1.5708 1.5708"/>"#;
const GEOM: &str = r#"<geom type="box" size=".1 .1 .1"/>"#;

#[test]
fn unsupported_content_is_refused_by_line_and_reason() {
    let sound = format!("{HINGE}{GEOM}");
    Robot::compile(&read(&mjcf(&sound, "")).unwrap()).unwrap();
    let in_body = |more: &str| mjcf(more, "");
    let joint = |attributes: &str| in_body(&format!("<joint name=\"j\" {attributes}/>{GEOM}"));
    let limited = |attributes: &str| joint(&format!("axis=\"0 0 1\" range=\"-1.5708 1.5708\" {attributes}"));
    let geom = |attributes: &str| in_body(&format!("{HINGE}<geom {attributes}/>"));
    let section = |section: &str| mjcf(&sound, section);
    let urdf = |from: &str, to: &str| WORM.replacen(from, to, 1);
    let cases = [
        ("no XML", "<mujoco>".to_owned()),
        ("no robot", "<sdf/>".to_owned()),
        ("a type of document", "<!DOCTYPE a [<!ENTITY b \"c\">]><mujoco/>".to_owned()),
        ("nothing in it", "<mujoco/>".to_owned()),
        ("a fixed root", in_body(&sound).replace("<freejoint/>", "")),
        ("a slide", joint("type=\"slide\"")),
        ("a ball", joint("type=\"ball\"")),
        ("several joints", in_body(&format!("{HINGE}{HINGE}{GEOM}"))),
        ("no limits", joint("axis=\"0 0 1\"")),
        ("other limits", joint("range=\"-1 1\"")),
        ("limits in degrees", joint("range=\"-90 90\"")),
        ("a spring", limited("stiffness=\"2\"")),
        ("a damper", limited("damping=\"0.1 0\"")),
        ("a rotor", limited("armature=\"0.01\"")),
        ("another zero", limited("ref=\"0.2\"")),
        ("no number", limited("ref=\"x\"")),
        ("too few numbers", joint("axis=\"0 1\" range=\"-1.5708 1.5708\"")),
        ("a mesh", geom("type=\"mesh\" mesh=\"m\"")),
        ("a sphere", geom("size=\"0.1\"")),
        ("a height field", geom("type=\"hfield\"")),
        ("contacts with some", geom("type=\"box\" size=\".1 .1 .1\" contype=\"2\"")),
        ("an unknown class", geom("class=\"c\" type=\"box\" size=\".1 .1 .1\"")),
        ("no mass", in_body(HINGE)),
        ("several parts", section("<include file=\"x.xml\"/>")),
        ("a loop", section("<equality><connect body1=\"a\" body2=\"b\"/></equality>")),
        ("a tendon", section("<tendon><spatial name=\"t\"/></tendon>")),
        ("an unknown section", section("<deformables/>")),
        ("something soft", section("<deformable><flex/></deformable>")),
        ("a composite", in_body(&format!("{sound}<composite/>"))),
        ("an obstacle", section("<worldbody><geom name=\"wall\" type=\"box\" size=\"1 1 1\"/></worldbody>")),
        ("a slope", section("<worldbody><geom type=\"plane\" euler=\"0.1 0 0\"/></worldbody>")),
        ("a passive joint", section("<actuator><motor joint=\"k\"/></actuator>")),
        ("another order of angles", section("<compiler eulerseq=\"zyx\"/>")),
        ("deep nesting", format!("<mujoco>{}{}</mujoco>", "<a>".repeat(500), "</a>".repeat(500))),
        ("URDF: a wheel", urdf("type=\"revolute\"", "type=\"continuous\"")),
        ("URDF: other limits", urdf("upper=\"1.5707964\"", "upper=\"0.5\"")),
        ("URDF: a mimic", urdf("<axis", "<mimic joint=\"two\"/><axis")),
        ("URDF: friction", urdf("<axis", "<dynamics friction=\"0.5\"/><axis")),
        ("URDF: a mesh", urdf("<capsule radius=\"0.1\" length=\"0.8\"/>", "<mesh filename=\"a.stl\"/>")),
        ("URDF: a loop", urdf("<child link=\"right\"/>", "<child link=\"left\"/>")),
        (
            "URDF: a closed chain",
            urdf("<parent link=\"middle\"/>", "<parent link=\"right\"/>").replacen(
                "<parent link=\"middle\"/>",
                "<parent link=\"left\"/>",
                1,
            ),
        ),
        ("URDF: a lost link", urdf("<child link=\"right\"/>", "<child link=\"tail\"/>")),
        ("URDF: no mass", urdf("<mass value=\"1\"/>", "<mass value=\"0\"/>")),
        ("URDF: a negative mass", urdf("<mass value=\"1\"/>", "<mass value=\"-1\"/>")),
    ];
    let told: Vec<String> = cases.iter().map(|(what, text)| format!("{what}: {}", read(text).unwrap_err())).collect();
    insta::assert_snapshot!(told.join("\n"));
}

/// A robot with own limits, speed and torque for its second joint.
fn own_joint(limits: Option<[f64; 2]>) -> RobotSpec {
    let mut spec = read(WORM).unwrap();
    let hinge = spec.bodies[2].hinge.as_mut().unwrap();
    (hinge.limits, hinge.speed, hinge.torque) = (limits, Some(2.5), Some(7.0));
    spec
}

#[test]
fn exported_joints_have_own_or_job_limits() {
    let spec = own_joint(Some([-0.25, 0.5]));
    assert_eq!(toml::from_str::<RobotSpec>(&toml::to_string(&spec).unwrap()).unwrap(), spec);
    let robot = Robot::compile(&spec).unwrap();
    let most = physics().max_torque;
    let mjcf = Format::Mjcf.write(&robot, &physics()).unwrap();
    for part in [
        "range=\"-0.25 0.5\"",
        "ctrlrange=\"-0.25 0.5\"",
        "forcerange=\"-7 7\"",
        &format!("forcerange=\"-{most} {most}\""),
    ] {
        assert_eq!(mjcf.matches(&format!(" {part}")).count(), 1, "{part}\n{mjcf}");
    }
    let urdf = Format::Urdf.write(&robot, &physics()).unwrap();
    for part in
        ["lower=\"-0.25\" upper=\"0.5\" effort=\"7\" velocity=\"2.5\"", &format!("effort=\"{most}\" velocity=\"1000\"")]
    {
        assert_eq!(urdf.matches(part).count(), 1, "{part}\n{urdf}");
    }
    for text in [&mjcf, &urdf] {
        let refused = read(text).unwrap_err().to_string();
        assert!(refused.contains("only joints from -90° to 90° are allowed"), "{refused}");
    }
    // Efforts and speeds are not imported: the robot that is read back has those of the job.
    let plain = Robot::compile(&own_joint(None)).unwrap();
    for format in [Format::Mjcf, Format::Urdf] {
        let again = through(format, &plain);
        assert!(again.hinges.iter().all(|h| h.limits == QUARTER_TURNS && h.speed.is_none() && h.torque.is_none()));
    }
}

#[test]
fn mechanics_digest_depends_on_joint_limits() {
    let mechanics = |spec: &RobotSpec| Robot::compile(spec).unwrap().mechanics();
    let plain = read(WORM).unwrap();
    let own = own_joint(Some([-0.25, 0.5]));
    assert_ne!(mechanics(&plain), mechanics(&own));
    assert_ne!(mechanics(&own_joint(None)), mechanics(&own));
    let mut written = plain.clone();
    written.bodies[1].hinge.as_mut().unwrap().limits = Some(QUARTER_TURNS.map(f64::from));
    assert_eq!(mechanics(&plain), mechanics(&written), "explicit default limits must not change the digest");
}

#[test]
fn invalid_joints_are_refused_by_field() {
    let refused = |change: fn(&mut HingeSpec)| {
        let mut spec = read(WORM).unwrap();
        change(spec.bodies[1].hinge.as_mut().unwrap());
        Robot::compile(&spec).unwrap_err().to_string()
    };
    for (error, expected) in [
        (refused(|h| h.limits = Some([0.1, 0.5])), "robot.body[1].hinge.limits[0] = 0.1"),
        (refused(|h| h.limits = Some([-0.5, 3.5])), "robot.body[1].hinge.limits[1] = 3.5"),
        (refused(|h| h.limits = Some([0.0, 0.0])), "list the hinge in `failed` if it is stuck"),
        (refused(|h| h.speed = Some(0.0)), "robot.body[1].hinge.speed = 0"),
        (refused(|h| h.torque = Some(-1.0)), "robot.body[1].hinge.torque = -1"),
    ] {
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn invalid_bodies_are_refused_by_field() {
    let sound = read(WORM).unwrap();
    let change = |change: fn(&mut RobotSpec)| {
        let mut spec = sound.clone();
        change(&mut spec);
        Robot::compile(&spec).unwrap_err().to_string()
    };
    let told = [
        change(|s| s.bodies[1].name = "middle".into()),
        change(|s| s.bodies[1].name = "left hip".into()),
        change(|s| s.bodies[1].mass = 0.0),
        change(|s| s.bodies[1].mass = f64::NAN),
        change(|s| s.bodies[1].inertia = [1.0, 1.0, 3.0, 0.0, 0.0, 0.0]),
        change(|s| s.bodies[1].inertia = [1.0, 1.0, 1.0, 2.0, 0.0, 0.0]),
        change(|s| s.bodies[1].capsules[0].radius = -1.0),
        change(|s| s.bodies[1].capsules[0].to = s.bodies[1].capsules[0].from),
        change(|s| s.bodies[1].hinge.as_mut().unwrap().axis = [0.0; 3]),
        change(|s| s.bodies[1].hinge.as_mut().unwrap().parent = "tail".into()),
        change(|s| s.bodies[1].hinge.as_mut().unwrap().parent = "left".into()),
        change(|s| s.bodies[1].hinge.as_mut().unwrap().name = "two".into()),
        change(|s| s.bodies[1].hinge = None),
        change(|s| s.pivot = "left".into()),
        change(|s| s.failed = vec!["three".into()]),
        change(|s| s.failed = vec!["one".into(), "two".into()]),
        change(|s| s.bodies[1].hinge.as_mut().unwrap().anchor = [0.95, 0.1, 0.0]),
        change(|s| s.bodies = vec![s.bodies[0].clone(); 65]),
    ];
    insta::assert_snapshot!(told.join("\n"));
}

proptest! {
    /// Reading a damaged file gives a robot or an error.
    #[test]
    fn damaged_files_never_cause_a_panic(
        cuts in proptest::collection::vec((0usize..20_000, 0usize..40, "[-0-9a-z<>/\"= .]{0,6}"), 1..6),
        which in 0usize..4,
    ) {
        let lizard = Robot::compile(&toml::from_str(catalogue::robots()[1].toml).unwrap()).unwrap();
        let mut text = match which {
            0 => Format::Mjcf.write(&lizard, &physics()).unwrap(),
            1 => Format::Urdf.write(&lizard, &physics()).unwrap(),
            2 => include_str!("oracle.xml").to_owned(),
            _ => WORM.to_owned(),
        };
        for (at, length, new) in cuts {
            let at = at % text.len();
            text.replace_range(at..(at + length).min(text.len()), &new);
        }
        if let Ok(spec) = read(&text) {
            let _ = Robot::compile(&spec);
        }
    }
}
