//! The section `<compiler>`, which changes how other sections are read, and the section `<option>`.

use crate::base::error::{Faults, Invalid};
use crate::exchange::source::{child, exactly, foreign_attribute, keyword, zero};
use roxmltree::Node;

/// Settings of `<compiler>`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Compiler {
    degrees: bool,
    /// True if a range alone makes a joint or an actuator limited.
    pub autolimits: bool,
    /// Source of masses. `Some(true)`: geoms, even where there is `<inertial>`. `Some(false)`: `<inertial>` only.
    /// `None`: geoms where there is no `<inertial>`.
    pub from_geoms: Option<bool>,
}

impl Default for Compiler {
    fn default() -> Self {
        Self { degrees: true, autolimits: true, from_geoms: None }
    }
}

impl Compiler {
    /// Converts an angle as written in the file to rad.
    pub fn radians(&self, angle: f64) -> f64 {
        if self.degrees { angle.to_radians() } else { angle }
    }

    /// Reads the attributes of a `<compiler>`.
    pub fn read(&mut self, compiler: Node, faults: &mut Faults) {
        let word = |name: &str, allowed: &[&str]| {
            compiler.attribute(name).map(|text| keyword(compiler, name, text, allowed)).transpose()
        };
        if let Some(Some(angle)) = faults.take(word("angle", &["degree", "radian"])) {
            self.degrees = angle == "degree";
        }
        if let Some(Some(auto)) = faults.take(word("autolimits", &["true", "false"])) {
            self.autolimits = auto == "true";
        }
        if let Some(Some(from)) = faults.take(word("inertiafromgeom", &["true", "false", "auto"])) {
            self.from_geoms = match from {
                "auto" => None,
                other => Some(other == "true"),
            };
        }
        let refuse = |name: &str, reason: &str, allowed: &dyn Fn(&str) -> bool| {
            let given = compiler.attribute(name).filter(|text| !allowed(text.trim()));
            given
                .map_or(Ok(()), |text| Err(foreign_attribute(compiler, name, format!("{name} = \"{text}\": {reason}"))))
        };
        let masses = "it can't be imported: write the final masses and inertias";
        let nothing = |text: &str| text.split_whitespace().all(|word| word.parse() == Ok(0.0));
        for refused in [
            refuse("coordinate", "only local is allowed", &|text| text == "local"),
            refuse("balanceinertia", "only false is allowed: write the final inertias", &|text| text == "false"),
            refuse("eulerseq", "only xyz is allowed, or quat in place of euler", &|text| text == "xyz"),
            refuse("boundmass", masses, &nothing),
            refuse("boundinertia", masses, &nothing),
            refuse("inertiagrouprange", masses, &|text| text.split_whitespace().eq(["0", "5"])),
            refuse("settotalmass", masses, &|text| text.starts_with('-')),
        ] {
            faults.take(refused);
        }
    }
}

/// Refuses an `<option>` with physics that no job has.
pub(super) fn option(option: Node, faults: &mut Faults) {
    for fluid in ["density", "viscosity"] {
        faults.take(zero(option, fluid, option.attribute(fluid), "evogait simulates no fluid"));
    }
    if let Some(text) = option.attribute("gravity") {
        faults.take(gravity(option, text));
    }
    let Some(flag) = child(option, "flag") else { return };
    for (name, why) in [
        ("actuation", "all joints have motors"),
        ("constraint", "joints have limits and the ground carries the robot"),
        ("contact", "robots touch the ground and themselves"),
        ("filterparent", "bodies that share a joint never touch"),
        ("gravity", "all bodies have weight, but [physics] gravity of a job may be 0"),
        ("limit", "all joints have limits"),
    ] {
        let Some(text) = flag.attribute(name) else { continue };
        if let Some("disable") = faults.take(keyword(flag, name, text, &["enable", "disable"])) {
            faults.add(foreign_attribute(flag, name, format!("{name} = \"disable\" can't be imported: {why}")));
        }
    }
}

/// Refuses gravity that does not point down. Its size comes from the job.
fn gravity(option: Node, text: &str) -> Result<(), Invalid> {
    let [x, y, z] = exactly(option, "gravity", text)?;
    if x == 0.0 && y == 0.0 && z <= 0.0 {
        return Ok(());
    }
    Err(foreign_attribute(option, "gravity", format!("gravity = \"{text}\": only downwards (0 0 -g) is allowed")))
}
