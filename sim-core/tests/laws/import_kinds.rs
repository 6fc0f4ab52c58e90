//! Tests of imports that must not be silently wrong: every kind of fault that was seen in robot files, with variations.

use sim_core::exchange::{Import, read};
use sim_core::model::{Robot, RobotSpec};

/// A torso with two arms, after replacing text by `changes`. Marks to replace: `%top` before the worldbody, `%world` in
/// it, `%j` in the first arm's joint, `%a` in its geom, `%end` after the worldbody.
pub fn mjcf(changes: &[(&str, &str)]) -> String {
    let mut text = r#"<mujoco model="m">%top
<worldbody><geom type="plane" size="5 5 .1"/>%world
<body name="root" pos="0 0 .6"><freejoint/>
<geom name="t" type="box" size=".4 .25 .2" mass="1"/>
<body name="a" pos=".45 0 0"><joint name="ja" axis="0 1 0" range="-90 90"%j/>
<geom type="box" size=".3 .1 .1" pos=".35 0 0" mass=".5"%a/></body>
<body name="b" pos="-.45 0 0"><joint name="jb" axis="0 1 0" range="-90 90"/>
<geom type="box" size=".3 .1 .1" pos="-.35 0 0" mass=".5"/></body>
</body></worldbody>%end</mujoco>"#
        .to_owned();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replacen(from, to, 1);
    }
    ["%top", "%world", "%j", "%a", "%end"].iter().fold(text, |text, mark| text.replace(mark, ""))
}

/// Two links and a joint, after replacing text by `changes`.
pub fn urdf(changes: &[(&str, &str)]) -> String {
    let mut text = r#"<?xml version="1.0"?>
<robot name="r">
<link name="b"><inertial><mass value="1"/><inertia ixx=".02" iyy=".03" izz=".04" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size=".6 .3 .2"/></geometry></collision></link>
<link name="c"><inertial><origin xyz=".35 0 0"/><mass value=".5"/>
<inertia ixx=".02" iyy=".03" izz=".04" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz=".35 0 0"/><geometry><box size=".6 .2 .2"/></geometry></collision></link>
<joint name="j" type="revolute"><parent link="b"/><child link="c"/><origin xyz=".8 0 0" rpy="0 0 0"/>
<axis xyz="0 1 0"/><limit lower="-1.5708" upper="1.5708" effort="10" velocity="3"/></joint>
</robot>"#
        .to_owned();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replacen(from, to, 1);
    }
    text
}

pub fn robot(text: &str) -> RobotSpec {
    read(text).unwrap_or_else(|e| panic!("{e}\n{text}")).robot
}

/// Asserts that every change is refused with an error that has the line and contains the words.
fn refused(base: fn(&[(&str, &str)]) -> String, cases: &[(&str, &str, u32, &str)]) {
    read(&base(&[])).unwrap();
    for (from, to, line, words) in cases {
        let said = read(&base(&[(from, to)])).map(|_| ()).unwrap_err().to_string();
        assert!(said.contains(&format!("line {line}, <")), "{to}: {said}");
        assert!(said.contains(words), "{to}: {said}");
    }
}

/// Asserts that no change alters the robot, apart from names.
fn same(base: fn(&[(&str, &str)]) -> String, cases: &[(&str, &str)]) {
    let expected = Robot::compile(&robot(&base(&[]))).unwrap().mechanics();
    for (from, to) in cases {
        let found = Robot::compile(&robot(&base(&[(from, to)]))).unwrap().mechanics();
        assert_eq!(found, expected, "{to}");
    }
}

