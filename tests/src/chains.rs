//! Jobs with robots that are chains of bodies: the most expensive ones to check and to settle.

use sim_core::exchange;
use sim_core::job::{JobSpec, Reference};
use sim_core::problem::Checked;
use std::fmt::Write as _;

/// Bodies of the longest chain and boxes of each body: the most that a robot may have.
const BODIES: usize = 64;
const BOXES: usize = 4;

/// Returns a chain of bodies as MJCF.
fn chain() -> String {
    let mut xml = String::from(r#"<mujoco model="chain"><worldbody><body name="b0" pos="0 0 1"><freejoint/>"#);
    for body in 0..BODIES {
        if body > 0 {
            let axis = if body % 2 == 0 { "0 1 0" } else { "0 0 1" };
            let joint = format!(r#"<joint name="j{body}" axis="{axis}" pos="-0.5 0 0" range="-90 90"/>"#);
            let _ = write!(xml, r#"<body name="b{body}" pos="1 0 0">{joint}"#);
        }
        for i in 0..BOXES {
            let y = (i as f64 - (BOXES as f64 - 1.0) / 2.0) * 0.3;
            let _ = write!(xml, r#"<geom type="box" size="0.4 0.1 0.1" pos="0 {y} 0" mass="0.25"/>"#);
        }
    }
    xml + &"</body>".repeat(BODIES) + "</worldbody></mujoco>"
}

fn spec(seed: u64, steps_per_second: u32, substeps: u32) -> JobSpec {
    let text = format!(
        "name = \"chain\"\nseed = {seed}\nrobot = \"lizard\"\nenvironment = \"empty\"\ngaits = {{ count = 1, duration = 1.0 }}\n\
         fitness = {{ kind = \"coverage\" }}\noptimiser = {{ kind = \"pso\" }}\nfinish = {{ kind = \"none\" }}\n\
         planner = {{ iterations = 1 }}\nphysics = {{ engine = \"rapier\", joints = \"multibody\", damping = 0.0, \
         steps_per_second = {steps_per_second}, substeps = {substeps} }}"
    );
    let spec: JobSpec = toml::from_str(&text).expect("the text is a valid job file");
    let robot = exchange::read(&chain()).expect("the chain is valid MJCF").robot;
    JobSpec { robot: Reference::Inline(Box::new(robot)), ..spec }
}

/// Returns a job that would take hours to settle: 64 bodies of 4 boxes, in reduced coordinates without damping, at the
/// given steps per second and substeps.
pub fn chain_job(seed: u64, steps_per_second: u32, substeps: u32) -> String {
    toml::to_string(&spec(seed, steps_per_second, substeps)).expect("a job can be written as TOML")
}

/// Returns the most expensive job of the same robot with a preparation within the budget. Finds its steps per second by
/// bisection.
pub fn costliest_job(seed: u64) -> String {
    let fits = |steps: u32| Checked::new(spec(seed, steps, 1)).is_ok();
    let (mut least, mut most) = (1, 1000);
    assert!(!fits(most), "1000 steps per second must exceed the budget of a preparation");
    while most - least > 1 {
        let middle = least.midpoint(most);
        *(if fits(middle) { &mut least } else { &mut most }) = middle;
    }
    assert!(fits(least), "one step per second must be within the budget of a preparation");
    chain_job(seed, least, 1)
}
