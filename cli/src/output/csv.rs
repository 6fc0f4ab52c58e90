//! CSV tables for pandas, spreadsheets and hardware. Numbers read back to the same bits.

use super::result::{ArchiveRow, AuditRow};
use crate::values::Generation;
use sim_core::report::{GaitTrace, PathMode, PathTrace, TraceSample};
use std::fmt::Write as _;

/// Formats history.csv, with a row per generation. If all evaluations of a generation failed, its statistics are NaN.
/// `best_so_far` is empty while no evaluation has succeeded.
pub fn history(history: &[Generation]) -> String {
    let mut out = "generation,min,lower_quartile,median,upper_quartile,max,mean,best_so_far,failed\n".to_owned();
    for g in history {
        let best = cell(g.best_so_far);
        let numbers = [g.min, g.lower_quartile, g.median, g.upper_quartile, g.max, g.mean].map(|v| v.to_string());
        // Writing to a String can't fail.
        let _ = writeln!(out, "{},{},{best},{}", g.generation, numbers.join(","), g.failed);
    }
    out
}

/// Formats archive.csv, with a row per genotype, best on the reference setting first. `reference` is empty if its
/// evaluation failed.
pub fn archive(rows: &[ArchiveRow]) -> String {
    let mut out = "rank,generation,candidate,search,reference\n".to_owned();
    for ArchiveRow { rank, generation, candidate, search, reference } in rows {
        let _ = writeln!(out, "{rank},{generation},{candidate},{search},{}", cell(*reference));
    }
    out
}

/// Formats audits.csv, with a row per new best of the search: scores with and without reuse of transitions.
pub fn audits(rows: &[AuditRow]) -> String {
    let mut out = "generation,candidate,with_reuse,without_reuse,gap\n".to_owned();
    for AuditRow { generation, candidate, with_reuse, without_reuse, gap } in rows {
        let _ = writeln!(out, "{generation},{candidate},{with_reuse},{},{}", cell(*without_reuse), cell(*gap));
    }
    out
}

/// Formats a cell; empty for `None`.
fn cell(value: Option<f64>) -> String {
    value.map_or_else(String::new, |v| v.to_string())
}

/// Formats the samples of a gait: time (s), joint targets and angles (rad), pivot position (mu), rotation (unit
/// quaternion), yaw (rad).
pub fn gait(trace: &GaitTrace) -> String {
    samples(&trace.joints, &trace.samples)
}

/// Formats the samples of any motion, with the same columns as [`gait`].
pub fn samples(joints: &[String], samples: &[TraceSample]) -> String {
    let mut head = vec!["time".to_owned()];
    for what in ["target", "angle"] {
        head.extend(joints.iter().map(|joint| format!("{what}_{joint}")));
    }
    head.extend(["x", "y", "z", "qx", "qy", "qz", "qw", "yaw"].map(str::to_owned));
    let mut out = head.join(",") + "\n";
    for sample in samples {
        let joints = sample.targets.iter().chain(&sample.angles).map(f32::to_string);
        let pose = sample.position.iter().chain(&sample.rotation).chain([&sample.yaw]).map(f64::to_string);
        let row: Vec<String> = [sample.time.to_string()].into_iter().chain(joints).chain(pose).collect();
        out += &row.join(",");
        out.push('\n');
    }
    out
}

/// Formats paths.csv, with a row per point (mu) of the path in each mode.
pub fn paths(paths: &[PathTrace]) -> String {
    let mut out = "mode,point,x,y\n".to_owned();
    for path in paths {
        for (i, [x, y]) in path.way.iter().enumerate() {
            let _ = writeln!(out, "{},{i},{x},{y}", mode(path.mode));
        }
    }
    out
}

/// Returns the name of a mode of running a path.
pub fn mode(mode: PathMode) -> &'static str {
    match mode {
        PathMode::Tree => "tree",
        PathMode::Resimulated => "resimulated",
        PathMode::Continuous => "continuous",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::v1::{Row, Value};

    #[test]
    fn numbers_read_back_to_same_bits() {
        let values = [0.1, -0.0, 1.0 / 3.0, f64::MIN_POSITIVE, 1e300];
        let sample = TraceSample {
            time: values[0],
            targets: vec![0.1, -0.0],
            angles: vec![1.0 / 3.0, f32::MIN_POSITIVE],
            position: [values[1], values[2], values[3]],
            rotation: [values[4], 0.0, 0.0, 1.0],
            yaw: -values[2],
        };
        let joints = vec!["a".to_owned(), "b".to_owned()];
        let csv = gait(&GaitTrace { parameters: vec![], joints, samples: vec![sample.clone()], unstable: None });
        let (head, row) = csv.trim_end().split_once('\n').unwrap();
        assert_eq!(head, "time,target_a,target_b,angle_a,angle_b,x,y,z,qx,qy,qz,qw,yaw");
        let cells: Vec<&str> = row.split(',').collect();
        assert_eq!(cells.len(), 13);
        let joints: Vec<u32> = cells[1..5].iter().map(|c| c.parse::<f32>().unwrap().to_bits()).collect();
        assert_eq!(joints, [0.1f32, -0.0, 1.0 / 3.0, f32::MIN_POSITIVE].map(f32::to_bits));
        let pose: Vec<u64> = cells[5..].iter().map(|c| c.parse::<f64>().unwrap().to_bits()).collect();
        let expected = [values[1], values[2], values[3], values[4], 0.0, 0.0, 1.0, -values[2]];
        assert_eq!(pose, expected.map(f64::to_bits));
    }

    #[test]
    fn generation_without_score_has_empty_best() {
        let failed = Value { name: "failed".to_owned(), unit: String::new(), value: Some(20.0) };
        let row = Row { series: "generations".to_owned(), index: 0, values: vec![failed] };
        let failed = Generation::of(&row).expect("the row is a generation");
        assert!(history(&[failed]).ends_with("\n0,NaN,NaN,NaN,NaN,NaN,NaN,,20\n"));
    }
}