#[test]
fn own_orientation_overrides_class_in_every_notation() {
    let spellings = [
        ("quat", "0.9659258262890683 0 0 0.25881904510252074"),
        ("euler", "0 0 30"),
        ("axisangle", "0 0 1 30"),
        ("xyaxes", "0.8660254037844387 0.5 0 -0.5 0.8660254037844387 0"),
        ("zaxis", "0 0 1"),
    ];
    let turned = |own: &str| {
        let spec = robot(&mjcf(&[("%a", own)]));
        spec.bodies[1].boxes[0].rotation
    };
    for (class, other) in spellings {
        let default = format!("<default><default class=\"c\"><geom {class}=\"{other}\"/></default></default>");
        for (own, value) in spellings {
            let text = mjcf(&[("%top", &default), ("%a", &format!(" class=\"c\" {own}=\"{value}\""))]);
            let found = robot(&text).bodies[1].boxes[0].rotation;
            let expected = turned(&format!(" {own}=\"{value}\""));
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{class} {own}: {found:?}");
        }
        let text = mjcf(&[("%top", &default), ("%a", " class=\"c\"")]);
        let expected = turned(&format!(" {class}=\"{other}\""));
        assert_eq!(robot(&text).bodies[1].boxes[0].rotation, expected, "{class} of the class");
    }
    let line = "<default><default class=\"c\"><geom fromto=\"0 0 0 .6 0 0\" euler=\"10 20 30\"/></default></default>";
    let capsule = |own: &str| {
        let geom = format!("<geom type=\"capsule\" size=\".1\" mass=\".5\" {own}/>");
        mjcf(&[("%top", line), ("<geom type=\"box\" size=\".3 .1 .1\" pos=\".35 0 0\" mass=\".5\"%a/>", &geom)])
    };
    assert_eq!(robot(&capsule("class=\"c\"")), robot(&capsule("fromto=\"0 0 0 .6 0 0\"")));
    let both = read(&capsule("class=\"c\" pos=\"1 0 0\"")).unwrap_err().to_string();
    assert!(both.contains("both pos and fromto"), "{both}");
    let twice = read(&mjcf(&[("%a", " euler=\"0 0 30\" quat=\"1 0 0 0\"")])).unwrap_err().to_string();
    assert!(twice.contains("line 6, <geom>: both quat and euler"), "{twice}");
}

#[test]
fn unknown_content_is_refused_with_its_line() {
    refused(
        mjcf,
        &[
            (" mass=\".5\"%a", " masss=\".5\"", 6, "mass may be meant"),
            ("%a", " dammping=\"1\"", 6, "no attribute of <geom>"),
            ("%a/>", "><mass>3</mass></geom>", 6, "no content is allowed"),
            ("%j/>", ">0 1 0</joint>", 5, "the text \"0 1 0\""),
            ("%j", " rnage=\"0 1\"", 5, "range may be meant"),
            ("<geom name=\"t\"", "<gem name=\"t\"", 4, "<geom> may be meant"),
            ("%top", "<optoin/>", 1, "<option> may be meant"),
            ("%top", "<compiler angel=\"radian\"/>", 1, "angle may be meant"),
            ("%top", "<compiler angle=\"radians\"/>", 1, "allowed are degree, radian"),
            ("%top", "<option><flag contacts=\"disable\"/></option>", 1, "contact may be meant"),
            ("%top", "<default><geom name=\"g\"/></default>", 1, "name is no attribute"),
            ("%j", " limited=\"yes\"", 5, "allowed are true, false, auto"),
            (
                "<freejoint/>",
                "<freejoint/><inertial pos=\"0 0 0\" mass=\"1\"/>",
                3,
                "it needs fullinertia or diaginertia",
            ),
        ],
    );
    refused(
        urdf,
        &[
            ("<axis xyz=\"0 1 0\"/>", "<axis><xyz>0 0 1</xyz></axis>", 9, "<xyz>"),
            ("</joint>", "<dynamics><damping>100</damping></dynamics></joint>", 9, "<damping>"),
            ("<origin xyz=\".35 0 0\"/><mass", "<orgin xyz=\".35 0 0\"/><mass", 5, "<origin> may be meant"),
            ("rpy=", "ryp=", 8, "rpy may be meant"),
            ("<axis", "<axsi", 9, "<axis> may be meant"),
            ("ixx=", "ixxx=", 3, "ixx may be meant"),
            ("value=\"1\"", "valu=\"1\"", 3, "value may be meant"),
            ("size=\".6 .3 .2\"", "sizes=\".6 .3 .2\"", 4, "size may be meant"),
            ("lower=", "low=", 9, "low is no attribute"),
            ("<joint name", "<jont/><joint name", 8, "<joint> may be meant"),
            ("<child link", "<child lnk", 8, "link may be meant"),
            ("</robot>", "<robot/></robot>", 10, "this element can't be imported"),
        ],
    );
}

