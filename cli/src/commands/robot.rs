//! `evogait robot`: facts, picture and export of a robot.

use crate::arguments::{self, PictureFormat, RobotOutput};
use crate::console;
use crate::draw::{self, DrawnBox};
use crate::error::Error;
use crate::load;
use crate::output::{atomic, png};
use crate::plausibility;
use serde::Serialize;
use sim_core::model::{Robot, RobotSpec};
use sim_core::physics::Physics;
use std::collections::BTreeMap;

#[derive(Serialize)]
struct View {
    name: String,
    description: String,
    /// Number of modules; 0 if the file lists bodies, and then `failed_modules` has hinges.
    modules: usize,
    failed_modules: Vec<String>,
    bodies: usize,
    /// Names of the moving joints, in the order of genotypes.
    joints: Vec<String>,
    /// Mass, kg.
    mass: f64,
    /// Length, width and height in the neutral configuration, mu.
    size: [f64; 3],
    pivot: String,
    variants: BTreeMap<String, Vec<String>>,
    /// Notes of the import, and warnings about the robot.
    notes: Vec<String>,
}

/// Prints the facts of the robot. Writes a picture or an export if the options require it.
pub fn run(args: arguments::Robot, quiet: bool) -> Result<(), Error> {
    let load::RobotFile { mut spec, label: file, notes } = load::robot(&args.robot, args.unit)?;
    let invalid = |source| Error::Invalid { file: file.clone(), source };
    let variants = spec.variants.clone();
    if let Some(variant) = &args.variant {
        spec = spec.variant(variant).map_err(invalid)?;
    }
    let robot = Robot::compile(&spec).map_err(invalid)?;
    let written = match &args.output {
        None => None,
        Some(RobotOutput::Picture(path, format)) => {
            let picture = draw::robot(&boxes(&robot), &spec.name, &pieces(&spec, &robot));
            let content = match format {
                PictureFormat::Svg => picture.svg().into_bytes(),
                PictureFormat::Png => png("the robot", &picture)?,
            };
            atomic::write_file(path, &content)?;
            Some(format!("  picture   {}", path.display()))
        }
        Some(RobotOutput::Export { format, scale, to }) => {
            let text = format
                .write(&robot, &Physics::of_scale(*scale))
                .map_err(|unwritable| Error::Usage { message: unwritable.to_string() })?;
            let Some(path) = to else { return console::say(&text) };
            atomic::write_file(path, text.as_bytes())?;
            Some(format!("  export    {}", path.display()))
        }
        Some(RobotOutput::File(to)) => {
            let text =
                toml::to_string(&spec).map_err(|e| Error::Draw { what: "the robot".into(), reason: e.to_string() })?;
            let Some(path) = to else { return console::say(&text) };
            atomic::write_file(path, text.as_bytes())?;
            Some(format!("  file      {}", path.display()))
        }
    };
    let view = View { notes: remarks(&robot, notes, &args.robot), ..view(&spec, &robot, variants) };
    if args.json {
        return console::say_json(&view);
    }
    if quiet {
        return Ok(());
    }
    let next = || format!("  next      evogait robot {} --out {}.svg", console::quoted(&args.robot), view.name);
    console::say(&format!("{}\n{}", text(&view), written.unwrap_or_else(next)))
}

/// Returns the size of the robot in modules, or in bodies if its file lists bodies.
fn pieces(spec: &RobotSpec, robot: &Robot) -> String {
    match (spec.modules.len(), robot.bodies.len()) {
        (0, 1) => "1 body".to_owned(),
        (0, bodies) => format!("{bodies} bodies"),
        (1, _) => "1 module".to_owned(),
        (modules, _) => format!("{modules} modules"),
    }
}

fn boxes(robot: &Robot) -> Vec<DrawnBox> {
    let drawn = robot.parts.iter().map(|part| DrawnBox {
        center: part.center,
        rotation: part.rotation,
        half: part.half,
        outline: part.outline(),
        module: part.module.clone(),
        failed: part.failed,
    });
    drawn.collect()
}

fn view(spec: &RobotSpec, robot: &Robot, variants: BTreeMap<String, Vec<String>>) -> View {
    View {
        name: spec.name.clone(),
        description: spec.description.trim().to_owned(),
        modules: spec.modules.len(),
        failed_modules: spec.failed.clone(),
        bodies: robot.bodies.len(),
        joints: robot.joint_names(),
        mass: robot.mass(),
        size: size(robot),
        pivot: spec.pivot.clone(),
        variants,
        notes: Vec::new(),
    }
}

/// Returns the notes of an import and the warnings about the robot.
fn remarks(robot: &Robot, mut notes: Vec<String>, file: &str) -> Vec<String> {
    notes.extend(robot.doubts());
    notes.extend(plausibility::unit_warning(robot, file));
    notes
}

/// Returns the extent of all parts along the axes of the neutral configuration, mu.
fn size(robot: &Robot) -> [f64; 3] {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for part in &robot.parts {
        let [x, y, z, w] = part.rotation;
        // Rows of the rotation matrix: a rotated box extends |row| · half along an axis.
        let rows = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
            [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
            [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
        ];
        for (axis, row) in rows.iter().enumerate() {
            let reach: f64 = row.iter().zip(&part.half).map(|(r, half)| r.abs() * half).sum();
            low[axis] = low[axis].min(part.center[axis] - reach);
            high[axis] = high[axis].max(part.center[axis] + reach);
        }
    }
    [0, 1, 2].map(|axis| high[axis] - low[axis])
}

fn text(view: &View) -> String {
    let list = |items: &[String]| if items.is_empty() { "none".to_owned() } else { items.join(", ") };
    let mut lines = vec![view.name.clone()];
    if !view.description.is_empty() {
        lines.extend(view.description.lines().map(|line| format!("  {}", line.trim())));
    }
    let [x, y, z] = view.size;
    if view.modules > 0 {
        lines.push(format!("  modules   {} (failed: {})", view.modules, list(&view.failed_modules)));
    } else if !view.failed_modules.is_empty() {
        lines.push(format!("  failed    {}", list(&view.failed_modules)));
    }
    lines.extend([
        format!("  bodies    {}", view.bodies),
        format!("  joints    {}: {}", view.joints.len(), list(&view.joints)),
        format!("  mass      {:.2} kg", view.mass),
        format!("  size      {x:.2} × {y:.2} × {z:.2} mu (x, y, z; neutral configuration)"),
        format!("  pivot     {}", view.pivot),
    ]);
    for (name, failed) in &view.variants {
        lines.push(format!("  variant   {name}: {} fail", failed.join(", ")));
    }
    lines.extend(view.notes.iter().map(|note| format!("  note      {note}")));
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use sim_core::exchange::{Format, read};
    use sim_core::physics::Scale;

    #[test]
    fn pieces_are_modules_or_bodies_of_imported_robot() {
        let spec = load::robot("lizard", None).unwrap().spec;
        let robot = Robot::compile(&spec).unwrap();
        assert_eq!(pieces(&spec, &robot), format!("{} modules", spec.modules.len()));
        let imported = read(&Format::Mjcf.write(&robot, &Physics::of_scale(Scale::Paper)).unwrap()).unwrap().robot;
        let robot = Robot::compile(&imported).unwrap();
        assert_eq!(pieces(&imported, &robot), format!("{} bodies", robot.bodies.len()));
    }
}
