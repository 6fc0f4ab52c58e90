//! Settles a large robot, to measure the cost per body-substep of a preparation.
//!
//! `time cargo run --release -p study --example preparing -- BODIES BOXES JOINTS STEPS SUBSTEPS` settles a chain of
//! BODIES bodies with BOXES boxes each on the ground without damping, and prints the number of simulated steps. JOINTS
//! is `impulse`, `multibody` or `lockstep`. Example of arguments: `64 4 multibody 1000 1`. With `check` as the sixth
//! argument, the program checks the job 100 times and settles nothing.

use sim_core::exchange;
use sim_core::job::{JobSpec, Reference};
use sim_core::model::RobotSpec;
use sim_core::problem::Checked;
use std::cell::Cell;
use std::fmt::Write as _;

/// Returns a chain of bodies, read from MJCF.
fn chain(bodies: usize, boxes: usize) -> RobotSpec {
    let mut xml = String::from(r#"<mujoco model="chain"><worldbody><body name="b0" pos="0 0 1"><freejoint/>"#);
    for body in 0..bodies {
        if body > 0 {
            let axis = if body % 2 == 0 { "0 1 0" } else { "0 0 1" };
            let _ = write!(
                xml,
                r#"<body name="b{body}" pos="1 0 0"><joint name="j{body}" axis="{axis}" pos="-0.5 0 0" range="-90 90"/>"#
            );
        }
        for i in 0..boxes {
            let y = (i as f64 - (boxes as f64 - 1.0) / 2.0) * 0.3;
            let _ = write!(xml, r#"<geom type="box" size="0.4 0.1 0.1" pos="0 {y} 0" mass="0.25"/>"#);
        }
    }
    xml += &"</body>".repeat(bodies);
    xml += "</worldbody></mujoco>";
    exchange::read(&xml).expect("the generated MJCF of a chain must be valid").robot
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |i: usize| arguments[i].parse().expect("BODIES, BOXES, STEPS and SUBSTEPS must be whole numbers");
    let (bodies, boxes, steps, substeps) = (number(0), number(1), number(3), number(4));
    let text = format!(
        "name = \"a\"\nrobot = \"lizard\"\nenvironment = \"empty\"\ngaits = {{ count = 1, duration = 1.0 }}\n\
         fitness = {{ kind = \"coverage\" }}\noptimiser = {{ kind = \"pso\" }}\nfinish = {{ kind = \"none\" }}\n\
         planner = {{ iterations = 1 }}\nphysics = {{ {}, damping = 0.0, \
         steps_per_second = {steps}, substeps = {substeps} }}",
        match arguments[2].as_str() {
            "lockstep" => "engine = \"lockstep\"".to_owned(),
            joints => format!("engine = \"rapier\", joints = \"{joints}\""),
        }
    );
    let spec: JobSpec = toml::from_str(&text).expect("the generated job must be well formed");
    let spec = JobSpec { robot: Reference::Inline(Box::new(chain(bodies, boxes))), ..spec };
    if arguments.get(5).is_some_and(|mode| mode == "check") {
        for _ in 0..100 {
            if let Err(refused) = Checked::new(spec.clone()) {
                println!("{refused}");
            }
        }
        return;
    }
    let job = Checked::new(spec).expect("the job must be valid and within its budget");
    // The stop callback is called before every step.
    let asked = Cell::new(0u64);
    let prepared = job.prepare(&|| {
        asked.set(asked.get() + 1);
        false
    });
    println!("{} steps; at most {} body-substeps", asked.get(), job.preparation_budget());
    println!("{:?}", prepared.map(|preparation| preparation.to_string()));
}