#[test]
fn second_shapes_and_repeated_elements_are_refused() {
    refused(
        urdf,
        &[
            ("<box size=\".6 .3 .2\"/>", "<box size=\".6 .3 .2\"/><box size=\"1 1 1\"/>", 4, "a second shape"),
            ("<box size=\".6 .3 .2\"/>", "<box size=\".6 .3 .2\"/><sphere radius=\"1\"/>", 4, "only box and capsule"),
            ("<mass value=\"1\"/>", "<mass value=\"1\"/><mass value=\"2\"/>", 3, "a second <mass>"),
            ("<axis xyz=\"0 1 0\"/>", "<axis xyz=\"0 1 0\"/><axis xyz=\"1 0 0\"/>", 9, "a second <axis>"),
            ("<parent link=\"b\"/>", "<parent link=\"b\"/><parent link=\"c\"/>", 8, "a second <parent>"),
        ],
    );
    // A link with several shapes has several <collision> elements.
    let two = "<collision><geometry><box size=\".1 .1 .1\"/></geometry></collision></link>\n<link name=\"c\">";
    assert_eq!(robot(&urdf(&[("</link>\n<link name=\"c\">", two)])).bodies[0].boxes.len(), 2);
    let inertial = "<inertial pos=\"0 0 0\" mass=\"1\" diaginertia=\"1 1 1\"/>";
    refused(mjcf, &[("<freejoint/>", &format!("<freejoint/>{inertial}{inertial}"), 3, "a second <inertial>")]);
}

#[test]
fn unsupported_physics_is_refused() {
    refused(
        mjcf,
        &[
            ("%j", " springdamper=\"0.2 1\"", 5, "springdamper"),
            ("%j", " stiffness=\"1\"", 5, "stiffness"),
            ("%top", "<default><joint springdamper=\"1 1\"/></default>", 5, "springdamper"),
            ("<freejoint/>", "<joint type=\"free\" damping=\"1\"/>", 3, "damping"),
            ("%a", " condim=\"1\"", 6, "friction of a job"),
            ("%top", "<default><geom condim=\"1\"/></default>", 6, "friction of a job"),
            ("%top", "<option density=\"1000\"/>", 1, "no fluid"),
            ("%top", "<option viscosity=\"0.1\"/>", 1, "no fluid"),
            ("%top", "<option gravity=\"0 9.81 0\"/>", 1, "only downwards"),
            ("%top", "<option><flag contact=\"disable\"/></option>", 1, "touch the ground"),
            ("%top", "<option><flag gravity=\"disable\"/></option>", 1, "weight"),
            ("%top", "<option><flag actuation=\"disable\"/></option>", 1, "motors"),
            ("%end", SERVOS_NARROW, 9, "-17.2° to 17.2°"),
            (
                "%end",
                "<actuator><position joint=\"ja\" gear=\"2\" ctrlrange=\"-1.5708 1.5708\"/></actuator>",
                9,
                "-45.0°",
            ),
            ("%end", "<actuator><position joint=\"ja\" inheritrange=\"0.5\"/></actuator>", 9, "-45.0° to 45.0°"),
            ("%end", "<actuator><general joint=\"ja\" biastype=\"affine\" ctrlrange=\"0 1\"/></actuator>", 9, "0.0°"),
            ("%end", "<actuator><muscle joint=\"ja\"/></actuator>", 9, "can't be imported"),
            ("%a", " surfacevel=\"1 0 0 0 0 0\"", 6, "surfacevel can't be imported"),
        ],
    );
    refused(urdf, &[("<axis", "<dynamics damping=\".1\"/><axis", 9, "only 0 is allowed")]);
    // Ranges of torques and speeds are ignored: the job sets them.
    let motors =
        "<actuator><motor joint=\"ja\" ctrlrange=\"-1 1\"/><velocity joint=\"jb\" ctrlrange=\"-2 2\"/></actuator>";
    same(
        mjcf,
        &[
            ("%j", " springdamper=\"0 0\""),
            ("%a", " condim=\"3\""),
            ("%top", "<option density=\"0\" viscosity=\"0\"/>"),
            ("%top", "<option><flag contact=\"enable\" energy=\"enable\"/></option>"),
            ("%end", motors),
            ("%end", "<actuator><position joint=\"ja\" ctrlrange=\"-2 2\"/><position joint=\"jb\"/></actuator>"),
        ],
    );
}

