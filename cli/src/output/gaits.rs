//! gaits.json: the gaits of a winner or of a plan, each with its named parameters and its displacement.

use serde::Serialize;
use sim_core::base::registry::{Chosen, Component as _};
use sim_core::control::sequence::Genes;
use sim_core::control::{Controller, Sequence};
use sim_core::problem::Checked;
use sim_core::report::GaitTrace;
use std::collections::BTreeMap;

/// Content of gaits.json.
#[derive(Serialize)]
pub struct GaitFile {
    /// Controller that generates the joint targets.
    controller: Chosen<dyn Controller>,
    /// Duration of a gait, s.
    duration: f64,
    gaits: Vec<Gait>,
}

#[derive(Serialize)]
struct Gait {
    /// Number of the gait, from 1, as in file names and parameter names.
    gait: usize,
    /// Path of the file with its samples.
    trajectory: String,
    /// Parameters by name, such as `hip-front.omega1`.
    parameters: BTreeMap<String, f64>,
    /// Displacement from the settled start to the end.
    displacement: Option<Displacement>,
    /// Reason why its simulation ended early; `null` if it completed.
    unstable: Option<String>,
}

/// Displacement in the frame of the start: x ahead, y to the left.
#[derive(Serialize)]
pub struct Displacement {
    /// Displacement ahead, mu.
    pub x: f64,
    /// Displacement to the left, mu.
    pub y: f64,
    /// Change of heading, rad, in (−π, π].
    pub yaw: f64,
    /// Planar distance, mu.
    pub distance: f64,
}

/// Returns the path of the file with a gait's samples; `gait` counts from 0.
pub fn trajectory_name(gait: usize) -> String {
    format!("trajectories/gait-{}.csv", gait + 1)
}

/// Creates the content of gaits.json from the traces of a report.
pub fn file(job: &Checked, traces: &[GaitTrace]) -> GaitFile {
    let count = traces.iter().map(|trace| trace.parameters.len()).sum();
    let names = job.space().names_of(count);
    let mut names = names.iter();
    let gaits = traces.iter().enumerate().map(|(i, trace)| {
        let own = names.by_ref().take(trace.parameters.len());
        let prefix = format!("gait{}.", i + 1);
        Gait {
            gait: i + 1,
            trajectory: trajectory_name(i),
            parameters: own
                .zip(&trace.parameters)
                .map(|(name, &value)| (name.strip_prefix(&prefix).unwrap_or(name).to_owned(), value))
                .collect(),
            displacement: displacement(trace),
            unstable: trace.unstable.clone(),
        }
    });
    let gaits = gaits.collect();
    GaitFile { controller: job.gaits().controller, duration: job.gaits().duration, gaits }
}

/// Returns the text of a gait that is a motion sequence; `None` for other gaits.
pub fn program(job: &Checked, trace: &GaitTrace) -> Option<String> {
    let is_sequence = job.controller().name() == Sequence.name();
    let genes = Genes::of(job.robot().modules.len());
    is_sequence.then(|| format!("{}\n", genes.program(&trace.parameters)))
}

/// Returns the path of the file with a gait's text; `gait` counts from 0.
pub fn program_name(gait: usize) -> String {
    format!("trajectories/gait-{}.seq", gait + 1)
}

/// Returns the displacement of a gait; `None` if it has no samples.
pub fn displacement(trace: &GaitTrace) -> Option<Displacement> {
    let (start, end) = (trace.samples.first()?, trace.samples.last()?);
    let (dx, dy) = (end.position[0] - start.position[0], end.position[1] - start.position[1]);
    let (sin, cos) = start.yaw.sin_cos();
    let turn = end.yaw - start.yaw;
    Some(Displacement {
        x: cos * dx + sin * dy,
        y: cos * dy - sin * dx,
        yaw: turn.sin().atan2(turn.cos()),
        distance: dx.hypot(dy),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use sim_core::report::TraceSample;
    use std::f64::consts::FRAC_PI_2;

    #[test]
    fn displacement_is_in_frame_of_start() {
        let at = |x, y, yaw| TraceSample {
            time: 0.0,
            targets: vec![],
            angles: vec![],
            position: [x, y, 0.0],
            rotation: [0.0, 0.0, 0.0, 1.0],
            yaw,
        };
        // From heading north, 3 mu north and 1 mu west: 3 mu ahead and 1 mu to the left. The turn passes π.
        let samples = vec![at(5.0, 5.0, FRAC_PI_2), at(4.0, 8.0, FRAC_PI_2 + 3.5)];
        let d = displacement(&GaitTrace { parameters: vec![], joints: vec![], samples, unstable: None }).unwrap();
        assert!((d.x - 3.0).abs() < 1e-12 && (d.y - 1.0).abs() < 1e-12, "{} {}", d.x, d.y);
        assert!((d.yaw - (3.5 - std::f64::consts::TAU)).abs() < 1e-12);
        assert!((d.distance - 10f64.sqrt()).abs() < 1e-12);
    }
}
