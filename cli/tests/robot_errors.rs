//! Errors of robot and environment files, each with the change of a valid file that causes it. Also errors of robots
//! that can't stand at their start.

mod common;
#[path = "common/refusals.rs"]
mod refusals;

use refusals::{BODIES, EVOLVE, MODULES, YARD, must_be_valid, of_lines, of_texts, refusal, titled};

#[test]
fn unchanged_robots_and_environment_are_valid() {
    for robot in [MODULES, BODIES] {
        must_be_valid(&[("robot.toml", robot), ("yard.toml", YARD)]);
    }
}

#[test]
fn invalid_modules_are_refused_by_field() {
    let said = of_texts(
        "robot.toml",
        MODULES,
        &[
            (r#"name = "worm""#, r#"name = "my worm""#),
            (r#"name = "a""#, r#"name = """#),
            (r#"pivot = "a""#, r#"pivot = "a/c""#),
            ("failed = []", r#"failed = ["c"]"#),
            ("failed = []", r#"failed = ["a", "b"]"#),
            (r#"kind = "cosmo" }"#, r#"kind = "cosmo", pose = { position = [1001.0, 0.0, 0.0] } }"#),
            (r#"kind = "cosmo" }"#, r#"kind = "cosmo", pose = { rotation = [0.0, 0.0, 361.0] } }"#),
            (r#"kind = "cosmo" }"#, r#"kind = "cosmo", pose = { position = [1.0, 0.0] } }"#),
            (r#"port = "front" }"#, r#"port = "front", own = "bow" }"#),
            (r#"port = "front" }"#, r#"port = "front", turn = 45 }"#),
            (r#"port = "front" }"#, r#"port = "front", turn = "left" }"#),
            (r#"port = "front" }"#, r#"port = "front" }, pose = {}"#),
            ("module = [", r#"module = [{ name = "c", kind = "cosmo", attach = { to = "a", port = "front" } },"#),
            ("module = [", r#"module = [{ name = "c", kind = "cosmo", attach = { to = "b", port = "back" } },"#),
        ],
    );
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn invalid_bodies_are_refused_by_field() {
    let said = of_texts(
        "robot.toml",
        BODIES,
        &[
            (r#"name = "rod""#, r#"name = "my rod""#),
            (r#"name = "arm""#, r#"name = "my arm""#),
            (r#"name = "arm""#, r#"name = "base""#),
            ("mass = 1.0", "mass = 0.0"),
            ("center_of_mass = [0.0, 0.0", "center_of_mass = [0.0, 2000.0"),
            ("inertia = [0.1,", "inertia = [1e13,"),
            ("inertia = [0.1,", "inertia = [-0.1,"),
            ("half = [0.4,", "half = [0.0,"),
            ("0.0, 1.0], half", "0.0, 2.0], half"),
            ("box = [{ center = [0.0,", "box = [{ center = [nan,"),
            ("from = [0.3,", "from = [-1001.0,"),
            ("to = [0.8,", "to = [1001.0,"),
            ("to = [0.8,", "to = [0.3,"),
            ("radius = 0.1", "radius = 0.0"),
        ],
    );
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn invalid_hinges_are_refused_by_field() {
    let said = of_texts(
        "robot.toml",
        BODIES,
        &[
            (r#"name = "joint""#, r#"name = "my joint""#),
            (r#"parent = "base""#, r#"parent = "foot""#),
            (r#"parent = "base""#, r#"parent = "arm""#),
            ("anchor = [0.4,", "anchor = [inf,"),
            ("axis = [0.0, 0.0, 1.0]", "axis = [0.0, 0.0, 2000.0]"),
            ("axis = [0.0, 0.0, 1.0]", "axis = [0.0, 0.0, 0.0]"),
            ("limits = [-1.0,", "limits = [0.1,"),
            ("limits = [-1.0, 1.0]", "limits = [-1.0, 4.0]"),
            ("limits = [-1.0, 1.0]", "limits = [0.0, 0.0]"),
            ("speed = 5.0", "speed = 0.0"),
            ("torque = 10.0", "torque = -1.0"),
            (r#"pivot = "base""#, r#"pivot = "arm""#),
            ("failed = []", r#"failed = ["knee"]"#),
            ("failed = []", r#"failed = ["joint"]"#),
            ("module = []", r#"module = [{ name = "a", kind = "cosmo" }]"#),
        ],
    );
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn invalid_maps_are_refused_by_field() {
    let said = of_texts(
        "yard.toml",
        YARD,
        &[
            (r#"name = "yard""#, r#"name = "back yard""#),
            ("size = [20.0, 10.0]", "size = [20.0]"),
            ("size = [20.0,", "size = [0.5,"),
            ("start = { x = -5.0", "start = { x = -20000.0"),
            ("x = -5.0, y = 0.0", "x = -5.0, y = nan"),
            ("yaw = 0.0 }", "yaw = 7.5 }"),
            ("goal = { x = 5.0", "goal = { x = -20000.0"),
            ("goal = { x = 5.0, y = 0.0", "goal = { x = 5.0, y = inf"),
            ("goal = { x = 5.0,", "goal = { z = nan, x = 5.0,"),
            ("goal = { x = 5.0,", "goal = { yaw = -8.0, x = 5.0,"),
            ("goal = { x = 5.0,", "goal = { radius = 0.0, x = 5.0,"),
        ],
    );
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn invalid_obstacles_are_refused_by_field() {
    let said = of_texts(
        "yard.toml",
        YARD,
        &[
            ("[[obstacle]]", "[[wall]]"),
            ("[[obstacle]]", "[obstacle]"),
            ("center = [0.0,", "center = [inf,"),
            ("size = [2.0,", "size = [0.0,"),
            ("base = 0.0", "base = -1.0"),
            ("base = 0.0", "base = 2.0"),
            ("top = 1.0", "top = 1001.0"),
            ("yaw = 0.5", "yaw = 8.0"),
        ],
    );
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn invalid_variants_are_refused() {
    // A job takes one variant of a robot, so only `evogait robot` checks all of them.
    let refused = |robot: &str, variants: &str| {
        titled(
            variants,
            &refusal(&["robot", "robot.toml"], &[("robot.toml", &robot.replace("variants = {}", variants))]),
        )
    };
    let mut said = vec![
        refused(MODULES, r#"variants = { "one leg" = ["a"] }"#),
        refused(MODULES, r#"variants = { one-leg = ["leg"] }"#),
        refused(BODIES, r#"variants = { "one leg" = ["joint"] }"#),
        refused(BODIES, r#"variants = { one-leg = ["leg"] }"#),
    ];
    said.extend(of_lines(EVOLVE, &[], &[&[r#"variant = "one-leg""#]]));
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn robots_without_joint_or_pivot_are_refused() {
    let refused =
        |cause: &str, robot: &str| titled(cause, &refusal(&["validate", "job.toml"], &[("robot.toml", robot)]));
    let failed = |kind: &str| {
        MODULES
            .replace("failed = []", r#"failed = ["b"]"#)
            .replace(r#""cosmo", attach"#, &format!(r#""{kind}", attach"#))
    };
    let (without_hinge, _) = BODIES.split_once("[body.hinge]").unwrap();
    let hinge = r#"hinge = { name = "other", parent = "arm", anchor = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }"#;
    let said = [
        refused("the failed module is a block", &failed("block")),
        refused("the failed module is of an unknown kind", &failed("cosmos")),
        refused("all modules are blocks", &MODULES.replace("cosmo", "block")),
        refused("no body has a hinge", without_hinge),
        refused(
            "both bodies have hinges",
            &BODIES.replacen("\n\n[[body]]\nname = \"arm\"", &format!("\n{hinge}\n\n[[body]]\nname = \"arm\""), 1),
        ),
    ];
    insta::assert_snapshot!(said.join("\n"));
}

#[test]
fn too_long_texts_and_lists_are_refused() {
    let refused =
        |cause: &str, file: &str, text: &str| titled(cause, &refusal(&["validate", "job.toml"], &[(file, text)]));
    let with_more = |text: &str, list: &str, more: &str| text.replacen(list, &format!("{list}{more}"), 1);
    let description = format!("description = \"{}\"", "x".repeat(5000));
    let modules = r#"{ name = "m", kind = "cosmo" }, "#.repeat(64);
    let bodies = "\n[[body]]\nname = \"m\"\nmass = 1.0\ninertia = [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]\n".repeat(64);
    let boxes = "{ half = [0.4, 0.2, 0.2] }, ".repeat(256);
    let shapeless = BODIES.replace("box = [", "box = [] # [").replace("capsule = [", "capsule = [] # [");
    let obstacle = "\n[[obstacle]]\ncenter = [1.0, 1.0]\nsize = [1.0, 1.0]\ntop = 1.0\n";
    let terrain = obstacle.replace("obstacle", "terrain").repeat(257);
    let faults = obstacle.replace("center = [1.0, 1.0]", "center = [nan, nan]");
    let many_faults = faults.replace("size = [1.0, 1.0]", "size = [nan, nan]").repeat(255);
    let said = [
        refused("description of 5000 bytes, robot of modules", "robot.toml", &(description.clone() + MODULES)),
        refused("description of 5000 bytes, robot of bodies", "robot.toml", &(description.clone() + BODIES)),
        refused("description of 5000 bytes, environment", "yard.toml", &(description.clone() + YARD)),
        refused("no modules", "robot.toml", "name = \"none\"\npivot = \"a\""),
        refused("66 modules", "robot.toml", &with_more(MODULES, "module = [", &modules)),
        refused("66 bodies", "robot.toml", &(BODIES.to_owned() + &bodies)),
        refused("258 boxes and capsules", "robot.toml", &with_more(BODIES, "box = [", &boxes)),
        refused("no boxes and capsules", "robot.toml", &shapeless),
        refused("257 obstacles", "yard.toml", &(YARD.to_owned() + &obstacle.repeat(256))),
        refused("257 pieces of terrain", "yard.toml", &(YARD.to_owned() + &terrain)),
        refused("12 faults", "yard.toml", &(YARD.to_owned() + &faults.repeat(6))),
        refused("more than 1000 faults", "yard.toml", &(YARD.to_owned() + &many_faults)),
    ];
    insta::assert_snapshot!(said.join("\n"));
}

/// Unlike other faults, these are found by letting the robot settle, which takes some tenths of a second.
#[test]
fn robots_that_cannot_stand_are_refused() {
    // The arm at the upper edge of the base has no spring, only a damper, so it sinks slowly.
    let sinking = BODIES
        .replace("half = [0.4, 0.2, 0.2]", "half = [0.5, 0.5, 1.0]")
        .replace("mass = 1.0", "mass = 9.0")
        .replace("mass = 0.5", "mass = 1.0")
        .replace("anchor = [0.4, 0.0, 0.0]", "anchor = [0.5, 0.0, 0.9]")
        .replace("axis = [0.0, 0.0, 1.0]", "axis = [0.0, 1.0, 0.0]")
        .replace("from = [0.3", "from = [0.2")
        .replace("to = [0.8", "to = [2.0")
        .replace("torque = 10.0", "torque = 1000.0")
        .replace("[0.55", "[1.1");
    let terrain = "\n[[terrain]]\ncenter = [-5.0, 0.0]\nsize = [1.0, 1.0]\ntop = 0.5\n";
    let mut said = of_lines(
        EVOLVE,
        &[],
        &[
            &["fitness.cell = 20.0"],
            &["physics.gravity = 1e4"],
            &["physics.gravity = 1e4", "physics.steps_per_second = 1", "physics.substeps = 1"],
            &["finish.steps_per_second = 1", "finish.substeps = 1"],
            &[
                r#"physics.engine = "lockstep""#,
                "physics.steps_per_second = 5",
                "physics.substeps = 1",
                r#"finish.kind = "none""#,
            ],
        ],
    );
    said.extend(of_lines(
        EVOLVE,
        &[("robot.toml", &sinking)],
        &[&["physics.stiffness = 0.0", "physics.damping = 300.0"]],
    ));
    let stepped = refusal(&["validate", "job.toml"], &[("yard.toml", &(YARD.to_owned() + terrain))]);
    said.push(titled("terrain under a part of the robot", &stepped));
    insta::assert_snapshot!(said.join("\n"));
}