const SERVOS_NARROW: &str = "<actuator><position joint=\"ja\" ctrlrange=\"-0.3 0.3\"/><position joint=\"jb\" ctrlrange=\"-0.3 0.3\"/></actuator>";

#[test]
fn hinge_without_range_gets_that_of_its_servo() {
    let servos = |low: &str| {
        format!(
            "<actuator><position joint=\"ja\" ctrlrange=\"{low} 1.5708\"/><position joint=\"jb\" ctrlrange=\"-1.5708 \
             1.5708\"/></actuator>"
        )
    };
    let without = |end: &str| {
        let range = " range=\"-90 90\"";
        mjcf(&[(range, ""), (range, ""), ("%end", end)])
    };
    let expected = Robot::compile(&robot(&mjcf(&[]))).unwrap().mechanics();
    assert_eq!(Robot::compile(&robot(&without(&servos("-1.5708")))).unwrap().mechanics(), expected);
    let position = "<default><position ctrlrange=\"-1.5708 1.5708\"/></default>";
    let by_class = without("<actuator><position joint=\"ja\"/><position joint=\"jb\"/></actuator>")
        .replace("<worldbody>", &format!("{position}<worldbody>"));
    assert_eq!(Robot::compile(&robot(&by_class)).unwrap().mechanics(), expected);
    for end in ["", "<actuator><motor joint=\"ja\" ctrlrange=\"-1.5708 1.5708\"/><motor joint=\"jb\"/></actuator>"] {
        let said = read(&without(end)).unwrap_err().to_string();
        assert_eq!(said.matches("it has no limits").count(), 2, "{said}");
    }
    assert!(read(&without(&servos("-1"))).unwrap_err().to_string().contains("-57.3°"));
}

#[test]
fn frames_add_their_pose_to_their_content() {
    let flat = robot(&mjcf(&[]));
    let framed = |frame: &str, body: &str| {
        robot(&mjcf(&[
            ("<body name=\"a\" pos=\".45 0 0\">", &format!("{frame}<body name=\"a\" {body}>")),
            ("%a/></body>", "%a/></body></frame>"),
        ]))
    };
    assert_eq!(framed("<frame>", "pos=\".45 0 0\""), flat);
    assert_eq!(framed("<frame pos=\".2 0 0\">", "pos=\".25 0 0\""), flat);
    let turned = framed("<frame euler=\"0 0 90\">", "pos=\"0 -.45 0\" euler=\"0 0 -90\"");
    let near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-12);
    let hinge = |spec: &RobotSpec| spec.bodies[1].hinge.clone().unwrap();
    assert!(near(hinge(&turned).anchor, hinge(&flat).anchor) && near(hinge(&turned).axis, hinge(&flat).axis));
    assert!(near(turned.bodies[1].boxes[0].center, flat.bodies[1].boxes[0].center));
    // A geom and a joint inside frames, and a class that comes from the frame.
    let inside = robot(&mjcf(&[
        ("%top", "<default><default class=\"c\"><geom size=\".3 .1 .1\" type=\"box\"/></default></default>"),
        (
            "<geom type=\"box\" size=\".3 .1 .1\" pos=\".35 0 0\" mass=\".5\"%a/>",
            "<frame pos=\".1 0 0\" childclass=\"c\"><geom pos=\".25 0 0\" mass=\".5\"/></frame>",
        ),
        (
            "<joint name=\"ja\" axis=\"0 1 0\" range=\"-90 90\"%j/>",
            "<frame zaxis=\"0 1 0\"><joint name=\"ja\" range=\"-90 90\"/></frame>",
        ),
    ]));
    assert!(near(inside.bodies[1].boxes[0].center, flat.bodies[1].boxes[0].center));
    assert!(near(hinge(&inside).axis, hinge(&flat).axis));
    refused(mjcf, &[("%world", "<frame poss=\"1 0 0\"/>", 2, "pos may be meant")]);
}

