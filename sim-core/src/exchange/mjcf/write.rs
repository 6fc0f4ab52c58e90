//! Writer from robots to MJCF.

use crate::base::math::{Pose, Rotation};
use crate::exchange::xml::{Attribute, Writer, quaternion, triple};
use crate::model::{Body, Robot};
use crate::physics::Physics;

/// Time step at which the robots that ship keep their gaits at scale `paper`, s.
const TIMESTEP: f32 = 0.005;
/// MuJoCo's default time constant of contacts and limits, s.
const CONTACT_TIME: f32 = 0.02;
/// Gravity that both times are meant for, mu/s².
const USUAL_GRAVITY: f32 = 9.81;
/// Friction against twisting (mu) and rolling (mu): MuJoCo's defaults, without effect on contacts of three dimensions.
const OTHER_FRICTION: &str = "0.005 0.0001";

/// Writes a robot on flat ground in its neutral configuration, with its lowest corner on the ground.
pub(in crate::exchange) fn write(robot: &Robot, physics: &Physics) -> String {
    // A smaller robot moves faster: all times shrink with the time of a fall over 1 mu.
    let pace = (USUAL_GRAVITY / physics.gravity).sqrt().min(1.0);
    let contact = format!("{} 1", CONTACT_TIME * pace);
    let friction = format!("{} {OTHER_FRICTION}", physics.friction);
    let surface = move || [("friction", friction.clone()), ("solref", contact.clone())];

    let mut xml = Writer::new();
    xml.comment(&format!(
        "{}, written by evogait. Units: mu (one module length) for length, kg, s, rad; torque in kg mu^2/s^2.\n\
         Joint targets go to the actuators, which are named after their joints.",
        robot.name
    ));
    xml.open("mujoco", &[("model", robot.name.clone())]);
    xml.leaf("compiler", &[("angle", "radian".into()), ("autolimits", "true".into())]);
    xml.leaf(
        "option",
        &[
            ("gravity", format!("0 0 {}", -physics.gravity)),
            ("timestep", (TIMESTEP * pace).to_string()),
            ("integrator", "implicitfast".into()),
            ("cone", "elliptic".into()),
        ],
    );
    meshes(&mut xml, robot);
    xml.open("worldbody", &[]);
    xml.leaf("light", &[("pos", "0 0 10".into()), ("directional", "true".into())]);
    let plane = [("name", "ground".into()), ("type", "plane".into()), ("size", "0 0 1".into())];
    xml.leaf("geom", &[&plane[..], &surface()].concat());
    let place = [("pos", triple(robot.neutral().pivot.translation))];
    body(&mut xml, robot, 0, &place, &surface);
    xml.close();

    xml.comment("Bodies that share a joint never touch.");
    xml.open("contact", &[]);
    for (i, hinge) in robot.hinges.iter().enumerate() {
        let ends = [hinge.parent, i + 1].map(|b| robot.bodies[b].name.clone());
        let [first, second] = ends;
        xml.leaf("exclude", &[("body1", first), ("body2", second)]);
    }
    xml.close();

    xml.open("actuator", &[]);
    for hinge in &robot.hinges {
        let (torque, [low, high]) = (hinge.torque_or(physics.max_torque), hinge.limits);
        xml.leaf(
            "position",
            &[
                ("name", hinge.name.clone()),
                ("joint", hinge.name.clone()),
                ("kp", physics.stiffness.to_string()),
                ("kv", physics.damping.to_string()),
                ("forcerange", format!("{} {torque}", -torque)),
                ("ctrlrange", format!("{low} {high}")),
            ],
        );
    }
    xml.finish()
}

/// Writes a body and all that it carries.
fn body(xml: &mut Writer, robot: &Robot, index: usize, place: &[Attribute], surface: &impl Fn() -> [Attribute; 2]) {
    let body = &robot.bodies[index];
    xml.open("body", &[&[("name", body.name.clone())], place].concat());
    match index.checked_sub(1).map(|i| &robot.hinges[i]) {
        None => xml.leaf("freejoint", &[("name", "root".into())]),
        Some(hinge) => xml.leaf(
            "joint",
            &[
                ("name", hinge.name.clone()),
                ("type", "hinge".into()),
                ("axis", triple(hinge.axis)),
                ("range", format!("{} {}", hinge.limits[0], hinge.limits[1])),
            ],
        ),
    }
    xml.leaf("inertial", &inertial(body));
    for part in &body.boxes {
        let shape = [("type", "box".into()), ("size", triple(part.half))];
        xml.leaf("geom", &[&shape[..], &placed(&part.pose), &[("mass", "0".into())], &surface()].concat());
    }
    for part in &body.capsules {
        let [a, b] = part.ends;
        let line = format!("{} {}", triple(a), triple(b));
        let shape = [("type", "capsule".into()), ("size", part.radius.to_string()), ("fromto", line)];
        xml.leaf("geom", &[&shape[..], &[("mass", "0".into())], &surface()].concat());
    }
    for i in 0..body.prisms.len() {
        let shape = [("type", "mesh".into()), ("mesh", mesh_name(body, i)), ("mass", "0".into())];
        xml.leaf("geom", &[&shape[..], &surface()].concat());
    }
    for (i, hinge) in robot.hinges.iter().enumerate().filter(|(_, hinge)| hinge.parent == index) {
        self::body(xml, robot, i + 1, &[("pos", triple(hinge.anchor))], surface);
    }
    xml.close();
}

/// Writes the corners of all prisms, of which MuJoCo makes convex meshes.
fn meshes(xml: &mut Writer, robot: &Robot) {
    if robot.bodies.iter().all(|body| body.prisms.is_empty()) {
        return;
    }
    xml.open("asset", &[]);
    for body in &robot.bodies {
        for (i, prism) in body.prisms.iter().enumerate() {
            let corners: Vec<String> = prism.corners().iter().map(|corner| triple(*corner)).collect();
            xml.leaf("mesh", &[("name", mesh_name(body, i)), ("vertex", corners.join("  "))]);
        }
    }
    xml.close();
}

fn mesh_name(body: &Body, prism: usize) -> String {
    format!("{}-{prism}", body.name)
}

fn placed(pose: &Pose) -> Vec<Attribute> {
    let mut place = vec![("pos", triple(pose.translation))];
    if pose.rotation != Rotation::IDENTITY {
        place.push(("quat", quaternion(pose.rotation)));
    }
    place
}

/// Returns the inertial attributes of a body, about the centre of mass and in the body's axes.
fn inertial(body: &Body) -> [Attribute; 3] {
    let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] = body.inertia;
    [
        ("pos", triple(body.center_of_mass)),
        ("mass", body.mass.to_string()),
        ("fullinertia", format!("{xx} {yy} {zz} {xy} {xz} {yz}")),
    ]
}