#[test]
fn level_planes_of_static_bodies_are_the_ground() {
    same(
        mjcf,
        &[
            (
                "<geom type=\"plane\" size=\"5 5 .1\"/>",
                "<body name=\"floor\"><geom type=\"plane\" size=\"5 5 .1\"/></body>",
            ),
            ("<geom type=\"plane\"", "<geom pos=\"0 0 -0.01\" type=\"plane\""),
            (
                "<geom type=\"plane\" size=\"5 5 .1\"/>",
                "<frame pos=\"0 0 -1\"><geom type=\"plane\" size=\"5 5 .1\"/></frame>",
            ),
            ("%world", "<body name=\"lamp\"><light/><geom size=\"1\" contype=\"0\" conaffinity=\"0\"/></body>"),
            ("%top", "<default><default class=\"p\"><geom type=\"plane\"/></default></default>"),
        ],
    );
    let Import { notes, .. } =
        read(&mjcf(&[("<geom type=\"plane\"", "<geom pos=\"0 0 -0.01\" type=\"plane\"")])).unwrap();
    assert!(notes.iter().any(|note| note.contains("z = -0.01")), "{notes:?}");
    refused(
        mjcf,
        &[
            (
                "%world",
                "<body name=\"step\"><geom type=\"box\" size=\"1 1 1\"/></body>",
                2,
                "the root needs <freejoint/>",
            ),
            ("%world", "<body><geom type=\"plane\" size=\"1 1 1\" euler=\"9 0 0\"/></body>", 2, "one level plane"),
            ("%world", "<geom type=\"plane\" size=\"1 1 1\" pos=\"0 0 1\"/>", 2, "one level plane"),
            ("<geom name=\"t\" type=\"box\"", "<geom name=\"t\" type=\"plane\"", 4, "only box and capsule"),
        ],
    );
}

#[test]
fn invalid_names_are_mapped_with_a_note() {
    let names = |changes: &[(&str, &str)]| {
        let Import { robot, notes } = read(&mjcf(changes)).unwrap();
        Robot::compile(&robot).unwrap();
        let hinges = robot.bodies.iter().filter_map(|b| Some(b.hinge.as_ref()?.name.clone())).collect::<Vec<_>>();
        (robot.name, robot.bodies.into_iter().map(|b| b.name).collect::<Vec<_>>(), hinges, notes.join("\n"))
    };
    let (model, bodies, hinges, note) = names(&[
        ("model=\"m\"", "model=\"MuJoCo Model\""),
        ("name=\"a\"", "name=\"left leg/ä\""),
        ("name=\"ja\"", "name=\"_j_旋转1\""),
    ]);
    assert_eq!((model.as_str(), bodies[1].as_str(), hinges[0].as_str()), ("MuJoCo_Model", "left_leg__", "j___1"));
    assert!(note.contains("\"left leg/ä\" is left_leg__"), "{note}");
    // Mapped names stay unique, and an allowed name is not changed.
    let (_, bodies, ..) = names(&[("name=\"a\"", "name=\"b/c\""), ("name=\"b\"", "name=\"b_c\"")]);
    assert_eq!(bodies, ["root", "b_c-2", "b_c"]);
    let (_, bodies, hinges, _) = names(&[("name=\"a\" ", ""), ("name=\"b\"", "name=\"body1\""), ("name=\"ja\" ", "")]);
    assert_eq!(
        (bodies, hinges),
        (vec!["root".into(), "body1-2".into(), "body1".into()], vec!["body1-2".into(), "jb".into()])
    );
    let long = "x".repeat(100);
    let (_, bodies, ..) = names(&[("name=\"a\"", &format!("name=\"{long}\""))]);
    assert_eq!(bodies[1], "x".repeat(64));
    assert_eq!(robot(&urdf(&[("name=\"r\"", "name=\"my robot v2\"")])).name, "my_robot_v2");
    // Excluded pairs and actuators refer to bodies and joints by their names in the file.
    let exclude = "<contact><exclude body1=\"left leg\" body2=\"root\"/></contact><actuator><motor joint=\"a/j\"/>\
                   <motor joint=\"jb\"/></actuator>";
    names(&[("name=\"a\"", "name=\"left leg\""), ("name=\"ja\"", "name=\"a/j\""), ("%end", exclude)]);
}

#[test]
fn repeated_names_are_refused_with_both_lines() {
    refused(
        mjcf,
        &[
            ("name=\"b\"", "name=\"a\"", 7, "\"a\" is used twice, first in line 5"),
            ("name=\"jb\"", "name=\"ja\"", 7, "\"ja\" is used twice, first in line 5"),
        ],
    );
    refused(urdf, &[("name=\"c\"", "name=\"b\"", 5, "\"b\" is used twice, first in line 3")]);
    let joint = "<joint name=\"j\" type=\"fixed\"><parent link=\"b\"/><child link=\"d\"/></joint></robot>";
    let link = format!("<link name=\"d\"/>\n{joint}");
    // Names of fixed joints are not kept, so a fixed joint may have the name of a hinge.
    read(&urdf(&[("</robot>", &link)])).unwrap();
}

#[test]
fn extensions_without_bodies_are_ignored_with_a_note() {
    let cases = [
        (
            "</robot>",
            "<ros2_control name=\"h\" type=\"system\"><joint name=\"j\"/></ros2_control></robot>",
            "<ros2_control>",
        ),
        ("</robot>", "<sensor name=\"cam\"><parent link=\"b\"/></sensor></robot>", "<sensor>"),
        ("<link name=\"c\">", "<link name=\"c\"><contact><lateral_friction value=\"1\"/></contact>", "<contact>"),
        ("<link name=\"c\">", "<link name=\"c\"><self_collision_checking/>", "<self_collision_checking>"),
        ("</robot>", "<mujoco><compiler balanceinertia=\"true\"/></mujoco></robot>", "<mujoco>"),
        ("</robot>", "<gazebo reference=\"b\"><mu1>1</mu1></gazebo></robot>", "<gazebo>"),
        ("</robot>", "<transmission name=\"t\"><type>x</type></transmission></robot>", "<transmission>"),
    ];
    same(urdf, &cases.map(|(from, to, _)| (from, to)));
    for (from, to, named) in cases {
        let notes = read(&urdf(&[(from, to)])).unwrap().notes;
        assert_eq!(notes.len(), 1, "{notes:?}");
        assert!(notes[0].contains(named) && notes[0].contains("limit effort velocity"), "{notes:?}");
    }
    let space =
        "<robot xmlns:xacro=\"http://www.ros.org/wiki/xacro\" name=\"r\"><xacro:property name=\"w\" value=\"1\"/>";
    refused(
        urdf,
        &[
            ("<robot name=\"r\">", space, 2, "run `xacro"),
            ("value=\"1\"", "value=\"${m}\"", 3, "run `xacro"),
            ("xyz=\".8 0 0\"", "xyz=\"$(arg x) 0 0\"", 8, "run `xacro"),
        ],
    );
}

#[test]
fn files_that_hold_no_robot_are_refused() {
    for (text, words) in [
        ("", "the file is empty"),
        (" \n", "the file is empty"),
        ("<!DOCTYPE html><html><body><p>404: Not Found</p></body></html>", "a web page"),
        ("<html><body/></html>", "begins with <mujoco>"),
        ("<?xml version=\"1.0\"?>\n<!DOCTYPE mujoco>\n<mujoco/>", "line 2: a document type can't be imported"),
        ("name = \"robot\"", "this is not XML"),
        ("<sdf version=\"1.6\"/>", "MJCF begins with <mujoco>"),
    ] {
        let said = read(text).unwrap_err().to_string();
        assert!(said.contains(words), "{text:?}: {said}");
    }
    refused(
        mjcf,
        &[(
            "type=\"box\" size=\".4 .25 .2\" mass=\"1\"",
            "type=\"box\" size=\".4 .25\" mass=\"1\"",
            4,
            "half of its three sides",
        )],
    );
    let unseen = "contype=\"0\" conaffinity=\"0\"/></default>";
    let said = read(&mjcf(&[("%top", &format!("<default><geom {unseen}"))])).unwrap_err().to_string();
    assert!(said.contains("line 3, <body name=\"root\">: no <geom> of the robot collides"), "{said}");
    let box_b = "\n<collision><geometry><box size=\".6 .3 .2\"/></geometry></collision>";
    let box_c = "\n<collision><origin xyz=\".35 0 0\"/><geometry><box size=\".6 .2 .2\"/></geometry></collision>";
    let said = read(&urdf(&[(box_b, ""), (box_c, "")])).unwrap_err().to_string();
    assert!(said.contains("no link has a <collision>"), "{said}");
}

#[test]
fn at_most_ten_faults_per_file_are_listed() {
    let said = read(&urdf(&[
        ("<box size=\".6 .3 .2\"/>", "<sphere radius=\".1\"/>"),
        ("lower=\"-1.5708\"", "lower=\"-.785\""),
        ("</joint>", "<dynamics damping=\".1\"/></joint>"),
    ]))
    .unwrap_err()
    .to_string();
    assert!(said.starts_with("3 faults\n  line 4, <sphere>"), "{said}");
    assert!(said.contains("line 9, <dynamics>") && said.contains("-45.0° to 90.0°"), "{said}");
    let many: String = (0..14).map(|i| format!("<nothing name=\"n{i}\"/>\n")).collect();
    let said = read(&mjcf(&[("%world", &many)])).unwrap_err().to_string();
    assert!(said.starts_with("14 faults\n") && said.ends_with("and 4 more: at most 10 are listed"), "{said}");
    assert_eq!(said.lines().count(), 12);
    // Numbers that are refused only when the robot is compiled have the line of their body.
    refused(
        mjcf,
        &[
            ("pos=\".35 0 0\"", "pos=\"5000 0 0\"", 5, "box[0].center[0] = 5000"),
            ("size=\".3 .1 .1\"", "size=\".3 .1 -1\"", 5, "half"),
        ],
    );
}

#[test]
fn files_with_too_many_bodies_are_refused() {
    let bodies = "<body/>".repeat(30_000);
    let said = read(&mjcf(&[("%world", ""), ("<body name=\"b\"", &format!("{bodies}<body name=\"b\""))])).unwrap_err();
    assert!(said.to_string().contains("too many bodies: at most 1024"), "{said}");
    let links: String = (0..5_000).map(|i| format!("<link name=\"n{i}\"/>")).collect();
    let said = read(&urdf(&[("</robot>", &format!("{links}</robot>"))])).unwrap_err();
    assert!(said.to_string().contains("too many links: at most 1024"), "{said}");
    let unknown: String = (0..12_000).map(|i| format!("<x name=\"{i}\"/>")).collect();
    let said = read(&mjcf(&[("%top", &unknown)])).unwrap_err().to_string();
    assert!(said.starts_with("1000 faults or more\n"), "{said}");
}
